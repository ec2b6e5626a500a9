"""The API process's side of the recorder: start it, hand it sample links, hear of its end."""

import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from bench_service.errors import BenchOfflineError, StoreError
from bench_service.framing import Decoder, FramingError, Header, encode, recv_frame

_START_S = 20.0


class RecorderProcess:
    """A running recorder; made by `start`. Methods may be called from several threads."""

    def __init__(self, process: "subprocess.Popen[Any]", lifeline: socket.socket) -> None:
        self._process = process
        self._lifeline = lifeline
        self._decoder = Decoder()
        self._failure: str | None = None
        self._mutex = threading.Lock()

    @classmethod
    def start(
        cls, data_dir: Path, *, commit_period_s: float = 1.0, lock_timeout_s: float = 10.0, **popen: Any
    ) -> "RecorderProcess":
        """Start a recorder and wait until it can take samples.

        Parameters
        ----------
        data_dir : Path
        commit_period_s : float
            Wall time between commits.
        lock_timeout_s : float
            How long to wait for an earlier recorder, whose API process has died, to finish its benches' last rows.
        **popen
            Further arguments of `subprocess.Popen`.

        Raises
        ------
        StoreError
            Another process writes the samples of this directory, or they cannot be opened.
        """
        ours, theirs = socket.socketpair()
        command = [sys.executable, "-m", "bench_service.recorder", "--fd", str(theirs.fileno())]
        command += ["--data", str(data_dir.absolute()), "--commit-period-s", str(commit_period_s)]
        command += ["--lock-timeout-s", str(lock_timeout_s)]
        with theirs:
            # A group of its own: Ctrl-C is for the service, also before the recorder can ignore it.
            process = subprocess.Popen(
                command, pass_fds=(theirs.fileno(),), stdin=subprocess.DEVNULL, process_group=0, **popen
            )
        ours.settimeout(lock_timeout_s + _START_S)
        try:
            frame = recv_frame(ours)
        except (TimeoutError, FramingError, OSError):
            frame = None
        if frame is None or frame[0].get("op") != "ready":
            ours.close()
            process.kill()
            process.wait()
            reason = "it ended without a word" if frame is None else frame[0].get("reason")
            raise StoreError(f"the recorder did not start: {reason}")
        ours.settimeout(None)
        return cls(process, ours)

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def failure(self) -> str | None:
        """Why the recorder can record no more, or None; after `messages` or `is_alive` have looked."""
        return self._failure

    def fileno(self) -> int:
        """Return the lifeline's descriptor; when it is readable, call `messages`."""
        return self._lifeline.fileno()

    def attach(self, bench: str) -> socket.socket:
        """Give the recorder one end of a new sample link; return the other, for the control process of `bench`.

        The caller closes the returned socket once the control process has inherited it.

        Raises
        ------
        BenchOfflineError
            The recorder is gone.
        """
        ours, theirs = socket.socketpair()
        with theirs, self._mutex:
            try:
                socket.send_fds(self._lifeline, [encode({"op": "attach", "bench": bench})], [theirs.fileno()])
            except OSError as error:
                ours.close()
                reason = self._failure or "the recorder process is gone"
                raise BenchOfflineError(f"bench {bench!r} cannot record: {reason}") from error
        return ours

    def messages(self) -> list[Header]:
        """Return, without waiting, what the recorder has said since the last call.

        ``{"op":"sealed","run_id","state","reason","n_samples","sha256"}`` for each run that ended, also where its
        control process was killed; ``{"op":"error","reason"}`` when nothing more can be recorded.
        """
        found: list[Header] = []
        with self._mutex:
            while data := self._receive():
                found += [header for header, _body in self._decoder.feed(data)]
        for message in found:
            if message.get("op") == "error":
                self._failure = str(message.get("reason"))
        return found

    def is_alive(self) -> bool:
        """Return whether the process runs."""
        return self._process.poll() is None

    def stop(self, timeout_s: float = 10.0) -> bool:
        """Close the lifeline and wait for the end; the control processes must have closed their links before.

        Returns
        -------
        bool
            Whether it has ended; one that has not still serves a bench, and ends by itself after it.
        """
        with self._mutex:
            self._lifeline.close()
        try:
            self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return False
        return True

    def kill(self) -> None:
        """Kill the process (SIGKILL): what it has acknowledged is stored."""
        self._process.kill()
        self._process.wait()
        self._lifeline.close()

    def _receive(self) -> bytes:
        if self._lifeline.fileno() < 0:
            return b""
        try:
            return self._lifeline.recv(2**16, socket.MSG_DONTWAIT)
        except OSError:
            return b""
