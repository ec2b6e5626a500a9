"""Module models S1 to S4 on simulated modules: error of each, and the identified resistance against the true one.

``python benchmarks/module_models.py [--cells nmc] [--seeds 3] [--structure auto] [--true-cell] [--json]``

A cell model is identified from one record of a simulated cell. Modules of such cells, unequal in capacity, resistance
and state of charge and joined by connectors, play a profile of their own; R and V_0 are identified from one run of the
module and judged on another. The truth of R is the connectors' resistance: the cells' own is in the cell model, and the
mean of the unequal cells is the cell type. `--true-cell` takes the simulated cell itself as the cell model, which shows
what the cell model's own error costs.
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from simulated_cells import DT_S, INITIAL_SOC, simulated_run
from threadpoolctl import threadpool_limits

from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.module.models import KINDS, ModuleRun, as_cell_run, compare_module_models
from models.network.free_run import free_run_V
from models.pipeline import STRUCTURES, fit_network
from simulators.catalogue import CELLS, cell_type
from simulators.cell import Cell, CellOutput
from simulators.module import Module, ModuleLayout

LAYOUTS = (
    ModuleLayout(
        cells_in_series=12,
        cells_in_parallel=1,
        connector_resistance_Ohm=0.003,
        capacity_spread=0.01,
        resistance_spread=0.03,
        soc_spread=0.005,
    ),
    ModuleLayout(
        cells_in_series=3,
        cells_in_parallel=2,
        connector_resistance_Ohm=0.003,
        capacity_spread=0.02,
        resistance_spread=0.05,
        soc_spread=0.01,
    ),
)
BAR = 0.05
_NOISE_V = 1e-3
_AMBIENT_DEGC = 25.0


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            print(f"identifying the {cell} cell ...", file=sys.stderr, flush=True)
            simulate = _true_cell(cell) if arguments.true_cell else _identified(cell, arguments.structure)
            for layout in LAYOUTS:
                rows += [judge(cell, replace(layout, seed=seed), simulate) for seed in range(arguments.seeds)]
    if arguments.json:
        print(json.dumps({"bar": BAR, "modules": rows}))
    else:
        _print(rows)
    return 0


def judge(cell: str, layout: ModuleLayout, simulate: Callable[[TimeSeries], FloatArray]) -> dict[str, Any]:
    """Identify the four models of one module from one run and judge them on another."""
    size = layout.cells_in_series, layout.cells_in_parallel
    runs = []
    for number in (0, 1):
        module = module_run(cell, layout, number)
        runs.append(ModuleRun(module.voltage_V, module.current_A, simulate(as_cell_run(module, *size))))
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    rest_A = 0.005 * capacity_Ah * layout.cells_in_parallel
    found = compare_module_models(runs[:1], *size, validate=runs[1:], rest_A=rest_A)
    error = {
        kind: float(np.max(np.abs(np.array(found.models[kind].resistance_Ohm) / layout.connectors_Ohm - 1.0)))
        for kind in KINDS[1:]
        if kind in found.models
    }
    return {
        "cell": cell,
        "layout": asdict(layout),
        "train_rmse_mV": {kind: found.train[kind]["rmse_mV"] for kind in found.models},
        "held_out_rmse_mV": {kind: found.validation[kind]["rmse_mV"] for kind in found.models},
        "resistance_error": error,
        "reservations": list(found.reservations),
    }


def module_run(cell: str, layout: ModuleLayout, number: int) -> TimeSeries:
    """Play a profile to a module at rest and measure it with noise."""
    # The set-points of a cell's run, without its sensors' noise, and for all parallel cells.
    parameters = cell_type(cell).parameters
    profile = simulated_run(cell, 100 + layout.seed, number).series
    current_A = np.round(profile.current_A, 2) * layout.cells_in_parallel
    module = Module(parameters, layout, INITIAL_SOC, _AMBIENT_DEGC)
    truth = [module.step(0.0, 0.0), *(module.step(float(i), DT_S) for i in current_A[1:])]
    noise = _NOISE_V * np.random.default_rng([layout.seed, number]).standard_normal(len(truth))
    return TimeSeries(
        profile.time_s,
        current_A,
        np.array([out.voltage_V for out in truth]) + noise,
        np.array([out.temperature_degC for out in truth]),
        None,
        np.where(profile.time_s == 0.0, INITIAL_SOC, np.nan),
        f"{cell} module {layout.seed}.{number}",
    )


def _identified(cell: str, structure: str) -> Callable[[TimeSeries], FloatArray]:
    train = simulated_run(cell, 0, 0)
    network = fit_network([train.series], capacity_Ah=train.capacity_Ah, structure=structure, dt_s=DT_S).network
    return lambda run: free_run_V(network, to_grid(run, DT_S), INITIAL_SOC)


def _true_cell(cell: str) -> Callable[[TimeSeries], FloatArray]:
    def simulate(run: TimeSeries) -> FloatArray:
        one = Cell(cell_type(cell).parameters, INITIAL_SOC, _AMBIENT_DEGC)
        outputs: list[CellOutput] = [one.step(0.0, 0.0), *(one.step(float(i), DT_S) for i in run.current_A[1:])]
        return np.array([out.voltage_V for out in outputs])

    return simulate


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Module models on simulated modules: held-out RMSE / mV and error of the resistance / %")
    for heading in ("cell", "layout", "seed", *KINDS, *(f"R {kind} / %" for kind in KINDS[1:])):
        table.add_column(heading, justify="right")
    for row in rows:
        layout = row["layout"]
        table.add_row(
            row["cell"],
            f"{layout['cells_in_series']}s{layout['cells_in_parallel']}p",
            str(layout["seed"]),
            *(f"{row['held_out_rmse_mV'][kind]:.2f}" if kind in row["held_out_rmse_mV"] else "-" for kind in KINDS),
            *(
                f"{100 * row['resistance_error'][kind]:.1f}" if kind in row["resistance_error"] else "-"
                for kind in KINDS[1:]
            ),
        )
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=list(CELLS), default=["nmc"])
    parser.add_argument("--seeds", type=int, default=3, help="number of modules of each layout")
    parser.add_argument("--structure", choices=STRUCTURES, default="auto", help="of the cell model")
    parser.add_argument("--true-cell", action="store_true", help="take the simulated cell itself as the cell model")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
