import asyncio
import math
import socket
from collections.abc import AsyncIterator
from typing import Any

import numpy as np
import pytest

from bench_service.bench.recording import RecorderError, Recording, queue_rows
from bench_service.framing import Decoder, encode
from bench_service.streams import SAMPLES, STREAMS, unpack
from tests.patience import PATIENCE_S, holds


class FakeRecorder:
    """The other end of the sample link; reads only when told to."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        self.sock = sock
        self.decoder = Decoder()
        self.frames: list[tuple[dict[str, Any], bytes]] = []

    async def read_until(self, operation: str) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE_S):
            while True:
                found = [header for header, _ in self.frames if header["op"] == operation]
                if found:
                    return found[-1]
                data = await asyncio.get_running_loop().sock_recv(self.sock, 1 << 20)
                self.frames += self.decoder.feed(data)

    def say(self, **header: Any) -> None:
        self.sock.sendall(encode(header))

    def times(self) -> list[float]:
        rows = [(h, b) for h, b in self.frames if h["op"] == "rows"]
        assert [h["seq0"] for h, _ in rows] == list(np.cumsum([0, *(h["n"] for h, _ in rows)])[:-1])
        return [t for h, b in rows for t in unpack(STREAMS[SAMPLES], h["n"], b)["time_s"].tolist()]


@pytest.fixture
async def pair() -> AsyncIterator[tuple[Recording, FakeRecorder, list[str]]]:
    ours, theirs = socket.socketpair()
    failures: list[str] = []
    recording, recorder = Recording(ours, failures.append), FakeRecorder(theirs)
    yield recording, recorder, failures
    recording.shut()
    theirs.close()


def row(k: int) -> tuple[float, ...]:
    return (k * 0.1, 1.0, 3.7, 25.0, math.nan, 1.0, k, 0, 0.0, 0, 0)


async def turn() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


def test_the_queue_holds_more_than_30_s() -> None:
    assert queue_rows(0.01, lock_step=False) * 0.01 >= 30
    assert queue_rows(10.0, lock_step=False) * 10.0 >= 30


async def test_rows_arrive_in_order_and_the_run_is_sealed(pair) -> None:
    recording, recorder, failures = pair
    recording.open("r", (SAMPLES,), 10_000)
    for k in range(1000):
        recording.put(SAMPLES, row(k))
    closing = asyncio.create_task(recording.close("completed", None, 5.0))
    close = await recorder.read_until("close")
    assert (close["run_id"], close["state"]) == ("r", "completed")
    assert recorder.times() == [k * 0.1 for k in range(1000)]
    recorder.say(op="sealed", run_id="r", sha256="abc")
    assert await closing == "abc"
    assert failures == []


async def test_a_few_rows_are_sent_without_more_coming(pair) -> None:
    recording, recorder, _ = pair
    recording.open("r", (SAMPLES,), 10)
    recording.put(SAMPLES, row(0))
    assert (await recorder.read_until("rows"))["n"] == 1


async def test_full_until_acknowledged(pair) -> None:
    recording, recorder, _ = pair
    recording.open("r", (SAMPLES,), 600)
    for k in range(600):
        assert not recording.full
        recording.put(SAMPLES, row(k))
    assert recording.full
    waiting = asyncio.create_task(recording.wait_for_room(5.0))
    await turn()
    assert not waiting.done()
    recorder.say(op="ack", run_id="r", stream=SAMPLES, next_seq=256)
    assert await waiting is True
    assert (recording.full, recording.n_acknowledged) == (False, 256)


async def test_waiting_for_room_ends_at_its_time_or_when_the_run_is_stopped(pair) -> None:
    recording, _, _ = pair
    recording.open("r", (SAMPLES,), 1)
    recording.put(SAMPLES, row(0))
    assert await recording.wait_for_room(0.01) is False
    waiting = asyncio.create_task(recording.wait_for_room(5.0))
    await turn()
    recording.wake()
    assert await waiting is True


async def test_a_recorder_that_does_not_read_never_blocks(pair) -> None:
    recording, recorder, _ = pair
    n = 60_000  # far more than a socket buffers
    recording.open("r", (SAMPLES,), n)
    for k in range(n):
        recording.put(SAMPLES, row(k))
    assert recording.full
    closing = asyncio.create_task(recording.close("stopped", "x", 5.0))
    await recorder.read_until("close")
    assert len(recorder.times()) == n
    recorder.say(op="sealed", run_id="r", sha256="s")
    assert await closing == "s"


async def test_a_recorder_that_ends_is_a_failure(pair) -> None:
    recording, recorder, failures = pair
    recording.open("r", (SAMPLES,), 1)
    recording.put(SAMPLES, row(0))
    waiting = asyncio.create_task(recording.wait_for_room(5.0))
    await turn()
    recorder.sock.close()
    with pytest.raises(RecorderError, match="gone"):
        await waiting
    assert len(failures) == 1 and "gone" in failures[0]
    assert await recording.close("fault", "x", 5.0) is None
    with pytest.raises(RecorderError):
        recording.open("again", (SAMPLES,), 1)


async def test_the_recorders_last_words_are_the_reason(pair) -> None:
    recording, recorder, failures = pair
    recording.open("r", (SAMPLES,), 10)
    recorder.say(op="error", reason="disk full")
    recorder.sock.close()
    await turn()
    recording.put(SAMPLES, row(0))
    await holds(lambda: failures, "the batch's time has passed")
    await holds(lambda: len(failures) == 2, "told again once its link is gone, which only a new process gets anew")
    assert failures == ["recorder: disk full"] * 2
