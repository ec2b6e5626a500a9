"""A cycler on a CAN bus, configured by its map and DBC file alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

from drivers.can_codec import CanCodec
from drivers.can_dialogue import CanDialogue
from drivers.can_link import CanLink
from drivers.can_map import CanMap, SignalName
from drivers.can_plan import CanPlan, Outgoing, limit_arguments
from drivers.cycler import Capabilities, DeviceLimits, Reading
from drivers.errors import (
    CyclerError,
    CyclerProtocolError,
    SetPointRefusedError,
)
from drivers.rest import Step, check_cleared, check_same, come_to_rest, wait_for_output
from drivers.setpoint_watch import SetPointWatch

TICK_SPAN = 1 << 32


class CanCycler:
    """`drivers.cycler.Cycler` over a `CanLink`.

    Parameters
    ----------
    link : CanLink
        Not opened yet.
    can_map : CanMap
        The device family.
    codec : CanCodec
        Of the map's DBC file.
    """

    def __init__(self, link: CanLink, can_map: CanMap, codec: CanCodec) -> None:
        self._link, self._map, self._codec = link, can_map, codec
        self._dialogue = CanDialogue(link, can_map, codec)
        self._watch: SetPointWatch | None = None  # there is one while this driver has control
        self._heartbeat = self._sequence = 0
        self._tick: int | None = None  # None: wall clock
        self._identity: dict[str, str] = {}  # what the device has said of itself
        self._output = False
        self._current_A = 0.0
        self._hold_V: float | None = None  # that the device was told to hold
        self._voltage_V: tuple[float, float] | None = None  # limits of the run
        self._settings: list[Outgoing] = []  # that the device repeats when asked

    # --- opening -------------------------------------------------------------------------------------------
    async def connect(self) -> Capabilities:
        """See `Cycler.connect`. A device that is not what the map describes is left alone.

        Another sender is told of by what follows: it must not keep the bench from commanding rest.
        """
        self._watch = None
        with self._link.beside_others():
            await self._open()
            return await self._learn()

    async def _learn(self) -> Capabilities:
        """Ask the device what the map leaves to it."""
        try:
            constants = {name: await self._constant(name, signal) for name, signal in self._map.constants.items()}
            self._dialogue.plan = plan = CanPlan(self._map, self._codec, constants)
            self._identity = await self._read_identity()
            lock_step = await self._dialogue.read_role("lock_step_available")
            return plan.capabilities(self._identity, lock_step=lock_step > 0)
        except CyclerError:
            self._link.close()
            raise

    async def close(self) -> None:
        """See `Cycler.close`."""
        self._watch = None
        self._link.stop_log()
        self._link.close()

    async def _open(self) -> None:
        """Join the bus, and make sure that it is the device that the map is about."""
        await self._link.open()
        signal, known = self._map.identity
        wanted = known or (float(self._link.node),)
        try:
            found = await self._dialogue.read(signal)
        except CyclerError:
            self._link.close()
            raise
        if found not in wanted:
            self._link.close()
            raise CyclerProtocolError(
                f"{self._link.address}: '{signal}' reads {found:g}, map '{self._map.name}' wants "
                f"{' or '.join(f'{value:g}' for value in wanted)}: another device, or the wrong map; "
                "nothing was changed"
            )

    async def _read_identity(self) -> dict[str, str]:
        found = {role: await self._dialogue.read_role(role) for role in ("serial", "firmware")}
        return {role: "" if math.isnan(value) else f"{value:.0f}" for role, value in found.items()}

    async def _constant(self, name: str, signal: SignalName) -> float:
        value = await self._dialogue.read(signal)
        if not math.isfinite(value):
            raise CyclerProtocolError(f"{self._link.address}: constant {name} ('{signal}') reads {value}, not a number")
        return value

    # --- taking and giving back control --------------------------------------------------------------------
    async def acquire(self, limits: DeviceLimits, watchdog_s: float, lock_step_period_s: float | None) -> None:
        """See `Cycler.acquire`. Output off and set-point 0 come before anything else is configured."""
        plan = self._dialogue.connected_plan()
        self._watch, self._tick, self._output, self._current_A = None, None, False, 0.0
        self._link.start_log()
        available = await self._dialogue.read_role("lock_step_available") > 0
        if available != (lock_step_period_s is not None):
            lacks = "the device's time moves only in lock-step" if available else "the device has no lock-step"
            raise CyclerProtocolError(f"{self._link.address}: {lacks}")
        self._voltage_V = limits.voltage_V
        arguments = {**limit_arguments(self._map, limits), "watchdog": watchdog_s}
        if lock_step_period_s is not None:
            arguments["lock_step_period"] = lock_step_period_s
        # Everything is encoded, and refused if it must be, before the first frame.
        settings = plan.outgoing("settings", self._arguments(arguments))
        before = [o for o in settings if "watchdog" not in o.arguments and "lock_step_period" not in o.arguments]
        await self._run("acquire", arguments)
        await self._run("safe")
        await self._verify_output(on=False)
        for outgoing in [*before, *(o for o in settings if o not in before)]:
            await self._dialogue.command(outgoing)
        self._settings = [outgoing for outgoing in settings if outgoing.command.ask is not None]
        await self._tell_hold(None)
        self._tick = None if lock_step_period_s is None else 0
        await self._run("tick")
        self._sequence = (await self._dialogue.sample(self._sequence)).sequence
        self._watch = SetPointWatch(exact=lock_step_period_s is not None)

    async def release(self) -> None:
        """See `Cycler.release`."""
        self._dialogue.connected_plan()
        self._watch = None
        await self._run("release")
        self._link.stop_log()

    async def clear_fault(self) -> None:
        """See `Cycler.clear_fault`."""
        self._dialogue.connected_plan()
        await self._run("clear_fault")
        check_cleared(self._link.address, await self._dialogue.sample(self._sequence))

    # --- each tick -----------------------------------------------------------------------------------------
    async def sample(self) -> Reading:
        """See `Cycler.sample`."""
        self._dialogue.connected_plan()
        reading = await self._dialogue.sample(self._sequence)
        self._sequence = reading.sequence
        if self._watch is not None:
            self._watch.verify(self._link.address, reading)
        return reading

    async def stop_input(self) -> bool | None:
        """See `Cycler.stop_input`."""
        plan = self._dialogue.connected_plan()
        if self._tick is not None or "stop_input" not in plan.map.status:
            return None
        return "stop_input" in (await self._dialogue.sample(self._sequence)).status

    async def apply(self, current_A: float, hold_V: float | None = None) -> None:
        """See `Cycler.apply`. Nothing is sent when the set-point is not finite or out of range."""
        plan = self._dialogue.connected_plan()
        if self._watch is None:
            raise CyclerProtocolError(f"{self._link.address}: no set-point without control: acquire first")
        plan.check_current(current_A)
        if hold_V != self._hold_V:
            await self._tell_hold(hold_V)  # before the current that may lead there
        before, tick = self._current_A, self._tick
        self._current_A = current_A
        self._tick = None if tick is None else (tick + 1) % TICK_SPAN
        try:
            outgoing = plan.outgoing("tick", self._arguments())
        except SetPointRefusedError:
            self._current_A, self._tick = before, tick
            raise
        for frame in outgoing:
            await self._dialogue.command(frame)
        tolerance_A = plan.tolerance_A()
        if tolerance_A < math.inf:
            self._watch.written(current_A, tolerance_A, self._sequence)

    async def output(self, on: bool) -> None:
        """See `Cycler.output`."""
        self._dialogue.connected_plan()
        if on and self._watch is None:
            raise CyclerProtocolError(f"{self._link.address}: no output without control: acquire first")
        self._output = on
        if not on:
            self._forget_setpoints()
        await self._run("output")
        await self._verify_output(on=on)

    async def verify(self) -> str | None:
        """See `Cycler.verify`. A second master on the bus shows by itself: its frames are seen."""
        if self._watch is None or not self._settings:
            return None
        outgoing = self._settings.pop(0)
        self._settings.append(outgoing)
        difference = await self._dialogue.asked_difference(outgoing)
        if difference is None:
            return None
        return f"{self._link.address}: {difference}: another program writes to this device; only one must steer it"

    # --- safety --------------------------------------------------------------------------------------------
    async def safe(self) -> None:
        """See `Cycler.safe`. Commanding rest twice does no harm, so each step is tried again on a fresh bus.

        Nor does another sender on the bus keep it from being commanded.
        """
        self._forget_setpoints()
        steps: list[Step] = [partial(self._rest, index) for index in range(len(self._map.sequences["safe"]))]
        with self._link.beside_others():
            await come_to_rest(self._link, [*steps, partial(self._verify_output, on=False)], self._reopen)

    async def _rest(self, index: int) -> None:
        await self._dialogue.command(self._dialogue.connected_plan().outgoing("safe", self._arguments())[index])

    async def _reopen(self) -> None:
        """Join a lost bus again, without resuming anything: what was acquired is gone with the link."""
        self._watch = None
        if self._dialogue.plan is None:
            await self.connect()
        else:
            await self._open()
            try:
                check_same(self._link.address, self._identity, await self._read_identity())
            except CyclerError:
                self._link.close()
                raise

    def _forget_setpoints(self) -> None:
        """With the output off, what was applied before is no longer what should be in force."""
        self._output, self._current_A = False, 0.0
        if self._watch is not None:
            self._watch = SetPointWatch(exact=self._tick is not None)

    # --- sending and verifying -----------------------------------------------------------------------------
    async def _run(self, sequence: str, arguments: Mapping[str, float] | None = None) -> None:
        plan = self._dialogue.connected_plan()
        for outgoing in plan.outgoing(sequence, self._arguments(arguments)):
            await self._dialogue.command(outgoing)

    async def _tell_hold(self, hold_V: float | None) -> None:
        if argument := self._dialogue.connected_plan().hold(hold_V):
            await self._run("hold", argument)
        self._hold_V = hold_V

    def _arguments(self, more: Mapping[str, float] | None = None) -> dict[str, float]:
        """What the driver itself knows, and what the caller adds."""
        plan = self._dialogue.connected_plan()
        self._heartbeat = (self._heartbeat + 1) % plan.heartbeat_modulus
        own = {
            "set_current": self._current_A,
            "output": float(self._output),
            "heartbeat": float(self._heartbeat),
            "lock_step": float(self._tick or 0),
        }
        if self._voltage_V is not None:
            own["voltage_limit"] = self._voltage_V[self._current_A >= 0.0]
        return own | dict(more or {})

    async def _verify_output(self, *, on: bool) -> None:
        """Wait until the status says what the output was told."""
        await wait_for_output(self._link.address, partial(self._dialogue.sample, self._sequence), on=on)
