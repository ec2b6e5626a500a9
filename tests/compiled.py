"""Compiles once, before the tests begin, what numba compiles: `python -m tests.compiled`.

A fresh clone has nothing compiled yet, and test processes that begin side by side would each translate the same
functions. What was compiled is kept in a folder whose name stands for the source: a second call returns at once.
"""

import contextlib
import io
import os
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import models  # noqa: F401 - names numba's folder
from bench_service.cli.main import main

Command = tuple[str, ...]
_DONE = "compiled-for-tests"
_REQUEST = """
model = "{model}"
capacity_Ah = 2.5
initial_soc = 0.6
duration_s = 300
dt_s = 1.0
criterion = "D"

[limits]
current_A = [-5.0, 2.5]
voltage_V = [2.8, 4.2]
soc = [0.3, 0.8]
"""


def compiled(folder: Path) -> None:
    """Walk the product's path once on a small simulated cell, through its commands, on two processors."""
    from simulators.catalogue import CELLS
    from simulators.cell import Cell
    from tests.unit.models.simulated_cells import AMBIENT_DEGC, pulses_A, record

    cell = CELLS["nmc"].parameters
    for seed in (1, 2):
        series = record(Cell(cell, 0.6, AMBIENT_DEGC), pulses_A(1600, cell.capacity_Ah, seed), seed)
        columns = zip(series.time_s, series.current_A, series.voltage_V, series.temperature_degC, strict=True)
        lines = [f"{t:.0f},{i:.6f},{v:.6f},{c:.4f},{AMBIENT_DEGC}" for t, i, v, c in columns]
        text = "\n".join(["time_s,current_A,voltage_V,temperature_degC,ambient_degC", *lines])
        (folder / f"{seed}.csv").write_text(text, encoding="utf-8")
    train, other, small, bounded = (str(folder / name) for name in ("1.csv", "2.csv", "small.json", "bounded.json"))
    soc, capacity = ("--initial-soc", "0.6"), ("--capacity-Ah", str(cell.capacity_Ah))
    (folder / "request.toml").write_text(_REQUEST.format(model=small), encoding="utf-8")
    fitting: list[Command] = [
        ("fit", train, *capacity, *soc, "--structure", "bounded", "--out", bounded),
        ("diagnose", bounded, other, *soc, "--mode", "change"),
        ("observe", bounded, other, *soc),
    ]
    observing: list[Command] = [
        ("fit", train, *capacity, *soc, "--structure", "minimal", "--out", small),
        ("observe", small, other, *soc),
        ("design", str(folder / "request.toml"), "--out", str(folder / "profile.csv")),
    ]
    with ProcessPoolExecutor(2, get_context("spawn")) as processors:
        list(processors.map(_walk, (fitting, observing)))


def _walk(commands: list[Command]) -> None:
    for command in commands:
        with contextlib.redirect_stdout(io.StringIO()):
            status = main([*command, "--json"])
        if status:
            raise RuntimeError(f"{' '.join(command)}: status {status}")


def once() -> None:
    """Compile unless it has been done for this state of the source."""
    folder = os.environ.get("NUMBA_CACHE_DIR")
    done = Path(folder, _DONE) if folder else None
    if done is not None and done.exists():
        return
    print("compiling what the tests share ...", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        compiled(Path(scratch))
    if done is not None:
        done.touch()


if __name__ == "__main__":
    sys.exit(once())
