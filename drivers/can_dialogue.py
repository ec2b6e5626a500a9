"""Questions and commands over a CAN link, each with the answer that it must have."""

from __future__ import annotations

import asyncio
import math
import time

from drivers.can_codec import CanCodec
from drivers.can_link import CanLink
from drivers.can_map import Ask, CanMap, SignalName
from drivers.can_plan import CanPlan, Outgoing
from drivers.cycler import Reading
from drivers.errors import CyclerConnectionError, CyclerTimeoutError, SetPointRefusedError
from drivers.rest import POLL_S

UNKNOWN_TOKENS = 256  # before a plan is there


class CanDialogue:
    """Talks to one device.

    Parameters
    ----------
    link : CanLink
    can_map : CanMap
    codec : CanCodec
        Of the map's DBC file.

    Attributes
    ----------
    plan : CanPlan or None
        What the map says with this device's constants put in; set by the owner, who has asked for them.
    """

    def __init__(self, link: CanLink, can_map: CanMap, codec: CanCodec) -> None:
        self._link, self._map, self._codec = link, can_map, codec
        self._token = 0
        self.plan: CanPlan | None = None

    def connected_plan(self) -> CanPlan:
        """Return the plan.

        Raises
        ------
        CyclerConnectionError
            If there is none yet.
        """
        if self.plan is None:
            raise CyclerConnectionError(f"{self._link.address}: not connected")
        return self.plan

    # --- questions -----------------------------------------------------------------------------------------
    async def read(self, signal: SignalName) -> float:
        """Ask for the message that holds a signal; return its physical value."""
        ask = self._map.ask_for(signal.message)
        if ask is not None:
            await self.ask(ask)
        raws = self._codec.raw(signal.message, self._newest(signal.message)[1])
        return self._codec.physical(signal.message, {signal.signal: raws[signal.signal]})[signal.signal]

    async def read_role(self, key: str) -> float:
        """Read a role; NaN where the map has none."""
        role = self._map.roles.get(key)
        if role is None:
            return math.nan
        return await self.read(role.name)

    async def ask(self, ask: Ask) -> None:
        """Ask a question and wait for every part of the answer."""
        self._token = (self._token + 1) % (self.plan.token_modulus if self.plan else UNKNOWN_TOKENS)
        token = self._token
        plan = self.plan or CanPlan(self._map, self._codec, dict.fromkeys(self._map.constants, 1.0))

        def accept(name: str, data: bytes) -> bool:
            signal = self._map.token.get(name)
            return signal is None or self._codec.raw(name, data)[signal] == token

        data = plan.frame(ask.send, {"token": float(token)})
        await self._link.exchange(ask.send.message, data, ask.replies, f"asking for '{ask.name}'", accept)

    async def sample(self, last: int) -> Reading:
        """Make a reading of answers to fresh questions and of the newest cyclic messages.

        `last` is the sequence number of the reading before.
        """
        plan, asked, now_s = self.connected_plan(), set[str](), time.monotonic()
        for name in self._map.sampled:
            ask = self._map.ask_for(name)
            if ask is not None and ask.name not in asked:
                asked.add(ask.name)
                await self.ask(ask)
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
        return plan.reading(oldest_s, last, messages)

    def _newest(self, name: str) -> tuple[float, bytes]:
        try:
            return self._link.newest[name]
        except KeyError:
            raise CyclerTimeoutError(f"{self._link.address}: message '{name}' has not come yet") from None

    # --- commands ------------------------------------------------------------------------------------------
    async def command(self, outgoing: Outgoing) -> None:
        """Send one command and see that the device repeats it.

        Raises
        ------
        SetPointRefusedError
            If the device says no, or repeats something else.
        """
        command, what = outgoing.command, f"command '{outgoing.command.name}'"
        refusals = (self._map.refusal.name.message,) if self._map.refusal else ()
        replies = (command.echo,) if command.echo is not None and command.ask is None else ()
        refused = await self._link.exchange(
            outgoing.message, outgoing.data, replies, what, refusals=refusals if replies else ()
        )
        if refused is not None:
            raise SetPointRefusedError(f"{self._link.address}: {what}: {self._reason(refused)}")
        if command.echo is not None:
            await self._verify_echo(outgoing, command.echo, what, refusals)

    async def asked_difference(self, outgoing: Outgoing) -> str | None:
        """Ask what the device has of a command that it took before; None where it is the same."""
        command = outgoing.command
        if command.ask is None or command.echo is None:
            return None
        await self.ask(self._map.asks[command.ask])
        return self.connected_plan().echoes(outgoing, self._newest(command.echo)[1])

    async def _verify_echo(self, outgoing: Outgoing, echo: str, what: str, refusals: tuple[str, ...]) -> None:
        """See that the echo repeats a command; where it is asked for, until the device has had time to take it."""
        ask = self._map.asks[outgoing.command.ask] if outgoing.command.ask is not None else None
        sent_s = time.monotonic()
        while True:
            if ask is not None:
                await self.ask(ask)
            difference = self.connected_plan().echoes(outgoing, self._newest(echo)[1])
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

    def _reason(self, message: str) -> str:
        refusal = self._map.refusal
        if refusal is None:
            return "refused"
        code = int(self._codec.raw(message, self._newest(message)[1])[refusal.name.signal])
        return f"refused with code {code} ({refusal.reasons.get(code, 'unknown')})"
