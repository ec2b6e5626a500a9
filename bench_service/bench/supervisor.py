"""The API process's side of a bench: starts its control process, talks to it, hears of its death, starts it again."""

import asyncio
import contextlib
import logging
import socket
import subprocess
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from bench_service.bench.acknowledged import Acknowledged
from bench_service.bench.commissioning.call import CommissionCall
from bench_service.bench.commissioning.check import ProofOrder
from bench_service.bench.control_process import end_of, start_control
from bench_service.bench.direct.ticket import StopEndpoint
from bench_service.bench.latch import Latch
from bench_service.bench.links import FrameLink
from bench_service.bench.listener import BenchListener, BenchStatus
from bench_service.bench.messages import EndedMessage, EventMessage
from bench_service.bench.request import RunRequest
from bench_service.bench.settings import BenchSettings
from bench_service.errors import BenchBusyError, BenchOfflineError, ServiceError
from bench_service.framing import Header

_log = logging.getLogger(__name__)
_FIRST_RESTART_S = 0.5
_LAST_RESTART_S = 10.0
# A playing process sends at least a frame a second; the longest pauses are the compilation of an observer before the
# run and the recorder's sealing after it. Silence beyond them means that the process hangs, and the device's watchdog
# has switched the output off long before.
_SILENCE_S = 90.0
_LOOK_S = 1.0
QUIT_S = 55.0  # longer than a run may wait for its recorder's seal


class BenchSupervisor:
    """One bench as the API sees it; all methods belong to one event loop.

    Parameters
    ----------
    settings : BenchSettings
    attach : callable
        Takes the bench's name, gives the recorder a new sample link and returns its other end.
    listener : BenchListener
    stop_endpoint : StopEndpoint or None
        The bench's stop port; None: it has none. Closed with the supervisor.
    """

    def __init__(
        self,
        settings: BenchSettings,
        attach: Callable[[str], socket.socket],
        listener: BenchListener,
        stop_endpoint: StopEndpoint | None = None,
    ) -> None:
        self.stop_endpoint = stop_endpoint
        self._settings = settings
        self._attach = attach
        self._listener = listener
        self._status = BenchStatus("offline", "its control process is not started")
        self._process: subprocess.Popen[bytes] | None = None
        self._link: FrameLink | None = None
        self._run_id: str | None = None
        self._died, self._changed = asyncio.Event(), asyncio.Event()
        self._keeper: asyncio.Task[None] | None = None
        self._closing = False
        self._heard_s = 0.0
        self._commissioning = CommissionCall(settings.name)
        self._acknowledged, self._renewing = Acknowledged(), False

    @property
    def name(self) -> str:
        """The bench's name."""
        return self._settings.name

    @property
    def status(self) -> BenchStatus:
        """The bench's present state."""
        return self._status

    @property
    def pid(self) -> int | None:
        """Process id of the control process, None where there is none."""
        return None if self._process is None else self._process.pid

    async def start(self) -> None:
        """Start the control process and keep one running until `close`."""
        self._keeper = asyncio.create_task(self._keep())

    def start_run(self, request: RunRequest) -> None:
        """Start a run; its end is told to the listener.

        Raises
        ------
        BenchBusyError
            Another run is on the bench, or a fault is latched.
        BenchOfflineError
            No control process or no cycler.
        """
        link = self._ready()
        self._run_id = request.run_id
        self._heard_s = time.monotonic()
        link.send(*request.to_frame())

    def _ready(self) -> FrameLink:
        link, status = self._link, self._status
        if self._run_id is not None:
            raise BenchBusyError(f"bench {self.name!r} is busy with run {self._run_id}; stop it or wait")
        if status.state == "fault":
            raise BenchBusyError(f"bench {self.name!r} has a fault: {status.reason}; acknowledge it first")
        if link is None or status.state == "offline":
            raise BenchOfflineError(f"bench {self.name!r} is offline: {status.reason}; check cycler and link")
        if status.state != "idle":
            raise BenchBusyError(f"bench {self.name!r} is {status.state}; wait until it is idle")
        return link

    async def commission(self, order: ProofOrder) -> dict[str, Any]:
        """Have the bench's hardware looked at, or proved; gives `Report.to_json`, raises as `start_run`."""
        self._ready().send(self._commissioning.begin(order))
        return await self._commissioning.answer()

    def stop(self, reason: str) -> None:
        """Stop the present run, if there is one: rest, output off."""
        if self._link is not None:
            self._link.send({"op": "stop", "reason": reason})

    def hold(self, *, on: bool) -> None:
        """Pause the present run, or let it go on; harmless where there is none."""
        if self._link is not None:
            self._link.send({"op": "pause" if on else "resume"})

    def skip(self) -> None:
        """End the step of a protocol that plays; harmless where there is none."""
        if self._link is not None:
            self._link.send({"op": "skip"})

    def acknowledge(self) -> None:
        """Clear a latched fault; the bench stays in fault where its cause is still there."""
        if self._link is not None:
            self._acknowledged.told(self._status.reason, self._process)
            self._link.send({"op": "acknowledge", "reason": self._status.reason})
        elif self._settings.latched is not None:
            self._settings = replace(self._settings, latched=None)
            self._set_status(BenchStatus("offline", self._status.reason))

    def renew(self, **changes: Any) -> None:
        """Take other settings: the control process brings the cycler to rest and ends, a new one begins with them."""
        self._settings = replace(self._settings, **changes)
        if self._link is not None:
            self._renewing = True
            self._link.send({"op": "quit"})

    async def wait_for(self, *states: str, timeout_s: float) -> BenchStatus:
        """Wait until the bench is in one of `states`.

        Raises
        ------
        TimeoutError
            It is not after `timeout_s`.
        """
        async with asyncio.timeout(timeout_s):
            while self._status.state not in states:
                self._changed.clear()
                await self._changed.wait()
        return self._status

    async def close(self) -> None:
        """End the control process: it stops its run, brings the cycler to rest and says goodbye."""
        self._closing = True
        if self._link is not None:
            self._link.send({"op": "quit"})
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._died.wait(), QUIT_S)
        if self._keeper is not None:
            # With the link gone the keeper ends by itself, after it has seen the process off.
            await asyncio.wait({self._keeper}, timeout=QUIT_S if self._died.is_set() else 0)
            self._keeper.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._keeper
        await self._bury("the service was shut down")
        if self.stop_endpoint is not None:
            self.stop_endpoint.close()

    # --- keeping a process -----------------------------------------------------------------------------------

    async def _keep(self) -> None:
        pause_s, told = _FIRST_RESTART_S, ""
        while not self._closing:
            started_s = time.monotonic()
            try:
                self._spawn()
            except (OSError, ServiceError) as error:
                reason = f"its control process cannot start: {error}"
            else:
                reason = await self._watch()
            renewing, self._renewing = self._renewing, False
            reason = await self._bury("it begins anew, with other limits" if renewing else reason)
            if self._closing:
                return
            if renewing:
                continue
            if time.monotonic() - started_s > _LAST_RESTART_S:
                pause_s, told = _FIRST_RESTART_S, ""
            if reason != told:
                told = reason
                self._tell("error", "control_process", f"bench {self.name!r}: {reason}; starting again")
            await asyncio.sleep(pause_s)
            pause_s = min(_LAST_RESTART_S, 2 * pause_s)

    def _spawn(self) -> None:
        self._died.clear()
        port = self.stop_endpoint
        stop = None if port is None else port.listener
        self._process, ours = start_control(self._settings, self._attach(self.name), stop)
        self._heard_s = time.monotonic()
        self._link = FrameLink(ours, self._received, self._lost)
        if port is not None:
            self._link.send({"op": "stop_port", "token": port.ticket.token, "origins": list(port.origins)})

    async def _watch(self) -> str:
        """Return, when the process is gone or hangs, what happened."""
        while True:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._died.wait(), _LOOK_S)
            if self._died.is_set():
                return "its control process has ended"
            if self._link is not None:
                self._link.send({"op": "lease"})
            silent_s = time.monotonic() - self._heard_s
            if self._run_id is not None and silent_s > _SILENCE_S:
                return f"its control process hangs: silent for {silent_s:.0f} s"

    async def _bury(self, reason: str) -> str:
        """Make sure the process is gone; tell what it left behind."""
        link, process = self._link, self._process
        self._link, self._process = None, None
        if link is not None:
            link.close()
        if process is not None:
            reason = f"{reason} (exit status {await end_of(process)})"
        self._commissioning.lost(reason)
        if self._run_id is not None:
            run_id, self._run_id = self._run_id, None
            # What the cycler went through is unknown; a person or the campaign looks before the next run.
            latch = Latch("interrupted", f"run {run_id} was interrupted: {reason}").over(self._settings.latched)
            self._settings = replace(self._settings, latched=latch)
            counts = {"n_samples": None, "missed_ticks": None, "sha256": None}
            self._listener.on_ended(
                self.name, EndedMessage(run_id=run_id, state="interrupted", reason=reason, **counts)
            )
        if self._settings.latched is not None and not self._closing:
            self._set_status(BenchStatus.in_fault(self._settings.latched))
        else:
            self._set_status(BenchStatus("offline", reason))
        return reason

    # --- what the process says -------------------------------------------------------------------------------

    def _received(self, header: Header, _body: bytes) -> None:
        self._heard_s = time.monotonic()
        try:
            self._pass_on(header)
        except Exception:
            # A listener's defect must not cost the messages that follow.
            _log.exception("bench %s: message %r", self.name, header.get("op"))

    def _pass_on(self, header: Header) -> None:
        message: Any = {name: value for name, value in header.items() if name != "op"}
        match header.get("op"):
            case "live":
                self._listener.on_live(self.name, message)
            case "state":
                self._set_status(BenchStatus(**message))
                if self._acknowledged.unheard(self._status, self._process):
                    self.acknowledge()
            case "commissioned":
                self._commissioning.answered(message["report"])
            case "event":
                if message["code"] in ("acknowledged", "fault_stays"):
                    self._acknowledged.done()
                self._listener.on_event(self.name, message)
            case "ended" if message["run_id"] == self._run_id:
                self._run_id = None
                self._listener.on_ended(self.name, message)

    def _lost(self, _reason: str) -> None:
        self._died.set()

    def _set_status(self, status: BenchStatus) -> None:
        identity = status.identity or self._settings.identity
        self._settings = replace(self._settings, latched=status.latched, identity=identity)
        if status != self._status:
            self._status = status
            self._listener.on_state(self.name, status)
        self._changed.set()

    def _tell(self, severity: str, code: str, text: str) -> None:
        self._listener.on_event(self.name, EventMessage(severity=severity, code=code, text=text, run_id=None))
