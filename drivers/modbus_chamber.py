"""A temperature chamber behind Modbus, configured by its map alone."""

from __future__ import annotations

import asyncio
import time

from drivers.chamber import ChamberIdentity, ChamberReading
from drivers.codec import BlockDecoder, Codec, Value, bind_all
from drivers.device_map import Coil, DeviceMap, Register
from drivers.errors import CyclerConnectionError, CyclerError, CyclerProtocolError, SetPointRefusedError
from drivers.expression import ExpressionError
from drivers.modbus_identity import open_identified, read_constants, read_identity
from drivers.modbus_link import ModbusLink
from drivers.modbus_sample import bits_of_role, named_bits
from drivers.read_plan import plan_reads
from drivers.rest import POLL_S

SAMPLE_ROLES = ("temperature", "set_temperature", "status", "alarms")
SWITCH_S = 0.5  # a chamber may take its time to show that it was switched


class ModbusChamber:
    """`drivers.chamber.Chamber` over a `ModbusLink`.

    Parameters
    ----------
    link : ModbusLink
        The transport; not opened yet.
    device_map : DeviceMap
        Of kind "chamber".
    """

    def __init__(self, link: ModbusLink, device_map: DeviceMap) -> None:
        self._link = link
        self._map = device_map
        self._plan: _Plan | None = None
        self._acquired = False

    async def connect(self) -> ChamberIdentity:
        """See `Chamber.connect`."""
        self._acquired = False
        await open_identified(self._link, self._map)
        try:
            plan = _Plan(self._map, await read_constants(self._link, self._map))
            said = await read_identity(self._link, self._map)
        except CyclerError:
            self._link.close()
            raise
        self._plan = plan
        return ChamberIdentity(self._map.title, said, plan.range_degC)

    async def sample(self) -> ChamberReading:
        """See `Chamber.sample`."""
        plan = self._connected()
        values: list[Value] = []
        for read, decoder in zip(plan.reads, plan.decoders, strict=True):
            values += decoder.decode(await self._link.read_registers(read.space, read.first, read.count, read.label))
        return plan.reading(time.monotonic(), values)

    async def set(self, temperature_degC: float) -> None:
        """See `Chamber.set`. Nothing is sent when the set point is not finite or out of range."""
        plan = self._connected()
        low, high = plan.range_degC
        if not low <= temperature_degC <= high:  # also false for NaN
            raise SetPointRefusedError(
                f"{self._link.address}: set point {temperature_degC:g} degC is outside the chamber's {low:g} to "
                f"{high:g} degC; not sent"
            )
        register = plan.setpoint
        words = plan.codecs[register.name].encode(temperature_degC)
        if not self._acquired:
            await self._run("acquire")
            self._acquired = True
        await self._link.write_registers(register.address, words, f"'{register.name}'")
        found = await self._link.read_registers(register.space, register.address, register.words, f"'{register.name}'")
        if tuple(found) != words:
            shown = plan.codecs[register.name].decode(found)
            raise SetPointRefusedError(
                f"{self._link.address}: set point {temperature_degC:g} degC was written, {shown} degC stands there"
            )
        if not (await self.sample()).on:
            await self._switch(plan, on=True)

    async def standby(self) -> None:
        """See `Chamber.standby`."""
        self._acquired = False
        await self._run("safe")
        await self._is_switched(on=False)

    async def clear_fault(self) -> None:
        """See `Chamber.clear_fault`."""
        await self._run("clear_fault")

    async def close(self) -> None:
        """See `Chamber.close`."""
        self._acquired = False
        self._link.close()

    async def _switch(self, plan: _Plan, *, on: bool) -> None:
        await self._write(plan.switch.name, on if isinstance(plan.switch, Coil) else float(on))
        await self._is_switched(on=on)

    async def _is_switched(self, *, on: bool) -> None:
        deadline_s = time.monotonic() + SWITCH_S
        while (reading := await self.sample()).on != on:
            if time.monotonic() >= deadline_s:
                told, alarms = ("on" if on else "off"), ", ".join(sorted(reading.alarms)) or "none"
                raise CyclerProtocolError(
                    f"{self._link.address}: the chamber was switched {told}, but its status says otherwise after "
                    f"{SWITCH_S:g} s; alarms: {alarms}"
                )
            await asyncio.sleep(POLL_S)

    async def _run(self, sequence: str) -> None:
        for step in self._map.sequences[sequence]:
            await self._write(step.write, step.value)

    async def _write(self, name: str, value: float | bool | None) -> None:
        plan = self._connected()
        if value is None:
            raise CyclerProtocolError(f"map '{self._map.name}': no value for '{name}' in its sequence")
        if coil := self._map.coils.get(name):
            await self._link.write_coil(coil.address, bool(value), f"'{name}'")
            return
        register = self._map.registers[name]
        await self._link.write_registers(register.address, plan.codecs[name].encode(value), f"'{name}'")

    def _connected(self) -> _Plan:
        if self._plan is None:
            raise CyclerConnectionError(f"{self._link.address}: not connected")
        return self._plan


class _Plan:
    """A map with the constants of one device put in."""

    def __init__(self, device_map: DeviceMap, constants: dict[str, float]) -> None:
        self.codecs: dict[str, Codec] = bind_all(device_map, constants)
        roles = {role: r for role in SAMPLE_ROLES if (r := device_map.by_role(role)) is not None}
        self.setpoint: Register = roles["set_temperature"]
        switch = device_map.switch("output")
        assert switch is not None  # noqa: S101  # every validated map has one
        self.switch = switch
        self.reads = plan_reads(device_map, [r.name for r in roles.values()])
        self.decoders = tuple(
            BlockDecoder(p.first, p.count, [(r.address, self.codecs[r.name]) for r in p.registers]) for p in self.reads
        )
        order = [r.name for p in self.reads for r in p.registers]
        self._at = {role: order.index(register.name) for role, register in roles.items()}
        self._bits = {role: bits_of_role(device_map, role) for role in ("status", "alarms")}
        self._alarming = frozenset(device_map.alarm_bits)
        own = self.codecs[self.setpoint.name]
        self.range_degC = _capability(device_map, constants) or (own.low, own.high)

    def reading(self, monotonic_s: float, values: list[Value]) -> ChamberReading:
        """Make a reading of the values of all reads."""
        found = {role: values[at] for role, at in self._at.items()}
        status, alarms = (
            named_bits(self._bits[role], value if isinstance(value := found.get(role, 0), int) else 0)
            for role in ("status", "alarms")
        )
        return ChamberReading(
            monotonic_s,
            float(found["temperature"]),
            float(found["set_temperature"]),
            "output_on" in status,
            status,
            alarms | (status & self._alarming),
        )


def _capability(device_map: DeviceMap, constants: dict[str, float]) -> tuple[float, float] | None:
    pair = device_map.capabilities.get("temperature")
    try:
        return None if pair is None else (pair[0].evaluate(constants), pair[1].evaluate(constants))
    except ExpressionError as error:
        raise CyclerProtocolError(f"map {device_map.name}, capabilities.temperature: {error}") from None
