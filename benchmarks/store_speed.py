"""Measures how fast samples are written and read: ``python benchmarks/store_speed.py``."""

import tempfile
import time
from pathlib import Path

import numpy as np

from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.store.samples import FILE, SampleReader
from bench_service.streams import SAMPLES, STREAMS

LAYOUT = STREAMS[SAMPLES]
READ_ROWS = 1_000_000
DT_S = 0.01


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        data_dir = Path(scratch)
        writer = SampleWriter.open(data_dir)
        _write_seconds(writer, channels=1, seconds=200)
        _write_seconds(writer, channels=64, seconds=20)
        size = (data_dir / FILE).stat().st_size
        for seq0 in range(0, READ_ROWS, 10_000):
            writer.commit([_rows("long", seq0, 10_000)])
            writer.seal_due()
        began = time.perf_counter()
        writer.close_run("long", "completed", None)
        print(f"close and hash {READ_ROWS} rows: {time.perf_counter() - began:.2f} s")
        writer.close()
        print(f"sealed: {((data_dir / FILE).stat().st_size - size) / READ_ROWS:.1f} bytes per row, at most")
        reader = SampleReader(data_dir)
        for attempt in ("first", "second"):
            began = time.perf_counter()
            n = reader.read("long").n
            print(f"read {n} rows, {attempt}: {time.perf_counter() - began:.2f} s")
        began = time.perf_counter()
        n = reader.read("long", from_s=5000.0, to_s=5010.0).n
        print(f"read {n} rows out of the middle: {1e3 * (time.perf_counter() - began):.0f} ms")
        reader.close()


def _write_seconds(writer: SampleWriter, channels: int, seconds: int) -> None:
    per_second = round(1 / DT_S)
    batches = [
        [_rows(f"{channels}-{channel}", second * per_second, per_second) for channel in range(channels)]
        for second in range(seconds)
    ]
    took = []
    for batch in batches:
        began = time.perf_counter()
        writer.commit(batch)
        took.append(time.perf_counter() - began)
    rate = channels * per_second * seconds / sum(took)
    p50, p99 = (1e3 * np.quantile(took, q) for q in (0.5, 0.99))
    print(f"{channels} channels x {per_second} rows: {rate:.0f} rows/s, commit p50 {p50:.1f} ms, p99 {p99:.1f} ms")


def _rows(run_id: str, seq0: int, n: int) -> Rows:
    rng = np.random.default_rng(seq0)
    seq = np.arange(seq0, seq0 + n)
    noisy = {
        column.name: (rng.normal(3.7, 0.001, n).round(4) if column.dtype == "f8" else seq).astype(column.numpy)
        for column in LAYOUT
    }
    return Rows(run_id, SAMPLES, seq0, LAYOUT, noisy | {"time_s": seq * DT_S})


if __name__ == "__main__":
    main()
