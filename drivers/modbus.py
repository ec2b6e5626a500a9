"""A cycler behind Modbus, configured by its map alone."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from functools import partial

from drivers.codec import Value
from drivers.cycler import Capabilities, DeviceLimits, Reading
from drivers.device_map import Coil, DeviceMap
from drivers.errors import CyclerConnectionError, CyclerError, CyclerProtocolError, SetPointRefusedError
from drivers.modbus_commands import Write, differs
from drivers.modbus_identity import open_identified, read_constants, read_identity, read_role
from drivers.modbus_link import ModbusLink
from drivers.modbus_plan import DevicePlan
from drivers.read_plan import ReadPlan
from drivers.rest import Step, check_cleared, check_same, come_to_rest, wait_for_output
from drivers.setpoint_watch import SetPointWatch
from drivers.settings_watch import SettingsWatch, foreign


class ModbusCycler:
    """`drivers.cycler.Cycler` over a `ModbusLink`.

    Parameters
    ----------
    link : ModbusLink
        The transport; not opened yet.
    device_map : DeviceMap
        The device family.
    """

    def __init__(self, link: ModbusLink, device_map: DeviceMap) -> None:
        self._link = link
        self._map = device_map
        self._plan: DevicePlan | None = None
        self._watch: SetPointWatch | None = None  # there is one while this driver has control
        self._heartbeat = 0
        self._tick: int | None = None  # None: wall clock
        self._sequence = 0
        self._voltage_V = (0.0, 0.0)  # limits of the run
        self._settings_watch = SettingsWatch()
        self._hold_V: float | None = None  # that the device was told to hold
        self._identity: dict[str, str] = {}  # what the device has said of itself
        self._read_ahead: tuple[float, list[int]] | None = None  # the next sample, if the last message brought it

    async def connect(self) -> Capabilities:
        """See `Cycler.connect`. A device that is not what the map describes is left alone."""
        self._watch = None
        await open_identified(self._link, self._map)
        try:
            constants = await read_constants(self._link, self._map)
            self._plan = DevicePlan(self._map, constants)
            self._identity = await read_identity(self._link, self._map)
            available = await self._read_role("lock_step_available", constants)
            return self._plan.capabilities(self._identity, lock_step=available not in (None, 0))
        except CyclerError:
            self._link.close()
            raise

    async def close(self) -> None:
        """See `Cycler.close`."""
        self._watch = self._read_ahead = None
        self._link.close()

    async def _read_role(self, role: str, constants: Mapping[str, float]) -> Value | None:
        return await read_role(self._link, self._map, role, constants)

    async def acquire(self, limits: DeviceLimits, watchdog_s: float, lock_step_period_s: float | None) -> None:
        """See `Cycler.acquire`. Output off and set-point 0 come before anything else is configured."""
        plan = self._connected_plan()
        self._watch = self._read_ahead = None
        self._voltage_V = limits.voltage_V
        # Everything is encoded, and refused if it must be, before the first write.
        settings = plan.grouped(await self._settings(plan, limits, watchdog_s, lock_step_period_s))
        await self._run("acquire", {"watchdog_s": watchdog_s})
        await self._run("safe")
        await self._verify_off()
        for write in (*settings, *plan.hold(None)):
            await self._set(write)
        self._hold_V = None
        self._tick = None
        if lock_step_period_s is not None:
            tick = await self._read_role("lock_step", plan.constants)
            self._tick = tick if isinstance(tick, int) else 0
        for write in plan.command.writes(0.0, self._next_heartbeat(plan), None, self._voltage_V):
            await self._link.write_registers(write.first, write.values, write.label)
        for write in plan.command.read_back(0.0, every=True):
            await self._verify_readback(write)
        self._sequence = (await self._read_sample(plan)).sequence
        self._watch = SetPointWatch(exact=lock_step_period_s is not None)
        self._settings_watch = SettingsWatch(settings, plan.heartbeat)

    async def _settings(
        self, plan: DevicePlan, limits: DeviceLimits, watchdog_s: float, period_s: float | None
    ) -> dict[str, float]:
        """Registers that `acquire` writes and reads back, after checking that the clock is one both have."""
        settings = plan.limit_values(limits)
        watchdog = self._map.by_role("watchdog")
        if watchdog is not None:
            plan.check_watchdog(watchdog, watchdog_s)
            settings[watchdog.name] = watchdog_s
        available = await self._read_role("lock_step_available", plan.constants) not in (None, 0)
        if period_s is None and available:
            raise CyclerProtocolError(f"{self._link.address}: the device's time moves only in lock-step")
        period = self._map.by_role("lock_step_period")
        if period_s is not None:
            if period is None or not available:
                raise CyclerProtocolError(f"{self._link.address}: the device has no lock-step")
            settings[period.name] = period_s
        return settings

    async def release(self) -> None:
        """See `Cycler.release`."""
        self._connected_plan()
        self._watch = None
        await self._run("release")

    async def clear_fault(self) -> None:
        """See `Cycler.clear_fault`."""
        plan = self._connected_plan()
        await self._run("clear_fault")
        check_cleared(self._link.address, await self._read_sample(plan))

    async def sample(self) -> Reading:
        """See `Cycler.sample`."""
        plan, ahead = self._connected_plan(), self._read_ahead
        self._read_ahead = None
        if ahead is None or not self._link.is_open:
            reading = await self._read_sample(plan)
        else:
            reading = plan.sample.reading(ahead[0], self._sequence, [ahead[1]])
        self._sequence = reading.sequence
        if self._watch is not None:
            self._watch.verify(self._link.address, reading)
        return reading

    async def apply(self, current_A: float, hold_V: float | None = None) -> None:
        """See `Cycler.apply`. Nothing is sent when the set-point is not finite or out of range."""
        plan = self._connected_plan()
        if self._watch is None:
            raise CyclerProtocolError(f"{self._link.address}: no set-point without control: acquire first")
        tick = None if self._tick is None else (self._tick + 1) & 0xFFFFFFFF
        self._read_ahead = None
        for write in plan.hold(hold_V) if hold_V != self._hold_V else ():
            await self._set(write)  # before the current that may lead there
        self._hold_V = hold_V
        writes = plan.command.writes(current_A, self._next_heartbeat(plan), tick, self._voltage_V)
        if tick is not None and len(writes) == 1 and (read := plan.one_message_read) is not None:
            # Simulated time stands still until the next tick, so its sample may come with this one.
            registers = await self._link.write_then_read(
                writes[0].first, writes[0].values, read.first, read.count, writes[0].label
            )
            self._read_ahead = time.monotonic(), registers
        else:
            for write in writes:
                await self._link.write_registers(write.first, write.values, write.label)
        self._tick = tick
        value_A, tolerance_A = plan.expected(current_A)
        for write in plan.command.read_back(current_A, every=False):
            await self._verify_readback(write)
        if tolerance_A < math.inf:
            self._watch.written(value_A, tolerance_A, self._sequence)

    async def output(self, on: bool) -> None:
        """See `Cycler.output`."""
        plan = self._connected_plan()
        self._read_ahead = None
        if on and self._watch is None:
            raise CyclerProtocolError(f"{self._link.address}: no output without control: acquire first")
        switch = self._map.switch("output")
        if switch is not None:  # every validated map has one
            await self._write(switch.name, on if isinstance(switch, Coil) else float(on))
        if not on:
            self._forget_setpoints()
        await self._verify_output(plan, on=on)

    async def verify(self) -> str | None:
        """See `Cycler.verify`."""
        plan = self._connected_plan()
        write = self._settings_watch.next(self._heartbeat)
        if self._watch is None or write is None:
            return None
        found = await self._link.read_registers("holding", write.first, len(write.values), write.label)
        return foreign(self._link.address, plan.differences(write, found))

    async def stop_input(self) -> bool | None:
        """See `Cycler.stop_input`."""
        quick = self._tick is None and self._link.quick
        return await self._connected_plan().stop_input(self._link.read_registers) if quick else None

    async def safe(self) -> None:
        """See `Cycler.safe`. Writing rest twice does no harm, so each step is tried again on a fresh link."""
        self._read_ahead = None
        steps: list[Step] = [partial(self._write, step.write, step.value) for step in self._map.sequences["safe"]]
        try:
            await come_to_rest(self._link, [*steps, self._verify_off], self._reopen)
        finally:
            self._forget_setpoints()

    async def _reopen(self) -> None:
        """Open a lost link again, without resuming anything: what was acquired is gone with the link."""
        self._watch = None
        if self._plan is None:
            await self.connect()
        else:
            await open_identified(self._link, self._map)
            try:
                check_same(self._link.address, self._identity, await read_identity(self._link, self._map))
            except CyclerError:
                self._link.close()
                raise

    def _forget_setpoints(self) -> None:
        """With the output off, what was applied before is no longer what should be in force."""
        if self._watch is not None:
            self._watch = SetPointWatch(exact=self._tick is not None)

    async def _verify_off(self) -> None:
        await self._verify_output(self._connected_plan(), on=False)

    async def _run(self, sequence: str, arguments: Mapping[str, float] | None = None) -> None:
        for step in self._map.sequences[sequence]:
            value = step.value if step.argument is None else (arguments or {}).get(step.argument)
            await self._write(step.write, value)

    async def _write(self, name: str, value: float | bool | None) -> None:
        """Write one register or coil by name."""
        plan = self._connected_plan()
        if value is None:
            raise CyclerProtocolError(f"map '{self._map.name}': no value for '{name}' in its sequence")
        if coil := self._map.coils.get(name):
            await self._link.write_coil(coil.address, bool(value), f"'{name}'")
            return
        register = self._map.registers[name]
        values = plan.codecs[name].encode(value)
        await self._link.write_registers(register.address, values, f"'{name}'")

    async def _set(self, write: Write) -> None:
        await self._link.write_registers(write.first, write.values, write.label)
        await self._verify_readback(write)

    async def _verify_readback(self, write: Write) -> None:
        found = tuple(await self._link.read_registers("holding", write.first, len(write.values), write.label))
        if found != write.values:
            raise SetPointRefusedError(f"{self._link.address}: {differs(write, found)}")

    async def _verify_output(self, plan: DevicePlan, *, on: bool) -> None:
        """Wait until the status says what the output was told."""
        await wait_for_output(self._link.address, partial(self._read_sample, plan), on=on)

    async def _read_sample(self, plan: DevicePlan) -> Reading:
        blocks = [await self._read(read) for read in plan.sample.reads]
        return plan.sample.reading(time.monotonic(), self._sequence, blocks)

    async def _read(self, read: ReadPlan) -> list[int]:
        return await self._link.read_registers(read.space, read.first, read.count, read.label)

    def _connected_plan(self) -> DevicePlan:
        if self._plan is None:
            raise CyclerConnectionError(f"{self._link.address}: not connected")
        return self._plan

    def _next_heartbeat(self, plan: DevicePlan) -> int:
        self._heartbeat = (self._heartbeat + 1) % plan.command.heartbeat_modulus
        return self._heartbeat
