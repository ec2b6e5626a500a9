"""How soon the observer says that something is wrong, and how often it says so of what is right.

``python benchmarks/observer_health.py [--cells nmc lfp] [--cases 40] [--models DIR] [--json]``

Models and random cases are those of `observer_cases.py`, with starts up to 40 points off. Each case once as it is; with
a voltage reading that stands still from some moment under changing load on; with the model of the other chemistry; with
a cell of the same chemistry whose resistances are a multiple, or whose open-circuit curve is moved; and with a current
that is read with the wrong sign. Counted is the time under load until an alarm, of a stuck reading from that moment on.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from observer_cases import LARGEST_START, models
from observer_cells import Case, random_case
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.health import MODEL, RANGE, STUCK, watch
from simulators.catalogue import cell_type
from simulators.cell import Branch, CellParameters

CHEMISTRIES = ("nmc", "lfp")
FACTORS, MOVED_V = (0.5, 1.5, 2.0, 3.0), (0.02, 0.05)
# Of the cases' seeds, apart from those that other benchmarks judge or calibrate by.
_FIRST = 40_000
# A current below this share of 1C is no load.
_LOAD_C = 0.05
# A reading is held where so many steps of the current fall into the next minute, and not sooner than that.
_STEPS, _MINUTE_S, _STARTED_S = 3, 60, 300


def main() -> int:
    arguments = _arguments()
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1, user_api="blas"):
        networks = {cell: models(cell, arguments.models)[0] for cell in CHEMISTRIES}
        for cell in arguments.cells:
            rows += judge(cell, networks, arguments.cases)
    if arguments.json:
        print(json.dumps({"cases": arguments.cases, "rows": rows}))
    else:
        _print(rows)
    return 0


def judge(cell: str, networks: dict[str, LocalModelNetwork], count: int) -> list[dict[str, Any]]:
    """One row for each thing that can be wrong."""
    own, other = networks[cell], networks[next(each for each in CHEMISTRIES if each != cell)]
    numbers = range(_FIRST, _FIRST + count)
    parameters = cell_type(cell).parameters
    cases = [random_case(cell, number) for number in numbers]
    rows = [_row(cell, "nothing", [_alarm_s(own, case, k) for k, case in enumerate(cases)])]
    held = [_held(case, parameters.capacity_Ah, k) for k, case in enumerate(cases)]
    stuck = [_alarm_s(own, case, k, since, STUCK) for k, (case, since) in enumerate(held)]
    rows.append(_row(cell, "reading stands still", stuck))
    rows.append(_row(cell, "model of the other chemistry", [_alarm_s(other, case, k) for k, case in enumerate(cases)]))
    wrong = {}
    for factor in FACTORS:
        changed = _resistances(parameters, factor)
        wrong[f"resistances x {factor:g}"] = [random_case(cell, number, changed=changed) for number in numbers]
    for moved_V in MOVED_V:
        wrong[f"curve {1e3 * moved_V:+g} mV"] = [
            _read(case, voltage_V=case.series.voltage_V + moved_V) for case in cases
        ]
    wrong["current of the wrong sign"] = [_read(case, current_A=-case.series.current_A) for case in cases]
    rows += [_row(cell, name, [_alarm_s(own, case, k) for k, case in enumerate(seen)]) for name, seen in wrong.items()]
    return rows


def _alarm_s(
    network: LocalModelNetwork, case: Case, number: int, since: int = 0, bits: int = MODEL | STUCK | RANGE
) -> float:
    """Seconds under load from a sample on until one of these alarms; infinite where there is none."""
    run, off = case.series, np.random.default_rng([104_729, number]).uniform(-LARGEST_START, LARGEST_START)
    observer = FuzzyObserver(network)
    start = observer.initial(float(np.clip(case.initial_soc + off, 0.0, 1.0)))
    _, rows = observer.replay(start, run.current_A, run.voltage_V, run.temperature_degC)
    alarms = watch(rows, run.voltage_V)[since:, 2].astype(int) & bits
    if not alarms.any():
        return float("inf")
    loaded = np.abs(run.current_A[since:]) > _LOAD_C * network.cell.capacity_Ah
    return float(np.count_nonzero(loaded[: int(np.argmax(alarms > 0)) + 1]))


def _held(case: Case, capacity_Ah: float, number: int) -> tuple[Case, int]:
    """The case with a reading that stands still from a sample on under changing load, and that sample."""
    run = case.series
    steps = np.abs(np.diff(run.current_A, append=run.current_A[-1:])) > _LOAD_C * capacity_Ah
    after = np.convolve(steps, np.ones(_MINUTE_S), "valid")
    since = int(np.random.default_rng([3, number]).choice(np.flatnonzero(after[_STARTED_S:] >= _STEPS))) + _STARTED_S
    voltage_V = run.voltage_V.copy()
    voltage_V[since:] = voltage_V[since]
    return _read(case, voltage_V=voltage_V), since


def _read(case: Case, **readings: FloatArray) -> Case:
    """Return the case with other readings."""
    return replace(case, series=replace(case.series, **readings))


def _resistances(p: CellParameters, factor: float) -> CellParameters:
    """The same cell with all its resistances a multiple."""
    branches: dict[str, Any] = {
        name: Branch(factor * getattr(p, name).resistance_Ohm, getattr(p, name).time_constant_s)
        for name in ("fast_1", "fast_2", "slow")
    }
    return replace(p, ohmic_Ohm=factor * p.ohmic_Ohm, charge_transfer_V=factor * p.charge_transfer_V, **branches)


def _row(cell: str, name: str, alarm_s: list[float]) -> dict[str, Any]:
    times = np.array(alarm_s)
    known: FloatArray = times[np.isfinite(times)]
    return {
        "cell": cell,
        "wrong": name,
        "cases": len(times),
        "within_60_s": float(np.mean(times <= _MINUTE_S)),
        "within_300_s": float(np.mean(times <= 5 * _MINUTE_S)),
        "ever": len(known) / len(times),
        "median_s": float(np.median(known)) if len(known) else None,
    }


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table("cell", "what is wrong", "cases", "alarm within 60 s", "300 s", "ever", "median of these, s")
    for row in rows:
        shares = [f"{100.0 * row[key]:.0f} %" for key in ("within_60_s", "within_300_s", "ever")]
        median = "" if row["median_s"] is None else f"{row['median_s']:.0f}"
        table.add_row(row["cell"], row["wrong"], str(row["cases"]), *shares, median)
    Console(width=140).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=CHEMISTRIES, default=list(CHEMISTRIES))
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--models", type=Path, help="folder in which models are kept between runs")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
