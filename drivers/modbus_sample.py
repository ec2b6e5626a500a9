"""The reads that make one sample of a Modbus device, and the `Reading` that is made of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from drivers.codec import BlockDecoder, Codec, Value
from drivers.cycler import Reading
from drivers.device_map import SAMPLE_ROLES, DeviceMap
from drivers.read_plan import ReadPlan, plan_reads
from drivers.setpoint_watch import COUNTER, unrolled


class SamplePlan:
    """Reads that make one sample (one, where the map allows it), and how a `Reading` is made of them."""

    def __init__(self, device_map: DeviceMap, codecs: Mapping[str, Codec]) -> None:
        roles = {role: r for role in SAMPLE_ROLES if (r := device_map.by_role(role)) is not None}
        registers = list(roles.values())
        self.reads: tuple[ReadPlan, ...] = plan_reads(device_map, [r.name for r in registers])
        self._decoders = tuple(
            BlockDecoder(p.first, p.count, [(r.address, codecs[r.name]) for r in p.registers]) for p in self.reads
        )
        order = [r.name for p in self.reads for r in p.registers]
        # A missing role points at the NaN that is put behind the values.
        self._at = tuple(order.index(roles[role].name) if role in roles else -1 for role in SAMPLE_ROLES)
        self.has_sequence = "sequence" in roles
        self._counter = 1 << 16 * roles["sequence"].words if self.has_sequence else COUNTER
        self._status_bits = bits_of_role(device_map, "status")
        self._alarm_bits = bits_of_role(device_map, "alarms")
        current = device_map.by_role("actual_current")
        self._negative = current.negative if current else None
        self._alarming = frozenset(device_map.alarm_bits)
        self._names: dict[tuple[int, int], tuple[frozenset[str], frozenset[str]]] = {}

    def reading(self, monotonic_s: float, last: int, blocks: Sequence[Sequence[int]]) -> Reading:
        """Make a reading of the registers of all reads; `last` is the sequence number of the reading before."""
        values: list[Value] = []
        for decoder, registers in zip(self._decoders, blocks, strict=True):
            values += decoder.decode(registers)
        values.append(math.nan)
        sequence, voltage, current, temperature, ambient, in_force, status, alarms = (values[i] for i in self._at)
        key = (_whole(status, 0), _whole(alarms, 0))
        names = self._names.get(key)
        if names is None:
            named = named_bits(self._status_bits, key[0])
            names = (named, named_bits(self._alarm_bits, key[1]) | (named & self._alarming))
            if len(self._names) < 1024:  # a device that flips random bits must not fill the memory
                self._names[key] = names
        return Reading(
            monotonic_s,
            unrolled(sequence if isinstance(sequence, int) else None, last, self._counter),
            float(voltage),
            0.0 - float(current) if self._negative in names[0] else float(current),
            float(temperature),
            float(ambient),
            float(in_force),
            "output_on" in names[0],
            names[0],
            names[1],
        )


def bits_of_role(device_map: DeviceMap, role: str) -> Mapping[str, int]:
    """Names of the bits of the register with a role, and their positions; empty where there are none."""
    register = device_map.by_role(role)
    return device_map.bits.get(register.name, {}) if register else {}


def named_bits(bits: Mapping[str, int], raw: int) -> frozenset[str]:
    """Names of the bits that are set; set bits without a name are named by their number, never dropped."""
    known = dict(zip(bits.values(), bits, strict=True))
    return frozenset(known.get(i, f"bit_{i}") for i in range(raw.bit_length()) if raw >> i & 1)


def _whole(value: Value, otherwise: int) -> int:
    return value if isinstance(value, int) else otherwise
