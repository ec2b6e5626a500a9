"""The control process: owns the cycler, obeys the API, and is safe without either.

States: `offline` (no cycler), `idle`, `running`, `paused`, `stopping`, `fault` (latched until acknowledged).
Reconnecting identifies the device, makes it safe and never resumes a run.
"""

import asyncio
import socket
from collections import deque
from typing import Any, Literal

from bench_service.bench.admission import RefusedError
from bench_service.bench.chamber.keeper import ChamberKeeper
from bench_service.bench.commissioning.chamber import with_chamber
from bench_service.bench.commissioning.check import ProofOrder, Report
from bench_service.bench.commissioning.commissioner import commission
from bench_service.bench.cycler_keeper import OTHER_DEVICE, CyclerKeeper
from bench_service.bench.direct.messages import Guard, Order
from bench_service.bench.direct.orders import DirectOrders
from bench_service.bench.idle import IdleWatch
from bench_service.bench.latch import NOT_STORED, Latch
from bench_service.bench.lease import Lease
from bench_service.bench.links import FrameLink
from bench_service.bench.live import LiveFeed
from bench_service.bench.messages import STOP_ASKED
from bench_service.bench.pause import PauseSwitch
from bench_service.bench.recording import RecorderError, Recording
from bench_service.bench.reporting import Reporter
from bench_service.bench.request import RunRequest
from bench_service.bench.rest import uncancelled, woken
from bench_service.bench.run import RunEnd, RunParts
from bench_service.bench.run_loop import RunLoop
from bench_service.bench.run_setup import PreparedRun, prepare
from bench_service.bench.settings import BenchSettings
from bench_service.bench.stop import StopSignal, StopState
from bench_service.framing import Frame, Header
from drivers.cycler import Cycler

_IDLE_PERIOD_S = 0.5
_SAY_GOODBYE_S = 2.0
_NO_RUN = ""  # in place of a run's id while the bench is commissioned: it is busy, and nobody keeps that as a run


class BenchControl:
    """State machine of one bench.

    Parameters
    ----------
    settings : BenchSettings
    command_sock, sample_sock : socket.socket
        Links to the API and to the recorder.
    stop_sock : socket.socket or None
        Listens for stop and acknowledge from whoever has the token, which the API sends.
    """

    def __init__(
        self, settings: BenchSettings, command_sock: Any, sample_sock: Any, stop_sock: socket.socket | None = None
    ) -> None:
        self._settings = settings
        self._link = FrameLink(command_sock, self._commanded, self._orphaned)
        self._report = Reporter(self._link)
        self._lease = Lease(self._forsaken, settings.lease_s)
        self._direct = DirectOrders(stop_sock, self._obey_direct)
        self._recording = Recording(sample_sock, self._recorder_failed)
        self._keeper = CyclerKeeper(settings, self._device_changed)
        self._chamber = ChamberKeeper(settings, self._device_changed)
        self._feed = LiveFeed(self._link, more=self._chamber.live)
        self._latched, self._idle = settings.latched, IdleWatch(settings)
        self._commands, self._wake = deque[Frame](), asyncio.Event()
        self._quit: str | None = None
        self._run_id: str | None = None
        self._finish_alone = False
        self._stop, self._pause = StopSignal(), PauseSwitch()

    async def serve(self) -> None:
        """Work until told to quit, orphaned or without a recorder; always leaves the cycler at rest."""
        try:
            self._tell_state()
            self._lease.watch()
            self._chamber.start()
            while self._quit is None:
                await self._turn()
        finally:
            await uncancelled(self._leave())

    def quit(self, state: StopState, reason: str) -> None:
        """End the run, if there is one, and then the process."""
        self._quit = self._quit or reason
        self._stop.give(state, reason)
        self._wake.set()

    async def _turn(self) -> None:
        if self._keeper.cycler is None:
            await self._keeper.connect()
        if self._quit is None and not self._commands:
            await woken(self._wake, self._keeper.retry_s if self._keeper.cycler is None else _IDLE_PERIOD_S)
            self._wake.clear()
        if self._quit is None and self._commands:
            await self._obey(*self._commands.popleft())
        elif self._quit is None:
            await self._idle_sample()

    # --- what comes in -------------------------------------------------------------------------------------

    def _commanded(self, header: Header, body: bytes) -> None:
        self._lease.renew()
        operation = header.get("op")
        if operation == "stop":
            self._stop_run(str(header.get("reason") or "stopped"))
        elif operation == "quit":
            self.quit("stopped", "the service was shut down")
        elif operation == "stop_port":
            self._direct.open(Guard(str(header["token"]), tuple(header["origins"])))
        elif operation in ("pause", "resume", "skip"):
            self._pause.take(operation)
        elif operation != "lease":
            self._commands.append((header, body))
            self._wake.set()

    def _stop_run(self, reason: str) -> None:
        for waiting, _ in self._commands:
            waiting["stopped"] = reason  # a run that has not begun: it ends before its first tick
        if self._run_id is not None and self._stop.order is None:
            self._stop.give("stopped", reason)
            self._tell_state()

    def _orphaned(self, reason: str) -> None:
        if self._run_id is not None and self._finish_alone:
            self._quit = self._quit or reason  # after the run
        else:
            self.quit("interrupted", f"the service is gone ({reason})")

    def _forsaken(self, silent_s: float) -> None:
        """End a run that nobody can see; one that was declared to finish alone goes on."""
        if self._run_id is not None and not self._finish_alone and self._stop.order is None:
            self._stop.give("interrupted", f"the service has been silent for {silent_s:.0f} s; output switched off")
            self._tell_state()

    def _obey_direct(self, order: Order) -> dict[str, Any]:
        if order.operation == "stop":
            self._link.look()  # a start that has been sent is meant too; one that is not yet, the service stops
            reason = order.reason or "stopped past the service"
            self._event("info", STOP_ASKED, reason)
            self._stop_run(reason)
        elif order.operation == "acknowledge" and self._run_id is None and self._latched is not None:
            # What is there now is acknowledged, not what a run may end with.
            self._commands.append(({"op": "acknowledge", "reason": self._latched.text}, b""))
            self._wake.set()
        return {"bench": self._settings.name, "state": self.state, "run_id": self._run_id or None}

    def _recorder_failed(self, reason: str) -> None:
        self._stop.give("fault", f"{self._settings.name}: {reason}; {NOT_STORED}, output switched off")
        if not self._recording.is_open:
            # A new recorder needs a new link, which only a new process gets.
            self._quit = self._quit or reason
            self._wake.set()

    async def _obey(self, header: Header, body: bytes) -> None:
        operation = header.get("op")
        if operation == "start":
            await self._start(header, body)
        elif operation == "acknowledge":
            await self._acknowledge(header.get("reason"))
        elif operation == "commission":
            await self._commission(header)
        else:
            self._event("warning", "unknown_command", f"unknown command {operation!r} ignored")

    async def _idle_sample(self) -> None:
        for notice in await self._idle.sample(self._keeper, self._feed, self._chamber.around):
            self._latch(Latch("at_rest", notice.text) if notice.latch else None)
            self._event("error" if notice.latch else "warning", notice.code, notice.text)
            self._tell_state()

    async def _acknowledge(self, reason: str | None) -> None:
        if self._latched is not None and reason not in (None, self._latched.text):
            text = f"not acknowledged, for another fault has come since: {self._latched.text}"
            self._event("warning", "fault_stays", f"{self._settings.name}: {text}")
            return
        self._chamber.clear()
        if (stays := await self._keeper.clear_fault()) is not None:
            self._event("error", "fault_stays", f"{self._settings.name}: the fault stays: {stays}")
            self._tell_state()
            return
        if self._latched is not None:
            self._event("info", "acknowledged", f"acknowledged: {self._latched.text}")
        self._latched = None
        self._idle.forget()
        self._tell_state()

    async def _start(self, header: Header, body: bytes) -> None:
        run_id = str(header.get("run_id"))
        self._stop, self._pause = StopSignal(), PauseSwitch(self._tell_state)
        if "stopped" in header:
            self._stop.give("stopped", header["stopped"])
        try:
            request = RunRequest.from_frame(header, body)
            cycler, capabilities = self._keeper.ready(self._latched)
            self._run_id, self._finish_alone = run_id, request.finish_alone
            self._tell_state()
            await self._chamber.ready()
            prepared = await prepare(self._settings, capabilities, request)
            self._recording.open(run_id, prepared.streams, prepared.queue_rows)
        except (RefusedError, RecorderError, ValueError) as error:
            self._refuse(run_id, f"{self._settings.name}: run refused: {error}")
            return
        await self._finish(run_id, await self._play(cycler, prepared))

    async def _commission(self, header: Header) -> None:
        self._stop, self._finish_alone = StopSignal(), False
        try:
            order, device = ProofOrder.from_json(header["order"]), self._keeper.ready(self._latched)
        except (RefusedError, ValueError) as error:
            self._report.commissioned(Report("refused", str(error)))
            return
        self._run_id = _NO_RUN
        self._tell_state()
        report = await commission(self._settings, device, order, (self._feed, self._stop, self._event))
        report = await with_chamber(report, self._chamber)
        self._latch(report.latch)
        if order.prove:
            await self._keeper.release()
        self._run_id = None
        self._idle.forget()
        self._tell_state()  # first: who hears the report may start a run at once
        self._report.commissioned(report)

    async def _play(self, cycler: Cycler, prepared: PreparedRun) -> RunEnd:
        # An order that came meanwhile holds: the loop then ends before it takes the cycler.
        self._stop.on_order(prepared.clock.interrupt, self._recording.wake)
        for severity, code, text in prepared.notes:
            self._event(severity, code, text)
        self._feed.restart()
        shared = (prepared.clock, self._recording, self._feed, self._stop, prepared.observer, self._event)
        parts = RunParts(cycler, *shared, self._pause, self._chamber)
        with prepared.environment(self._event):
            return await RunLoop(prepared.plan, parts).play()

    def _refuse(self, run_id: str, text: str) -> None:
        self._run_id = None
        self._event("error", "refused", text, run_id)
        self._tell_state()
        self._report.refused(run_id, text)

    async def _finish(self, run_id: str, end: RunEnd) -> None:
        self._latch(end.latch)
        if end.state == "fault":
            self._event("error", end.code, end.reason or end.code, run_id)
        self._stop.give("stopped", "the run has ended")
        self._tell_state()
        n_samples, sha256, unsealed = await self._recording.seal(end.state, end.reason)
        if unsealed is not None:
            self._event("error", "not_sealed", f"{self._settings.name}: {unsealed}", run_id)
            end = end.stored(n_samples, self._recording.n_rows, f"{self._settings.name}: {unsealed}")
            self._latch(end.latch)
        if not end.at_rest:
            await self._keeper.disconnect("the cycler did not confirm rest after the run")
        else:
            await self._keeper.release()
        self._run_id = None
        self._idle.forget()
        self._tell_state()  # first: who hears of the end may start the next run at once
        self._report.ended(run_id, end, n_samples, sha256)

    async def _leave(self) -> None:
        await self._keeper.leave()
        await self._chamber.leave()
        self._lease.close()
        self._direct.close()
        self._recording.shut()
        await self._link.drain(_SAY_GOODBYE_S)
        self._link.close()

    @property
    def state(self) -> Literal["offline", "idle", "running", "paused", "stopping", "fault"]:
        """Present state; a latched fault hides whether the cycler is there."""
        if self._run_id is not None:
            playing = "paused" if self._pause.active else "running"
            return playing if self._stop.order is None else "stopping"
        if self._latched is not None:
            return "fault"
        return "offline" if self._keeper.cycler is None else "idle"

    def _device_changed(self, severity: str, code: str, text: str) -> None:
        self._latch(Latch(code, text) if code == OTHER_DEVICE else None)
        self._event(severity, code, text)
        self._tell_state()

    def _latch(self, latch: Latch | None) -> None:
        self._latched = self._latched if latch is None else latch.over(self._latched)

    def _tell_state(self) -> None:
        reason = self._keeper.offline_reason if self._latched is None else self._latched.text
        if self._run_id is not None:
            reason = None if self._stop.order is None else self._stop.order.reason
        more = self._chamber.to_json(), self._latched
        self._report.state(self.state, reason, self._run_id or None, self._keeper.capabilities, *more)

    def _event(self, severity: str, code: str, text: str, run_id: str | None = None) -> None:
        self._report.event(severity, code, text, run_id or self._run_id or None)
