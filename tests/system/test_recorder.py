import os
import random
import re
import resource
import signal
import sqlite3
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from recorder_rig import Bench, check_rows, stored

from bench_service.errors import BenchOfflineError, StoreError
from bench_service.framing import send_frame
from bench_service.recorder.client import RecorderProcess
from bench_service.store.samples import SampleReader
from bench_service.streams import OBSERVER, SAMPLES
from tests.patience import wait_for

PERIOD_S = 0.05  # so that a test need not wait seconds for its commits


@pytest.fixture
def start(tmp_path) -> Iterator[Callable[..., RecorderProcess]]:
    started: list[RecorderProcess] = []

    def starter(data: Path = tmp_path, **options: object) -> RecorderProcess:
        started.append(RecorderProcess.start(data, **{"commit_period_s": PERIOD_S, **options}))
        return started[-1]

    yield starter
    for recorder in started:
        recorder.kill()


@pytest.fixture
def attach() -> Iterator[Callable[..., Bench]]:
    benches: list[Bench] = []

    def attacher(recorder: RecorderProcess, name: str = "sim") -> Bench:
        benches.append(Bench(recorder.attach(name)))
        return benches[-1]

    yield attacher
    for bench in benches:
        bench.link.close()


def test_rows_of_two_benches_and_streams_are_stored_and_sealed(start, attach, tmp_path):
    recorder = start()
    a, b = attach(recorder, "a"), attach(recorder, "b")
    for bench, run in ((a, "run-a"), (b, "run-b")):
        bench.open(run)
        for seq0 in range(0, 500, 50):
            bench.rows(run, seq0, 50)
            bench.rows(run, seq0, 50, OBSERVER)
        bench.wait_ack(run, 500)
        bench.wait_ack(run, 500, OBSERVER)
    before = stored(tmp_path, "run-a")
    sealed = a.close("run-a")
    after = stored(tmp_path, "run-a")
    for data in (before, after):
        check_rows(data, SAMPLES, np.arange(500))
        assert data.gaps == ()
    check_rows(stored(tmp_path, "run-a", OBSERVER), OBSERVER, np.arange(500))
    with closing(SampleReader(tmp_path)) as reader:
        assert reader.content_hash("run-a") == sealed["sha256"] == reader.content_hash("run-b")
        assert sealed["n_samples"] == reader.n_rows("run-a") == 500
        assert reader.closed("run-b") is None
    with closing(sqlite3.connect(f"file:{tmp_path}/samples.sqlite?mode=ro", uri=True)) as link:
        query = "SELECT count(*), max(sealed) FROM chunk WHERE run_id = 'run-a' GROUP BY stream"
        assert link.execute(query).fetchall() == [(1, 1), (1, 1)]
    b.close("run-b", "stopped", "operator")
    a.link.close()
    b.link.close()
    assert recorder.stop()
    assert [m["run_id"] for m in recorder.messages()] in ([], ["run-a", "run-b"])
    with closing(SampleReader(tmp_path)) as reader:
        end = reader.closed("run-b")
        assert end is not None
        assert (end.state, end.reason, end.n_samples) == ("stopped", "operator", 500)


def test_a_time_range_is_read_from_sealed_and_fresh_chunks_alike(start, attach, tmp_path):
    bench = attach(start())
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 100_000)
    bench.wait_ack("run", 100_000)  # as many as a sealed chunk takes
    bench.rows("run", 100_000, 300)
    bench.wait_ack("run", 100_300)

    def sealed() -> list[tuple[int, int]]:
        with closing(sqlite3.connect(f"file:{tmp_path}/samples.sqlite?mode=ro", uri=True)) as link:
            return link.execute("SELECT sealed, sum(n) FROM chunk GROUP BY sealed ORDER BY sealed").fetchall()

    wait_for(lambda: sealed() == [(0, 300), (1, 100_000)], "what is whole is sealed")
    with closing(SampleReader(tmp_path)) as reader:
        data = reader.read("run", SAMPLES, from_s=999.5, to_s=1001.0)
        check_rows(data, SAMPLES, np.arange(99_950, 100_101))
        assert data.gaps == ()
        assert reader.read("run", SAMPLES, from_s=5000.0).n == 0


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.proof)])
def test_acknowledged_rows_survive_kill_9(start, attach, tmp_path, kills):
    rng = random.Random(5)
    for kill in range(kills):
        recorder = start()
        bench = attach(recorder)
        run = f"run-{kill}"
        bench.open(run, SAMPLES)
        moment = time.monotonic() + 3 * PERIOD_S + rng.uniform(0, 2 * PERIOD_S)
        sent = 0
        while time.monotonic() < moment or (run, SAMPLES) not in bench.acked:
            bench.rows(run, sent, 40)
            sent += 40
            bench.hear_what_is_there()
        os.kill(recorder.pid, signal.SIGKILL)
        while not bench.at_end:
            bench.hear()
        acked = bench.acked[run, SAMPLES]
        assert 0 < acked <= sent
        data = stored(tmp_path, run)
        assert data.n >= acked
        check_rows(data, SAMPLES, np.arange(data.n))
        assert not recorder.is_alive() or recorder.stop()


def test_a_run_goes_on_in_a_new_recorder_and_repeated_rows_count_once(start, attach, tmp_path):
    first = start()
    bench = attach(first)
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 100)
    bench.wait_ack("run", 100)
    first.kill()
    bench = attach(start())
    bench.open("run", SAMPLES)
    bench.rows("run", 60, 100)
    bench.rows("run", 0, 60)
    sealed = bench.close("run")
    data = stored(tmp_path, "run")
    check_rows(data, SAMPLES, np.arange(160))
    assert (data.gaps, sealed["n_samples"]) == ((), 160)


def test_gaps_are_seen_before_and_after_sealing(start, attach, tmp_path):
    bench = attach(start())
    bench.open("run", SAMPLES)
    bench.rows("run", 10, 10)
    bench.rows("run", 50, 20)
    bench.wait_ack("run", 70)
    expected = np.r_[10:20, 50:70]
    before = stored(tmp_path, "run")
    bench.close("run")
    for data in (before, stored(tmp_path, "run")):
        check_rows(data, SAMPLES, expected)
        assert [(gap.seq0, gap.n, gap.reason) for gap in data.gaps] == [(0, 10, "missing"), (20, 30, "missing")]
        assert not data.damaged


def test_a_damaged_chunk_is_named_and_the_rest_is_read(start, attach, tmp_path):
    recorder = start()
    bench = attach(recorder)
    bench.open("run", SAMPLES)
    for seq0 in (0, 10, 20):
        bench.rows("run", seq0, 10)
        bench.wait_ack("run", seq0 + 10)
    recorder.kill()
    with closing(sqlite3.connect(tmp_path / "samples.sqlite")) as link:
        key, data = link.execute("SELECT id, data FROM chunk WHERE seq0 = 10").fetchone()
        flipped = data[:30] + bytes([data[30] ^ 4]) + data[31:]
        link.execute("UPDATE chunk SET data = ? WHERE id = ?", (flipped, key))
        link.commit()
    read = stored(tmp_path, "run")
    check_rows(read, SAMPLES, np.r_[0:10, 20:30])
    (gap,) = read.gaps
    assert (gap.seq0, gap.n) == (10, 10)
    assert f"run run, stream samples, chunk {key} (rows 10 to 19): wrong checksum" in gap.reason
    with closing(SampleReader(tmp_path)) as reader, pytest.raises(StoreError, match="no content hash"):
        reader.content_hash("run")
    bench = attach(start())
    bench.open("run", SAMPLES)
    sealed = bench.close("run")
    assert (sealed["sha256"], sealed["n_samples"]) == (None, 30)
    check_rows(stored(tmp_path, "run"), SAMPLES, np.r_[0:10, 20:30])


def test_reading_while_writing_sees_a_whole_beginning(start, attach, tmp_path):
    bench = attach(start())
    bench.open("run", SAMPLES)
    seen = [0]
    with closing(SampleReader(tmp_path)) as reader:
        sent = 0
        while len(set(seen)) < 6:
            bench.rows("run", sent, 100)
            sent += 100
            bench.hear_what_is_there()
            acked = bench.acked.get(("run", SAMPLES), 0)
            data = reader.read("run")
            assert data.n >= acked
            assert data.gaps == ()
            if data.n:
                check_rows(data, SAMPLES, np.arange(data.n))
            seen.append(data.n)
            assert sent < 10_000_000, "nothing is committed"
    assert seen == sorted(seen)


def test_a_second_recorder_is_refused(start):
    recorder = start()
    with pytest.raises(StoreError, match=f"samples.sqlite is being written by process {recorder.pid}"):
        start(lock_timeout_s=0.0)
    assert recorder.is_alive()


def test_a_full_disk_is_reported_and_what_was_acknowledged_is_there(start, attach, tmp_path):
    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

    recorder = start(preexec_fn=small_files, stderr=subprocess.PIPE)
    bench, other = attach(recorder), attach(recorder, "other")
    bench.open("run", SAMPLES)
    sent = 0
    try:
        while not bench.at_end:
            bench.rows("run", sent, 200)
            sent += 200
            bench.hear_what_is_there()
            assert sent < 1_000_000, "the limit does not bite"
    except OSError:
        while not bench.at_end:
            bench.hear()
    assert bench.error is not None
    # Whatever was to be written when the room ended: rows, or the sealing of those before.
    assert re.search("cannot (store|seal) samples", bench.error)
    assert "nothing more is recorded" in bench.error
    while not other.at_end:
        other.hear()
    assert other.error == bench.error
    wait_for(lambda: not recorder.is_alive(), "the recorder has ended")
    recorder.messages()
    assert recorder.failure == bench.error
    with pytest.raises(BenchOfflineError, match="cannot (store|seal) samples"):
        recorder.attach("third")
    assert recorder._process.stderr is not None
    with recorder._process.stderr as errors:
        assert bench.error.encode() in errors.read()
    acked = bench.acked["run", SAMPLES]
    data = stored(tmp_path, "run")
    assert data.n >= acked > 0
    check_rows(data, SAMPLES, np.arange(data.n))
    bench = attach(start())  # once there is room again
    bench.open("run", SAMPLES)
    assert bench.close("run")["n_samples"] >= acked


def test_the_recorder_outlives_the_api_until_the_benches_are_done(start, attach, tmp_path):
    recorder = start(commit_period_s=30.0)
    bench = attach(recorder)
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 100)
    assert not recorder.stop(timeout_s=0.3)
    bench.rows("run", 100, 100)
    sealed = bench.close("run", "interrupted", "orphaned")
    assert recorder.is_alive()
    with pytest.raises(StoreError, match="is being written"):
        start(lock_timeout_s=0.0, stderr=subprocess.DEVNULL)
    bench.link.close()
    successor = start()  # waits for the first to go
    wait_for(lambda: not recorder.is_alive(), "the recorder has ended")
    assert successor.is_alive()
    check_rows(stored(tmp_path, "run"), SAMPLES, np.arange(200))
    with closing(SampleReader(tmp_path)) as reader:
        end = reader.closed("run")
        assert end is not None
        assert (end.state, end.reason, end.sha256) == ("interrupted", "orphaned", sealed["sha256"])


def test_a_closed_run_takes_no_more_rows(start, attach, tmp_path):
    recorder = start(stderr=subprocess.DEVNULL)
    bench = attach(recorder)
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 10)
    bench.close("run")
    bench.open("run", SAMPLES)
    while not bench.at_end:
        bench.hear()
    assert bench.error is not None
    assert "'run' has been closed" in bench.error
    assert stored(tmp_path, "run").n == 10


def test_what_a_killed_bench_has_sent_is_stored(start, attach, tmp_path):
    recorder = start(commit_period_s=30.0)
    bench = attach(recorder)
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 120)
    bench.link.close()
    messages: list[dict] = []

    def sealed() -> bool:
        messages.extend(recorder.messages())
        return bool(messages)

    wait_for(sealed, "sealed")
    assert (messages[0]["run_id"], messages[0]["state"], messages[0]["n_samples"]) == ("run", "interrupted", 120)
    check_rows(stored(tmp_path, "run"), SAMPLES, np.arange(120))
    with closing(SampleReader(tmp_path)) as reader:
        assert reader.content_hash("run") == messages[0]["sha256"]


def test_signals_leave_a_running_bench_its_recorder(start, attach, tmp_path):
    recorder = start()
    bench = attach(recorder)
    bench.open("run", SAMPLES)
    os.kill(recorder.pid, signal.SIGINT)
    os.kill(recorder.pid, signal.SIGTERM)
    bench.rows("run", 0, 50)
    bench.wait_ack("run", 50)
    bench.close("run")
    assert recorder.is_alive()
    bench.link.close()
    wait_for(lambda: not recorder.is_alive(), "the recorder has ended")
    check_rows(stored(tmp_path, "run"), SAMPLES, np.arange(50))


def test_a_bench_handed_over_just_before_the_order_to_end_is_served(start, attach, tmp_path):
    recorder = start()
    os.kill(recorder.pid, signal.SIGSTOP)  # both are there when it looks again; the signal is seen first
    bench = attach(recorder)
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 50)
    os.kill(recorder.pid, signal.SIGTERM)
    os.kill(recorder.pid, signal.SIGCONT)
    bench.wait_ack("run", 50)
    bench.close("run")
    bench.link.close()
    wait_for(lambda: not recorder.is_alive(), "the recorder has ended")
    check_rows(stored(tmp_path, "run"), SAMPLES, np.arange(50))


@pytest.mark.parametrize(
    ("header", "body", "reason"),
    [
        ({"op": "rows", "run_id": "other", "stream": SAMPLES, "seq0": 0, "n": 0}, b"", "not open"),
        ({"op": "rows", "run_id": "run", "stream": SAMPLES, "seq0": 50, "n": 3}, b"short", "bytes are not 3 rows"),
        ({"op": "open", "run_id": "run", "streams": {}}, b"", "open already"),
        ({"op": "dance"}, b"", "unknown operation 'dance'"),
        ({"no": "op"}, b"", "'op'"),
    ],
)
def test_a_bench_that_talks_nonsense_loses_its_link_but_no_rows(start, attach, tmp_path, header, body, reason):
    recorder = start(stderr=subprocess.DEVNULL)
    bench, other = attach(recorder), attach(recorder, "other")
    bench.open("run", SAMPLES)
    bench.rows("run", 0, 50)
    send_frame(bench.link, header, body)
    while not bench.at_end:
        bench.hear()
    assert bench.error is not None
    assert reason in bench.error
    check_rows(stored(tmp_path, "run"), SAMPLES, np.arange(50))
    other.open("healthy", SAMPLES)
    other.rows("healthy", 0, 10)
    assert other.close("healthy")["n_samples"] == 10


def test_a_data_directory_that_cannot_be_made_is_named(start, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="cannot create"):
        start(tmp_path / "file" / "data", stderr=subprocess.DEVNULL)


def test_an_empty_store_reads_as_empty(tmp_path):
    with closing(SampleReader(tmp_path)) as reader:
        data = reader.read("run")
        assert (data.n, data.gaps, reader.n_rows("run"), reader.closed("run")) == (0, (), 0, None)
