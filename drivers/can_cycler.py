"""A cycler on a CAN bus, configured by its map and DBC file alone."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Mapping
from functools import partial

from drivers.can_codec import CanCodec
from drivers.can_link import CanLink
from drivers.can_map import Ask, CanMap, SignalName
from drivers.can_plan import CanPlan, Outgoing, limit_arguments
from drivers.cycler import Capabilities, DeviceLimits, Reading
from drivers.errors import (
    CyclerConnectionError,
    CyclerError,
    CyclerProtocolError,
    CyclerTimeoutError,
    SetPointRefusedError,
)
from drivers.rest import POLL_S, Step, check_cleared, come_to_rest, wait_for_output
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
        self._plan: CanPlan | None = None
        self._watch: SetPointWatch | None = None  # there is one while this driver has control
        self._heartbeat = self._token = self._sequence = 0
        self._tick: int | None = None  # None: wall clock
        self._output = False
        self._current_A = 0.0
        self._voltage_V: tuple[float, float] | None = None  # limits of the run

    # --- opening -------------------------------------------------------------------------------------------
    async def connect(self) -> Capabilities:
        """See `Cycler.connect`. A device that is not what the map describes is left alone."""
        self._watch = None
        await self._open()
        try:
            constants = {name: await self._constant(name, signal) for name, signal in self._map.constants.items()}
            self._plan = CanPlan(self._map, self._codec, constants)
            serial, lock_step = await self._role("serial"), await self._role("lock_step_available")
            shown = "" if math.isnan(serial) else f"{serial:.0f}"
            return self._plan.capabilities(shown, lock_step=lock_step > 0)
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
            found = await self._read(signal)
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

    async def _constant(self, name: str, signal: SignalName) -> float:
        value = await self._read(signal)
        if not math.isfinite(value):
            raise CyclerProtocolError(f"{self._link.address}: constant {name} ('{signal}') reads {value}, not a number")
        return value

    async def _role(self, key: str) -> float:
        role = self._map.roles.get(key)
        if role is None:
            return math.nan
        return await self._read(role.name)

    async def _read(self, signal: SignalName) -> float:
        """Ask for the message that holds a signal; return its physical value."""
        ask = self._map.ask_for(signal.message)
        if ask is not None:
            await self._ask(ask)
        raws = self._codec.raw(signal.message, self._newest(signal.message)[1])
        return self._codec.physical(signal.message, {signal.signal: raws[signal.signal]})[signal.signal]

    # --- taking and giving back control --------------------------------------------------------------------
    async def acquire(self, limits: DeviceLimits, watchdog_s: float, lock_step_period_s: float | None) -> None:
        """See `Cycler.acquire`. Output off and set-point 0 come before anything else is configured."""
        plan = self._connected_plan()
        self._watch, self._tick, self._output, self._current_A = None, None, False, 0.0
        self._link.start_log()
        available = await self._role("lock_step_available") > 0
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
            await self._command(outgoing)
        self._tick = None if lock_step_period_s is None else 0
        await self._run("tick")
        self._sequence = (await self._read_sample()).sequence
        self._watch = SetPointWatch(exact=lock_step_period_s is not None)

    async def release(self) -> None:
        """See `Cycler.release`."""
        self._connected_plan()
        self._watch = None
        await self._run("release")
        self._link.stop_log()

    async def clear_fault(self) -> None:
        """See `Cycler.clear_fault`."""
        self._connected_plan()
        await self._run("clear_fault")
        check_cleared(self._link.address, await self._read_sample())

    # --- each tick -----------------------------------------------------------------------------------------
    async def sample(self) -> Reading:
        """See `Cycler.sample`."""
        self._connected_plan()
        reading = await self._read_sample()
        self._sequence = reading.sequence
        if self._watch is not None:
            self._watch.verify(self._link.address, reading)
        return reading

    async def apply(self, current_A: float) -> None:
        """See `Cycler.apply`. Nothing is sent when the set-point is not finite or out of range."""
        plan = self._connected_plan()
        if self._watch is None:
            raise CyclerProtocolError(f"{self._link.address}: no set-point without control: acquire first")
        plan.check_current(current_A)
        before, tick = self._current_A, self._tick
        self._current_A = current_A
        self._tick = None if tick is None else (tick + 1) % TICK_SPAN
        try:
            outgoing = plan.outgoing("tick", self._arguments())
        except SetPointRefusedError:
            self._current_A, self._tick = before, tick
            raise
        for frame in outgoing:
            await self._command(frame)
        tolerance_A = plan.tolerance_A()
        if tolerance_A < math.inf:
            self._watch.written(current_A, tolerance_A, self._sequence)

    async def output(self, on: bool) -> None:
        """See `Cycler.output`."""
        self._connected_plan()
        if on and self._watch is None:
            raise CyclerProtocolError(f"{self._link.address}: no output without control: acquire first")
        self._output = on
        if not on:
            self._forget_setpoints()
        await self._run("output")
        await self._verify_output(on=on)

    # --- safety --------------------------------------------------------------------------------------------
    async def safe(self) -> None:
        """See `Cycler.safe`. Commanding rest twice does no harm, so each step is tried again on a fresh bus."""
        self._forget_setpoints()
        steps: list[Step] = [partial(self._rest, index) for index in range(len(self._map.sequences["safe"]))]
        await come_to_rest(self._link, [*steps, partial(self._verify_output, on=False)], self._reopen)

    async def _rest(self, index: int) -> None:
        await self._command(self._connected_plan().outgoing("safe", self._arguments())[index])

    async def _reopen(self) -> None:
        """Join a lost bus again, without resuming anything: what was acquired is gone with the link."""
        self._watch = None
        if self._plan is None:
            await self.connect()
        else:
            await self._open()

    def _forget_setpoints(self) -> None:
        """With the output off, what was applied before is no longer what should be in force."""
        self._output, self._current_A = False, 0.0
        if self._watch is not None:
            self._watch = SetPointWatch(exact=self._tick is not None)

    # --- sending and verifying -----------------------------------------------------------------------------
    async def _run(self, sequence: str, arguments: Mapping[str, float] | None = None) -> None:
        plan = self._connected_plan()
        for outgoing in plan.outgoing(sequence, self._arguments(arguments)):
            await self._command(outgoing)

    def _arguments(self, more: Mapping[str, float] | None = None) -> dict[str, float]:
        """What the driver itself knows, and what the caller adds."""
        plan = self._connected_plan()
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

    async def _command(self, outgoing: Outgoing) -> None:
        """Send one command and see that the device repeats it."""
        command, what = outgoing.command, f"command '{outgoing.command.name}'"
        ask = self._map.asks[command.ask] if command.ask is not None else None
        refusals = (self._map.refusal.name.message,) if self._map.refusal else ()
        replies = (command.echo,) if command.echo is not None and ask is None else ()
        refused = await self._link.exchange(
            outgoing.message, outgoing.data, replies, what, refusals=refusals if replies else ()
        )
        if refused is not None:
            raise SetPointRefusedError(f"{self._link.address}: {what}: {self._reason(refused)}")
        if command.echo is None:
            return
        sent_s = time.monotonic()
        while True:
            if ask is not None:
                await self._ask(ask)
            difference = self._connected_plan().echoes(outgoing, self._newest(command.echo)[1])
            if difference is None:
                return
            if ask is None or time.monotonic() - sent_s >= self._map.execution_s:
                raise SetPointRefusedError(
                    f"{self._link.address}: {what}: {difference}{self._refused_since(sent_s, refusals)}"
                )
            await asyncio.sleep(POLL_S)

    def _refused_since(self, time_s: float, refusals: tuple[str, ...]) -> str:
        """Why the device did not take a command, where it said so while something else was waited for."""
        said = [name for name in refusals if self._link.newest.get(name, (-math.inf, b""))[0] >= time_s]
        return f"; {self._reason(said[0])}" if said else ""

    async def _ask(self, ask: Ask) -> None:
        """Ask a question and wait for every part of the answer."""
        self._token = (self._token + 1) % (self._plan.token_modulus if self._plan else 256)
        token = self._token
        plan = self._plan or CanPlan(self._map, self._codec, dict.fromkeys(self._map.constants, 1.0))

        def accept(name: str, data: bytes) -> bool:
            signal = self._map.token.get(name)
            return signal is None or self._codec.raw(name, data)[signal] == token

        data = plan.frame(ask.send, {"token": float(token)})
        await self._link.exchange(ask.send.message, data, ask.replies, f"asking for '{ask.name}'", accept)

    async def _read_sample(self) -> Reading:
        """Make a reading of answers to fresh questions and of the newest cyclic messages."""
        plan, asked, now_s = self._connected_plan(), set[str](), time.monotonic()
        for name in self._map.sampled:
            ask = self._map.ask_for(name)
            if ask is not None and ask.name not in asked:
                asked.add(ask.name)
                await self._ask(ask)
        self._link.check("sampling")
        messages, oldest_s = {}, math.inf
        for name in self._map.sampled:
            arrived_s, messages[name] = self._newest(name)
            oldest_s = min(oldest_s, arrived_s)
            if self._map.ask_for(name) is None and now_s - arrived_s > self._map.max_age_s:
                raise CyclerTimeoutError(
                    f"{self._link.address}: cyclic message '{name}' last came {now_s - arrived_s:.3g} s ago, "
                    f"limit {self._map.max_age_s:g} s"
                )
        return plan.reading(oldest_s, self._sequence, messages)

    def _newest(self, name: str) -> tuple[float, bytes]:
        try:
            return self._link.newest[name]
        except KeyError:
            raise CyclerTimeoutError(f"{self._link.address}: message '{name}' has not come yet") from None

    async def _verify_output(self, *, on: bool) -> None:
        """Wait until the status says what the output was told."""
        await wait_for_output(self._link.address, self._read_sample, on=on)

    def _connected_plan(self) -> CanPlan:
        if self._plan is None:
            raise CyclerConnectionError(f"{self._link.address}: not connected")
        return self._plan

    def _reason(self, message: str) -> str:
        refusal = self._map.refusal
        if refusal is None:
            return "refused"
        code = int(self._codec.raw(message, self._newest(message)[1])[refusal.name.signal])
        return f"refused with code {code} ({refusal.reasons.get(code, 'unknown')})"
