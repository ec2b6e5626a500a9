"""State of charge of simulated cells by every observer there is, in one table.

``python benchmarks/observer_cases.py [--cells nmc lfp] [--cases 200] [--filter-cases 20] [--models DIR] [--json]``

One model is identified per chemistry (structure auto, 0..40 degC), its noise is tuned on the same data, its band on
further runs. Then random cases: random load with rests, chamber steps between 0 and 40 degC, sensor noise, a start up
to 40 points off. Each case once as it is, once with a current sensor that reads 1 % of 1C too much, once with a voltage
sensor that reads 5 mV too much and is known to be no better. The filters on a circuit, which are not compiled, see the
first of the cases only.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from observer_cells import DT_S, Case, random_case, training_runs
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.baselines import EquivalentCircuit, fit_equivalent_circuit
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.certificate.observability import observability
from models.observer.circuit_filters import CircuitObserver
from models.observer.tuning.accuracy import soc_figures
from models.observer.tuning.tuning import tune
from models.pipeline.fit import fit_network
from simulators.catalogue import cell_type

# Names of the cases, offset of the current sensor in C and of the voltage sensor in V.
SENSORS = (("as it is", 0.0, 0.0), ("current +1 % of 1C", 0.01, 0.0), ("voltage +5 mV", 0.0, 0.005))
LARGEST_START = 0.4
_HELD_OUT, _N_HELD_OUT = 30_000, 32
# The bound offset / slope is looked at in every so many samples of the second half.
_BOUND_EVERY, _SLOPE_POINTS = 60, 91


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            network, circuit = models(cell, arguments.models)
            cases = [random_case(cell, number) for number in range(arguments.cases)]
            rows += judge(cell, network, circuit, cases, arguments.filter_cases)
    if arguments.json:
        print(json.dumps({"cases": arguments.cases, "rows": rows}))
    else:
        print_table("State of charge after convergence, simulated cells, start up to 40 points off", rows)
    return 0


def models(cell: str, folder: Path | None) -> tuple[LocalModelNetwork, EquivalentCircuit]:
    """Identify and tune both models of a cell, or read them where that was done before."""
    files = [] if folder is None else [folder / f"{cell}_{kind}.json" for kind in ("network", "circuit")]
    if files and all(file.exists() for file in files):
        network, circuit = (json.loads(file.read_text()) for file in files)
        return LocalModelNetwork.from_json(network), EquivalentCircuit.from_json(circuit)
    capacity_Ah, runs = cell_type(cell).parameters.capacity_Ah, training_runs(cell)
    network = fit_network(runs, capacity_Ah=capacity_Ah, structure="auto", dt_s=DT_S).network
    held_out = [random_case(cell, _HELD_OUT + number).series for number in range(_N_HELD_OUT)]
    starts = [[start_soc(run) for run in part] for part in (runs, held_out)]
    settings = tune(network, runs, starts[0], held_out=(held_out, starts[1]))
    network = replace(network, record=replace(network.record, observer=settings.to_json()))
    circuit = fit_equivalent_circuit(runs, capacity_Ah=capacity_Ah, n_branches=2, dt_s=DT_S)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        for file, model in zip(files, (network, circuit), strict=True):
            file.write_text(json.dumps(model.to_json()))
    return network, circuit


def judge(
    cell: str, network: LocalModelNetwork, circuit: EquivalentCircuit, cases: list[Case], filter_cases: int
) -> list[dict[str, Any]]:
    """Figures of every observer over all cases, a row for each observer and sensor."""
    rows, curve = [], slope_over_soc(network)
    for sensor, offset_C, offset_V in SENSORS:
        for name, observer in _observers(network, circuit, offset_V).items():
            seen = cases[:filter_cases] if isinstance(observer, CircuitObserver) else cases
            if not seen:
                continue
            offset_A = offset_C * network.cell.capacity_Ah
            each = [one_case(observer, curve, *case, offset_A, offset_V) for case in enumerate(seen)]
            rows.append({"cell": cell, "sensor": sensor, "observer": name, **summary(each)})
    return rows


def _observers(network: LocalModelNetwork, circuit: EquivalentCircuit, offset_V: float) -> dict[str, Any]:
    known = replace(FuzzyObserver(network).settings, voltage_offset_std_V=offset_V)
    return {
        "local model network": FuzzyObserver(network, known),
        "the same, steady-state gains": FuzzyObserver(network, replace(known, gain="steady")),
        "2RC, extended Kalman filter": CircuitObserver(circuit, "extended"),
        "2RC, unscented Kalman filter": CircuitObserver(circuit, "unscented"),
        "counting": CircuitObserver(circuit, "counting"),
    }


def slope_over_soc(network: LocalModelNetwork) -> tuple[FloatArray, FloatArray]:
    """(n,) state of charge and (n,) slope of the model's open-circuit voltage there."""
    soc = np.linspace(0.05, 0.95, _SLOPE_POINTS)
    return soc, np.maximum(observability(network, soc).slope_V, 1e-6)


def one_case(
    observer: Any,
    curve: tuple[FloatArray, FloatArray],
    number: int,
    case: Case,
    offset_A: float,
    offset_V: float,
    cells: int = 1,
) -> dict[str, float]:
    """Figures of one case with a wrong start; `offset_V` is that of the voltage over so many cells in series."""
    run, off = case.series, np.random.default_rng([104_729, number]).uniform(-LARGEST_START, LARGEST_START)
    assert run.soc_ref is not None
    start = float(np.clip(case.initial_soc + off, 0.0, 1.0))
    current_A, voltage_V = run.current_A + offset_A, run.voltage_V + offset_V
    _, rows = observer.replay(observer.initial(start), current_A, voltage_V, run.temperature_degC)
    figures = soc_figures(run.time_s, rows[:, 0], rows[:, 1], run.soc_ref)
    converged = figures["converged_after_s"]
    late = slice(len(rows) // 2, None, _BOUND_EVERY)
    slope_V = np.interp(run.soc_ref[late], *curve)
    error = np.abs(rows[late, 0] - run.soc_ref[late])
    return {
        "rmse": figures["soc_rmse"] or 0.0,
        "max": figures["soc_max_error"] or 0.0,
        "coverage": figures["coverage_95"] or 0.0,
        "converged_s": np.inf if converged is None else converged,
        "under_bound": float(np.mean(error <= offset_V / cells / slope_V)),
    }


def summary(each: list[dict[str, float]]) -> dict[str, float]:
    """Figures over all cases; times of convergence may be infinite."""
    column = {key: np.array([row[key] for row in each]) for key in each[0]}
    return {
        "cases": float(len(each)),
        "rmse": float(np.sqrt(np.mean(column["rmse"] ** 2))),
        "rmse_median": float(np.median(column["rmse"])),
        "rmse_worst": float(column["rmse"].max()),
        "max_error": float(column["max"].max()),
        "coverage": float(column["coverage"].mean()),
        "converged_s_median": float(np.median(column["converged_s"])),
        "converged_s_95": float(np.sort(column["converged_s"])[int(0.95 * (len(each) - 1))]),
        "converged_share": float(np.isfinite(column["converged_s"]).mean()),
        "under_bound": float(column["under_bound"].mean()),
    }


def print_table(title: str, rows: list[dict[str, Any]]) -> None:
    """Print one line for each observer and sensor; errors in % of the capacity, times in s."""
    table = Table(title=title)
    for heading in ("cell", "sensors", "observer"):
        table.add_column(heading)
    headings = ("cases", "RMSE", "median", "worst run", "largest", "in band %", "below 3 % after", "of 95 %", "ever %")
    for heading in headings:
        table.add_column(heading, justify="right")
    for row in rows:
        errors = [f"{100.0 * row[key]:.2f}" for key in ("rmse", "rmse_median", "rmse_worst", "max_error")]
        times = [f"{row[key]:.0f}" for key in ("converged_s_median", "converged_s_95")]
        shares = [f"{100.0 * row[key]:.1f}" for key in ("coverage", "converged_share")]
        cells = [f"{row['cases']:.0f}", *errors, shares[0], *times, shares[1]]
        table.add_row(row["cell"], row["sensor"], row["observer"], *cells)
    Console(width=170).print(table)
    for row in rows:
        if row["sensor"].startswith("voltage"):
            share = 100.0 * row["under_bound"]
            print(f"{row['cell']}, {row['observer']}, {row['sensor']}: {share:.1f} % of samples under offset / slope")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=("nmc", "lfp"), default=["nmc", "lfp"])
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--filter-cases", type=int, default=20, help="of these for the filters on a circuit")
    parser.add_argument("--models", type=Path, help="folder in which models are kept between runs")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
