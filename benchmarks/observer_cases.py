"""State of charge of simulated cells by every observer there is, in one table.

``python benchmarks/observer_cases.py [--cells nmc lfp] [--cases 200] [--models DIR] [--json]``

One model is identified per chemistry (structure auto, 0..40 degC), its noise is tuned on the same data, its band on
four further runs. Then random cases: random load with rests, chamber steps between 0 and 40 degC, sensor noise, a start
up to 40 points off. Each case once as it is, once with a current sensor that reads 1 % of 1C too much, once with a
voltage sensor that reads 5 mV too much and is known to be no better.
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
from models.identification import fit_network, start_soc
from models.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.accuracy import soc_figures
from models.observer.circuit_filters import CircuitObserver
from models.observer.observability import observability
from models.observer.tuning import tune
from simulators.catalogue import cell_type

# Names of the cases, offset of the current sensor in C and of the voltage sensor in V.
SENSORS = (("as it is", 0.0, 0.0), ("current +1 % of 1C", 0.01, 0.0), ("voltage +5 mV", 0.0, 0.005))
LARGEST_START = 0.4
_HELD_OUT = 30_000


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            network, circuit = models(cell, arguments.models)
            cases = [random_case(cell, number) for number in range(arguments.cases)]
            rows += judge(cell, network, circuit, cases)
    if arguments.json:
        print(json.dumps({"cases": arguments.cases, "rows": rows}))
    else:
        _print(rows)
    return 0


def models(cell: str, folder: Path | None) -> tuple[LocalModelNetwork, EquivalentCircuit]:
    """Identify and tune both models of a cell, or read them where that was done before."""
    files = [] if folder is None else [folder / f"{cell}_{kind}.json" for kind in ("network", "circuit")]
    if files and all(file.exists() for file in files):
        network, circuit = (json.loads(file.read_text()) for file in files)
        return LocalModelNetwork.from_json(network), EquivalentCircuit.from_json(circuit)
    capacity_Ah, runs = cell_type(cell).parameters.capacity_Ah, training_runs(cell)
    network = fit_network(runs, capacity_Ah=capacity_Ah, structure="auto", dt_s=DT_S).network
    held_out = [random_case(cell, _HELD_OUT + number).series for number in range(4)]
    starts = [[start_soc(run) for run in part] for part in (runs, held_out)]
    settings = tune(network, runs, starts[0], held_out=(held_out, starts[1]))
    network = replace(network, record=network.record | {"observer": settings.to_json()})
    circuit = fit_equivalent_circuit(runs, capacity_Ah=capacity_Ah, n_branches=2, dt_s=DT_S)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        for file, model in zip(files, (network, circuit), strict=True):
            file.write_text(json.dumps(model.to_json()))
    return network, circuit


def judge(cell: str, network: LocalModelNetwork, circuit: EquivalentCircuit, cases: list[Case]) -> list[dict[str, Any]]:
    """Figures of every observer over all cases, a row for each observer and sensor."""
    rows = []
    for sensor, offset_C, offset_V in SENSORS:
        observers = _observers(network, circuit, offset_V)
        for name, observer in observers.items():
            each = [_one(observer, network, case, number, offset_C, offset_V) for number, case in enumerate(cases)]
            rows.append({"cell": cell, "sensor": sensor, "observer": name, **_summary(each)})
    return rows


def _observers(network: LocalModelNetwork, circuit: EquivalentCircuit, offset_V: float) -> dict[str, Any]:
    own = FuzzyObserver(network).settings
    known = replace(own, voltage_offset_std_V=offset_V)
    return {
        "local model network": FuzzyObserver(network, known),
        "the same, steady-state gains": FuzzyObserver(network, replace(known, gain="steady")),
        "2RC, extended Kalman filter": CircuitObserver(circuit, "extended"),
        "2RC, unscented Kalman filter": CircuitObserver(circuit, "unscented"),
        "counting": CircuitObserver(circuit, "counting"),
    }


def _one(
    observer: Any, network: LocalModelNetwork, case: Case, number: int, offset_C: float, offset_V: float
) -> dict[str, float]:
    run, off = case.series, np.random.default_rng([104_729, number]).uniform(-LARGEST_START, LARGEST_START)
    start = float(np.clip(case.initial_soc + off, 0.0, 1.0))
    current = run.current_A + offset_C * network.cell.capacity_Ah
    voltage = run.voltage_V + offset_V
    _, rows = observer.replay(observer.initial(start), current, voltage, run.temperature_degC)
    figures = soc_figures(run.time_s, rows[:, 0], rows[:, 1], run.soc_ref)
    converged = figures["converged_after_s"]
    assert run.soc_ref is not None
    late = slice(len(rows) // 2, None)
    bound = offset_V / np.maximum(observability(network, run.soc_ref[late][::600]).slope_V, 1e-6)
    error = np.abs(rows[late, 0] - run.soc_ref[late])[::600]
    return {
        "rmse": figures["soc_rmse"] or 0.0,
        "max": figures["soc_max_error"] or 0.0,
        "coverage": figures["coverage_95"] or 0.0,
        "converged_s": np.inf if converged is None else converged,
        "under_bound": float(np.mean(error <= bound)),
    }


def _summary(each: list[dict[str, float]]) -> dict[str, float]:
    column = {key: np.array([row[key] for row in each]) for key in each[0]}
    return {
        "rmse": float(np.sqrt(np.mean(column["rmse"] ** 2))),
        "rmse_median": float(np.median(column["rmse"])),
        "rmse_worst": float(column["rmse"].max()),
        "max_error": float(column["max"].max()),
        "coverage": float(column["coverage"].mean()),
        "converged_s_median": float(np.median(column["converged_s"])),
        "converged_share": float(np.isfinite(column["converged_s"]).mean()),
        "under_bound": float(column["under_bound"].mean()),
    }


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="State of charge after convergence, simulated cells, start up to 40 points off")
    for heading in ("cell", "sensors", "observer"):
        table.add_column(heading)
    for heading in ("RMSE %", "median", "worst run", "largest", "in 95 % band", "below 3 % after s", "converged %"):
        table.add_column(heading, justify="right")
    for row in rows:
        figures = [100.0 * row[key] for key in ("rmse", "rmse_median", "rmse_worst", "max_error", "coverage")]
        cells = [f"{value:.2f}" for value in figures[:4]] + [f"{figures[4]:.1f}"]
        cells += [f"{row['converged_s_median']:.0f}", f"{100.0 * row['converged_share']:.1f}"]
        table.add_row(row["cell"], row["sensor"], row["observer"], *cells)
    Console(width=160).print(table)
    for row in rows:
        if row["sensor"] == "voltage +5 mV" and row["observer"] == "local model network":
            share = 100.0 * row["under_bound"]
            print(f"{row['cell']}, voltage +5 mV: {share:.1f} % of the samples under offset / slope")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=("nmc", "lfp"), default=["nmc", "lfp"])
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--models", type=Path, help="folder in which models are kept between runs")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
