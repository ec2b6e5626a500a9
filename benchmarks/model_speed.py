"""Speed and memory of the cell model on one BLAS thread, each figure beside its bar.

``python benchmarks/model_speed.py [--only NAME...] [--samples 100000] [--json]``

The figures: `free_run` (24 local models, validity functions included), `construction` (LOLIMOT to 24 local models),
`search` (the whole search over structures, construction included), `refinement` (on the free run, strength of its
regularisation included), `update` (one recursive update of a live network), `long_run` (peak memory of a process that
simulates 1e7 samples) and `linear` (time per sample at 1e5 to 1.6e6 samples). Compilation is no part of any figure:
each task runs once on a short piece first. Seconds are those of the processor, all on one thread, which other work on
the machine changes little. The runs are those of a simulated cell, from multi-level steps.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from simulated_cells import INITIAL_SOC, simulated_run
from threadpoolctl import threadpool_limits

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray
from models.identification.lolimot import LocalFit, construct
from models.identification.refinement import refined_theta
from models.identification.search.auto import AutoCandidate
from models.identification.search.candidate import Candidate
from models.identification.search.search import Search
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import CellContext, Dataset, build_dataset, find_scaling
from models.network.structure import Structure, full_structure
from models.recursive.update import RecursiveUpdate

N_MODELS = 24
DT_S = 1.0
_RUNS = 4
_REPEATS = 3
_GIB = 2.0**30


def main() -> int:
    arguments = _arguments()
    if arguments.child:
        print(json.dumps(simulate_long(arguments.samples)))
        return 0
    names = arguments.only or list(TASKS)
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for name in names:
            print(f"{name} ...", file=sys.stderr, flush=True)
            rows += TASKS[name](arguments.samples)
    if arguments.json:
        print(json.dumps({"samples": arguments.samples, "figures": rows}))
    else:
        _print(rows)
    return 0


def time_free_run(n: int) -> list[dict[str, Any]]:
    """Samples per second of the free run, from current and temperature to voltage."""
    run = _grid(n)[0]
    rows = []
    for name, network in _networks(n):
        seconds = _least_s(lambda network=network: free_run_V(network, run, INITIAL_SOC))
        rows.append(
            _row(f"free run, {name}, {network.n_models} local models", len(run) / seconds, "samples/s", 5e6, True)
        )
    return rows


def time_construction(n: int) -> list[dict[str, Any]]:
    """Seconds of one construction."""
    structure = _structure()
    _built(structure, _data(2000))
    seconds = _least_s(lambda: _built(structure, _data(n)))
    return [_row(f"construction to {N_MODELS} local models", seconds, "s", 0.3, False)]


def time_search(n: int) -> list[dict[str, Any]]:
    """Seconds of the search over structures, for each family."""
    rows = []
    for family in ("full", "auto"):
        _search(2000).best(family)
        search = _search(n)
        began = time.process_time()
        choice = search.best(family)
        search.fitted(choice)
        seconds = time.process_time() - began
        rows.append(_row(f"search, {family} ({len(search.table)} candidates)", seconds, "s", 3.0, False))
    return rows


def time_refinement(n: int) -> list[dict[str, Any]]:
    """Seconds of the refinement with its regularisation chosen."""
    seconds = []
    for size in (2000, n):
        fitted = _search(size).fitted(_refined_choice())
        began = time.process_time()
        refined_theta(fitted, lambda share, text: None)
        seconds.append(time.process_time() - began)
    return [_row(f"refinement of {N_MODELS} local models", seconds[-1], "s", 10.0, False)]


def time_update(n: int) -> list[dict[str, Any]]:
    """Microseconds of one recursive update of a live network, state in and state out."""
    rows = []
    for name, network in _networks(20_000):
        update, run = RecursiveUpdate(network), _grid(20_000)[0]
        columns = (run.current_A.tolist(), run.voltage_V.tolist(), run.temperature_degC.tolist())

        def every_sample(update: RecursiveUpdate = update, columns: tuple[list[float], ...] = columns) -> None:
            state = update.initial(INITIAL_SOC)
            for sample in zip(*columns, strict=True):
                state, _ = update.step(state, *sample)

        seconds = _least_s(every_sample)
        title = f"recursive update, {name}, {network.n_models} x {network.theta.shape[1]} parameters"
        rows.append(_row(title, 1e6 * seconds / len(run), "us", 50.0, False))
    return rows


def measure_long_run(n: int) -> list[dict[str, Any]]:
    """Peak memory and speed of 1e7 samples, in a process of its own."""
    command = [sys.executable, __file__, "--child", "--samples", str(10_000_000)]
    answer = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    return [
        _row("1e7 samples, peak memory", answer["peak_GiB"], "GiB", 2.0, False),
        _row("1e7 samples, of that before the free run", answer["before_GiB"], "GiB", None, False),
        _row("1e7 samples, free run with its signals", answer["samples_per_second"], "samples/s", None, True),
    ]


def measure_linear(n: int) -> list[dict[str, Any]]:
    """Time per sample at 16 times the samples over that at the fewest."""
    network = _network(n)
    cost = []
    for size in (100_000, 1_600_000):
        run = _tiled(_grid(100_000)[0], size)
        cost.append(_least_s(lambda run=run: free_run_V(network, run, INITIAL_SOC)) / size)
    return [_row("cost per sample at 1.6e6 over that at 1e5 samples", cost[1] / cost[0], "1", 1.5, False)]


def simulate_long(n: int) -> dict[str, float]:
    """Simulate `n` samples with 24 local models and say what it took."""
    network, short = _network(20_000), _grid(20_000)[0]
    free_run_V(network, short, INITIAL_SOC)
    run = _tiled(short, n)
    before = _peak_GiB()
    began = time.process_time()
    free_run_V(network, run, INITIAL_SOC)
    seconds = time.process_time() - began
    return {"samples_per_second": n / seconds, "peak_GiB": _peak_GiB(), "before_GiB": before}


TASKS: dict[str, Callable[[int], list[dict[str, Any]]]] = {
    "free_run": time_free_run,
    "construction": time_construction,
    "search": time_search,
    "refinement": time_refinement,
    "update": time_update,
    "long_run": measure_long_run,
    "linear": measure_linear,
}


@cache
def _full_grid() -> tuple[GridRun, ...]:
    made = [simulated_run("nmc", 0, number, 25_000.0) for number in range(_RUNS)]
    return tuple(to_grid(run.series, DT_S) for run in made)


@cache
def _grid(n: int) -> tuple[GridRun, ...]:
    """Runs of `n` samples in all, cut from the simulated ones."""
    return tuple(_tiled(run, n // _RUNS) for run in _full_grid())


def _tiled(run: GridRun, n: int) -> GridRun:
    """Cut or repeat a run to `n` samples; the charge that a piece left goes on counting."""
    index = np.arange(n) % len(run)
    current = run.current_A[index] - float(run.current_A.mean()) * (n > len(run))

    def column(values: FloatArray) -> FloatArray:
        return values[index]

    return replace(
        run,
        time_s=np.arange(n) * run.dt_s,
        current_A=current,
        voltage_V=column(run.voltage_V),
        temperature_degC=column(run.temperature_degC),
        ambient_degC=None,
        charge_Ah=np.cumsum(current) * (run.dt_s / 3600.0),
        soc_ref=None,
        measured=run.measured[index],
    )


def _structure() -> Structure:
    return full_structure(DT_S, output_order=1, current_order=2, relaxation_s=600.0)


def _cell() -> CellContext:
    return CellContext(2.5)


def _search(n: int) -> Search:
    return Search(list(_grid(n)), [INITIAL_SOC] * _RUNS, _cell(), lambda share, text: None)


def _refined_choice() -> Candidate:
    return Candidate("full", n_models=N_MODELS)


@cache
def _data(n: int) -> Dataset:
    structure, soc = _structure(), [INITIAL_SOC] * _RUNS
    scaling = find_scaling(structure, list(_grid(n)), soc, _cell())
    return build_dataset(structure, scaling, list(_grid(n)), soc, _cell())


def _built(structure: Structure, data: Dataset) -> LocalFit:
    *_, last = construct(structure, data, N_MODELS)
    return last


def _networks(n: int) -> list[tuple[str, LocalModelNetwork]]:
    """A network with one past output, and one of many low-passes without any."""
    choice = AutoCandidate(_cell().capacity_Ah, exchange_c_rate=0.6, surface=(0.05, 100.0, 0.0), n_models=N_MODELS)
    fitted = _search(n).fitted(choice)
    auto = LocalModelNetwork(fitted.structure, fitted.partition, fitted.theta, fitted.scaling, _cell())
    return [("1 past output", _network(n)), ("auto", auto)]


@cache
def _network(n: int) -> LocalModelNetwork:
    fitted = _search(n).fitted(_refined_choice())
    return LocalModelNetwork(fitted.structure, fitted.partition, fitted.theta, fitted.scaling, _cell())


def _least_s(task: Callable[[], object]) -> float:
    """Least time of a few repetitions, after one that compiles."""
    task()
    seconds = []
    for _ in range(_REPEATS):
        began = time.process_time()
        task()
        seconds.append(time.process_time() - began)
    return min(seconds)


def _peak_GiB() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / _GIB


def _row(name: str, value: float, unit: str, bar: float | None, more_is_better: bool) -> dict[str, Any]:
    holds = None if bar is None else (value >= bar if more_is_better else value <= bar)
    return {"figure": name, "value": value, "unit": unit, "bar": bar, "holds": holds}


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Speed and memory, one BLAS thread")
    for heading in ("figure", "value", "bar", "unit", "holds"):
        table.add_column(heading, justify="left" if heading in ("figure", "unit") else "right")
    for row in rows:
        bar = "" if row["bar"] is None else f"{row['bar']:.3g}"
        holds = {None: "", True: "yes", False: "no"}[row["holds"]]
        table.add_row(row["figure"], f"{row['value']:.3g}", bar, row["unit"], holds)
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=list(TASKS), help="figures to take; all by default")
    parser.add_argument("--samples", type=int, default=100_000, help="training samples")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
