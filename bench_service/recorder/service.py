"""The recorder's loop: rows in from every bench, one commit a second, acknowledgements out."""

import logging
import selectors
import signal
import socket
import time

from bench_service.errors import StoreError
from bench_service.framing import Frame, FramingError, Header
from bench_service.recorder.buffer import StreamBuffer
from bench_service.recorder.peer import Peer
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import ClosedRun
from bench_service.streams import layout_from_json

MAX_BUFFERED_BYTES = 64 * 2**20
EXIT_DONE = 0
EXIT_WRITE_FAILED = 3
_KILLED = "the control process ended without closing the run"
_LOG = logging.getLogger(__name__)


class ProtocolError(Exception):
    """A bench sent something that makes no sense; its link is given up."""


class BenchLink:
    """A bench's sample link, and the runs open on it."""

    def __init__(self, bench: str, sock: socket.socket) -> None:
        self.bench = bench
        self.peer = Peer(sock)
        self.runs: dict[str, dict[str, StreamBuffer]] = {}

    def buffers(self) -> list[StreamBuffer]:
        """Return the buffers of all open runs."""
        return [buffer for streams in self.runs.values() for buffer in streams.values()]


class Recorder:
    """Serves the lifeline to the API process and the sample links of the benches.

    Parameters
    ----------
    lifeline : socket
        Link to the API process, over which sample links arrive. When it ends, the recorder goes on until every
        sample link is closed.
    writer : SampleWriter
    commit_period_s : float
        Wall time from one commit to the next.
    """

    def __init__(self, lifeline: socket.socket, writer: SampleWriter, commit_period_s: float = 1.0) -> None:
        self._writer = writer
        self._period_s = commit_period_s
        self._lifeline = Peer(lifeline)
        self._ending = False
        self._links: list[BenchLink] = []
        self._buffered = 0
        self._next_commit = time.monotonic() + commit_period_s
        self._selector = selectors.DefaultSelector()
        self._watch(self._lifeline, None)
        self._wake, self._woken = socket.socketpair()

    def run(self) -> int:
        """Serve until there is nothing left to serve; return the exit code of the process."""
        self._catch_signals()
        self._lifeline.send({"op": "ready"})
        try:
            while self._links or not self._ending or self._asked():
                self._turn()
            self._commit()
        except StoreError as error:
            self._fail(error)
            return EXIT_WRITE_FAILED
        self._writer.close()
        return EXIT_DONE

    def _asked(self) -> bool:
        """Whether a bench that was handed over before the order to end has not been taken in yet."""
        if self._lifeline.sock.fileno() < 0:
            return False
        ready = {key.fileobj for key, events in self._selector.select(0) if events & selectors.EVENT_READ}
        return self._lifeline.sock in ready

    def _turn(self) -> None:
        """Wait for something to happen, or for the next commit."""
        now = time.monotonic()
        if self._buffered >= MAX_BUFFERED_BYTES and now < self._next_commit:
            time.sleep(self._next_commit - now)  # the links fill up, and lock-step benches wait
        elif self._buffered == 0 or now < self._next_commit:
            wait_s = None if self._buffered == 0 else self._next_commit - now
            for key, _events in self._selector.select(wait_s):
                self._serve(key)
        if time.monotonic() >= self._next_commit:
            self._commit()

    def _serve(self, key: selectors.SelectorKey) -> None:
        if key.fileobj is self._woken:
            self._woken.recv(64)
            return
        link: BenchLink | None = key.data
        peer = self._lifeline if link is None else link.peer
        if peer.sock.fileno() < 0:
            return  # closed earlier in this turn
        peer.flush()
        try:
            frames = peer.receive()
            if link is None:
                self._serve_lifeline(frames)
            else:
                self._serve_link(link, frames)
        except (FramingError, ProtocolError, ValueError, KeyError, TypeError) as error:
            self._refuse(link, error)
        if peer.sock.fileno() >= 0:
            self._watch(peer, link)

    def _serve_lifeline(self, frames: list[Frame] | None) -> None:
        if frames is None:
            self._end_lifeline()
            return
        for header, _body in frames:
            if header["op"] != "attach" or not self._lifeline.descriptors:
                raise ProtocolError(f"{header['op']!r} without a link, or unknown")
            link = BenchLink(str(header["bench"]), socket.socket(fileno=self._lifeline.descriptors.pop(0)))
            self._links.append(link)
            self._watch(link.peer, link)

    def _serve_link(self, link: BenchLink, frames: list[Frame] | None) -> None:
        if frames is None:
            self._end_link(link, _KILLED)
            return
        for header, body in frames:
            match header["op"]:
                case "rows":
                    self._take_rows(link, header, body)
                case "open":
                    self._open_run(link, header)
                case "close":
                    self._commit()
                    closed = self._close_run(link, header["run_id"], header["state"], header.get("reason"))
                    answer = {"op": "sealed", "run_id": closed.run_id, "sha256": closed.sha256}
                    link.peer.send(answer | {"n_samples": closed.n_samples})
                case other:
                    raise ProtocolError(f"unknown operation {other!r}")

    def _open_run(self, link: BenchLink, header: Header) -> None:
        run_id = str(header["run_id"])
        if any(run_id in other.runs for other in self._links):
            raise ProtocolError(f"run {run_id!r} is open already")
        if self._writer.is_closed(run_id):
            raise ProtocolError(f"run {run_id!r} has been closed; start a new run")
        streams: dict[str, StreamBuffer] = {}
        for stream, columns in header["streams"].items():
            layout = layout_from_json(columns)
            if "time_s" not in {column.name for column in layout}:
                raise ProtocolError(f"stream {stream!r} has no column time_s")
            streams[stream] = StreamBuffer(run_id, stream, layout, self._writer.next_seq(run_id, stream))
        link.runs[run_id] = streams

    def _take_rows(self, link: BenchLink, header: Header, body: bytes) -> None:
        try:
            buffer = link.runs[header["run_id"]][header["stream"]]
        except KeyError as error:
            raise ProtocolError(f"rows for {error}, which is not open") from None
        self._buffered += buffer.add(header["seq0"], header["n"], body)

    def _commit(self) -> None:
        """Store what has come in, then acknowledge it."""
        self._next_commit = time.monotonic() + self._period_s
        if self._buffered == 0:
            return
        taken = [(link, buffer, buffer.take()) for link in self._links for buffer in link.buffers()]
        self._writer.commit([rows for _, _, stretches in taken for rows in stretches])
        self._buffered = 0
        for link, buffer, stretches in taken:
            if stretches:
                ack = {"op": "ack", "run_id": buffer.run_id, "stream": buffer.stream}
                link.peer.send(ack | {"next_seq": buffer.next_seq})
                self._watch(link.peer, link)
        self._writer.seal_due()

    def _close_run(self, link: BenchLink, run_id: str, state: str, reason: str | None) -> ClosedRun:
        if link.runs.pop(run_id, None) is None:
            raise ProtocolError(f"run {run_id!r} is closed but was not open")
        closed = self._writer.close_run(run_id, state, reason)
        self._lifeline_send(
            {
                "op": "sealed",
                "run_id": run_id,
                "state": closed.state,
                "reason": closed.reason,
                "n_samples": closed.n_samples,
                "sha256": closed.sha256,
            }
        )
        return closed

    def _end_link(self, link: BenchLink, reason: str, last: Header | None = None) -> None:
        """Store what came over a link, close its runs as interrupted, and forget it."""
        self._commit()
        for run_id in list(link.runs):
            self._close_run(link, run_id, "interrupted", reason)
        self._selector.unregister(link.peer.sock)
        link.peer.close(last)
        self._links.remove(link)

    def _refuse(self, link: BenchLink | None, error: Exception) -> None:
        reason = f"not understood: {error}"
        if link is None:
            _LOG.error("lifeline %s", reason)
            self._end_lifeline()
        else:
            _LOG.error("bench %s, sample link %s", link.bench, reason)
            self._end_link(link, reason, {"op": "error", "reason": reason})

    def _end_lifeline(self) -> None:
        self._ending = True
        if self._lifeline.sock.fileno() >= 0:
            self._selector.unregister(self._lifeline.sock)
            self._lifeline.close()

    def _lifeline_send(self, header: Header) -> None:
        if self._lifeline.sock.fileno() >= 0:
            self._lifeline.send(header)
            self._watch(self._lifeline, None)

    def _fail(self, error: StoreError) -> None:
        """Tell everybody that nothing more is recorded; never try again (a failed fsync may have lost pages)."""
        _LOG.critical("%s", error.message)
        last = {"op": "error", "reason": error.message}
        for peer in [self._lifeline, *(link.peer for link in self._links)]:
            if peer.sock.fileno() >= 0:
                peer.close(last)

    def _watch(self, peer: Peer, link: BenchLink | None) -> None:
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if peer.wants_to_send else 0)
        known = self._selector.get_map().get(peer.sock)
        if known is None:
            self._selector.register(peer.sock, events, link)
        elif known.events != events:
            self._selector.modify(peer.sock, events, link)

    def _catch_signals(self) -> None:
        """Leave Ctrl-C to the API process; on SIGTERM and SIGHUP end once the benches have closed their links."""
        self._woken.setblocking(False)
        self._wake.setblocking(False)
        self._selector.register(self._woken, selectors.EVENT_READ)
        signal.set_wakeup_fd(self._wake.fileno(), warn_on_full_buffer=False)
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: object) -> None:
        self._ending = True
