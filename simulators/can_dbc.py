"""DBC files and the bits of CAN messages, for the simulators alone.

The drivers read the same file with another library, so that one mistake cannot agree with itself. Layout after the
"DBC File Format Documentation" of Vector Informatik: Intel signals count up from their lowest bit, Motorola signals
are given by their highest. Which signals of a multiplexed message are there its user must know.
"""

import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["Layout", "SignalLayout", "read_dbc"]

_MESSAGE = re.compile(r"^BO_ (\d+) (\w+) *: *(\d+) (\w+)")
_SIGNAL = re.compile(
    r"^ SG_ (\w+) *(?:M|m\d+M?)? *: *(\d+)\|(\d+)@([01])([+-]) *\(([^,]+),([^)]+)\)"
    r" *\[([^|]+)\|([^\]]+)\] *\"([^\"]*)\""
)
_VALUE_TYPE = re.compile(r"^SIG_VALTYPE_ (\d+) (\w+) *: *([0-3]) *;")
EXTENDED = 1 << 31


@dataclass(frozen=True, slots=True)
class SignalLayout:
    """Where a signal stands and what one count is worth; `floating` for IEEE 754."""

    name: str
    start: int
    length: int
    intel: bool
    signed: bool
    factor: float
    offset: float
    floating: bool = False

    def bits(self) -> list[int]:
        """Positions of the signal's bits in the message, lowest first; bit 8 n + k is bit k of byte n."""
        if self.intel:
            return list(range(self.start, self.start + self.length))
        positions, position = [], self.start
        for _ in range(self.length):
            positions.append(position)
            position = position + 15 if position % 8 == 0 else position - 1
        return positions[::-1]

    def unpack(self, data: bytes) -> float:
        """Return the raw value."""
        number = int.from_bytes(data, "little")
        if self.intel:
            raw = number >> self.start & ((1 << self.length) - 1)
        else:
            raw = sum((number >> position & 1) << index for index, position in enumerate(self.bits()))
        if self.floating:
            return struct.unpack("<f" if self.length == 32 else "<d", raw.to_bytes(self.length // 8, "little"))[0]
        return raw - (1 << self.length) if self.signed and raw >> (self.length - 1) else raw

    def pack(self, raw: float) -> int:
        """Return the message as a number with this signal alone in it; whole numbers saturate."""
        if self.floating:
            whole = int.from_bytes(struct.pack("<f" if self.length == 32 else "<d", raw), "little")
        else:
            low, high = (
                (-(1 << self.length - 1), (1 << self.length - 1) - 1) if self.signed else (0, (1 << self.length) - 1)
            )
            whole = min(max(round(raw), low), high) & ((1 << self.length) - 1)
        if self.intel:
            return whole << self.start
        return sum((whole >> index & 1) << position for index, position in enumerate(self.bits()))


@dataclass(frozen=True, slots=True)
class Layout:
    """One message of a DBC file."""

    name: str
    id: int
    extended: bool
    length: int
    signals: Mapping[str, SignalLayout] = field(default_factory=dict)

    def encode(self, values: Mapping[str, float]) -> bytes:
        """Encode physical values; signals without one are zero."""
        raws = {}
        for name, value in values.items():
            signal = self.signals[name]
            raws[name] = value if signal.floating else (value - signal.offset) / signal.factor
        return self.encode_raw(raws)

    def encode_raw(self, raws: Mapping[str, float]) -> bytes:
        """Encode raw values; signals without one are zero."""
        return sum(self.signals[name].pack(raw) for name, raw in raws.items()).to_bytes(self.length, "little")

    def decode(self, data: bytes) -> dict[str, float]:
        """Physical values of all signals."""
        raws = self.decode_raw(data)
        return {
            name: raw if self.signals[name].floating else raw * self.signals[name].factor + self.signals[name].offset
            for name, raw in raws.items()
        }

    def decode_raw(self, data: bytes) -> dict[str, float]:
        """Raw values of all signals."""
        return {name: signal.unpack(data) for name, signal in self.signals.items()}


def read_dbc(path: Path) -> dict[str, Layout]:
    """Read the messages of a DBC file, by name; what is no message, signal or value type is passed over."""
    heads: dict[int, tuple[str, int, dict[str, SignalLayout]]] = {}
    signals: dict[str, SignalLayout] = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        if head := _MESSAGE.match(line):
            signals = {}
            heads[int(head[1])] = head[2], int(head[3]), signals
        elif found := _SIGNAL.match(line):
            name, start, length, order, sign, factor, offset = found.groups()[:7]
            signals[name] = SignalLayout(
                name, int(start), int(length), order == "1", sign == "-", float(factor), float(offset)
            )
        elif kind := _VALUE_TYPE.match(line):
            there = heads[int(kind[1])][2]
            old = there[kind[2]]
            there[kind[2]] = SignalLayout(
                old.name, old.start, old.length, old.intel, old.signed, old.factor, old.offset, floating=kind[3] != "0"
            )
    return {
        name: Layout(name, identifier & ~EXTENDED, bool(identifier & EXTENDED), length, found)
        for identifier, (name, length, found) in heads.items()
    }
