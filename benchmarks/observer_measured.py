"""State of charge on measured drive cycles that the fit never saw, by every observer there is, in one table.

``python benchmarks/observer_measured.py FOLDER [--models DIR] [--json]``

FOLDER holds the drive cycles of Kollmeyer, "Panasonic 18650PF Li-ion Battery Data", Mendeley Data, 2018
(doi:10.17632/wykht8y7tg.1) as drive_TEMPERATURE_NAME.csv.gz. The models are identified and tuned on the mixed cycles
and the NN cycle from 25 to -10 degC; observed are US06 and highway cycles, from 20 points below the rig's counter. That
counter is itself right to +-3 % in scale only.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run_file
from models.baselines import EquivalentCircuit, fit_equivalent_circuit
from models.data.resampling import to_grid
from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.circuit_filters import CircuitObserver
from models.observer.tuning.accuracy import soc_figures
from models.observer.tuning.tuning import tune
from models.pipeline.fit import fit_network

CAPACITY_AH = 2.968
TEMPERATURES = ("25degC", "10degC", "0degC", "m10degC")
IDENTIFIED, OBSERVED = ("Cycle", "NN"), ("US06", "HW")
START_OFF = -0.2


def main() -> int:
    arguments = _arguments()
    with threadpool_limits(1, user_api="blas"):
        network, circuit = models(arguments.folder, arguments.models)
        observers: dict[str, Any] = {
            "local model network": FuzzyObserver(network),
            "the same, steady-state gains": FuzzyObserver(
                network, replace(FuzzyObserver(network).settings, gain="steady")
            ),
            "2RC, extended Kalman filter": CircuitObserver(circuit, "extended"),
            "2RC, unscented Kalman filter": CircuitObserver(circuit, "unscented"),
        }
        rows = [
            {"run": run.name, "observer": name, **_figures(observer, run)}
            for run in _runs(arguments.folder, OBSERVED)
            for name, observer in observers.items()
        ]
    if arguments.json:
        print(json.dumps(rows))
    else:
        _print(rows)
    return 0


def models(folder: Path, kept: Path | None) -> tuple[LocalModelNetwork, EquivalentCircuit]:
    """Identify and tune both models, or read them where that was done before."""
    files = [] if kept is None else [kept / f"measured_{kind}.json" for kind in ("network", "circuit")]
    if files and all(file.exists() for file in files):
        network, circuit = (json.loads(file.read_text()) for file in files)
        return LocalModelNetwork.from_json(network), EquivalentCircuit.from_json(circuit)
    runs = _runs(folder, IDENTIFIED)
    network = fit_network(runs, capacity_Ah=CAPACITY_AH, structure="auto", dt_s=1.0).network
    settings = tune(network, runs, [start_soc(run) for run in runs])
    network = replace(network, record=replace(network.record, observer=settings.to_json()))
    circuit = fit_equivalent_circuit(runs, capacity_Ah=CAPACITY_AH, n_branches=2, dt_s=1.0)
    if kept is not None:
        kept.mkdir(parents=True, exist_ok=True)
        for file, model in zip(files, (network, circuit), strict=True):
            file.write_text(json.dumps(model.to_json()))
    return network, circuit


def _runs(folder: Path, names: tuple[str, ...]) -> list[TimeSeries]:
    files = [f for degC in TEMPERATURES for f in sorted(folder.glob(f"drive_{degC}_*.csv.gz"))]
    chosen = [f for f in files if f.name.removesuffix(".csv.gz").split("degC_")[1].startswith(names)]
    return [read_run_file(f, "charge-positive").series for f in chosen]


def _figures(observer: Any, run: TimeSeries) -> dict[str, Any]:
    grid = to_grid(run, 1.0)
    assert grid.soc_ref is not None
    state = observer.initial(float(grid.soc_ref[0]) + START_OFF)
    _, rows = observer.replay(state, grid.current_A, grid.voltage_V, grid.temperature_degC)
    found: dict[str, Any] = dict(soc_figures(grid.time_s, rows[:, 0], rows[:, 1], grid.soc_ref))
    late = slice(len(rows) // 10, None)
    found["rms_after_a_tenth"] = float(np.sqrt(np.mean((rows[late, 0] - grid.soc_ref[late]) ** 2)))
    return found


def _print(rows: list[dict[str, Any]]) -> None:
    names = list(dict.fromkeys(row["observer"] for row in rows))
    table = Table(title="RMS of estimate minus counter in %, from a tenth of the run on (after convergence)")
    table.add_column("run")
    for name in names:
        table.add_column(name, justify="right")
    for run in dict.fromkeys(row["run"] for row in rows):
        own = {row["observer"]: row for row in rows if row["run"] == run}
        cells = [f"{100 * own[n]['rms_after_a_tenth']:.2f} ({100 * own[n]['soc_rmse']:.2f})" for n in names]
        table.add_row(run, *cells)
    Console(width=150).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--models", type=Path, help="folder in which models are kept between runs")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
