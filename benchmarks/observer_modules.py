"""State of charge of simulated modules by the observer with each of the module models S1 to S4, in one table.

``python benchmarks/observer_modules.py [--cells nmc lfp] [--layout 4x1] [--cases 200] [--models DIR]``

The model of one cell and the observer's settings are those of `observer_cases.py`. The modules are of unequal cells
with connectors: R and V_0 are identified from runs of two modules, what they leave open is in the band, and random
cases of others (random load, chamber steps between 0 and 40 degC) are observed from starts up to 40 points off. The
reference is the mean state of charge of the module's cells.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from observer_cases import LARGEST_START, SENSORS, models, one_case, print_table, slope_over_soc, summary
from observer_cells import DT_S, Case, chamber_degC, load_A
from threadpoolctl import threadpool_limits

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.module.models import KINDS, ModuleModel, ModuleRun, as_cell_run, identify_module
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.module.module_observer import ModuleObserver
from simulators.catalogue import cell_type
from simulators.module import Module, ModuleLayout
from simulators.sensors import SensorParameters, Sensors

SPREAD = ModuleLayout(
    connector_resistance_Ohm=0.003,
    capacity_spread=0.02,
    resistance_spread=0.05,
    soc_spread=0.01,
)
CASE_S = 3600.0
# Seeds of the runs that identify.
_IDENTIFIED = (20_000, 20_001)


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            network, _ = models(cell, arguments.models)
            modules = identified(cell, network, arguments.layout)
            cases = [module_case(cell, arguments.layout, number) for number in range(arguments.cases)]
            rows += judge(cell, network, modules, cases)
    if arguments.json:
        print(json.dumps({"cases": arguments.cases, "rows": rows}))
    else:
        title = f"State of charge after convergence, modules, start up to {100 * LARGEST_START:.0f} points off"
        print_table(title, rows)
    return 0


def identified(cell: str, network: LocalModelNetwork, layout: ModuleLayout) -> dict[str, ModuleModel]:
    """Identify the four module models from the first runs."""
    size = layout.cells_in_series, layout.cells_in_parallel
    known = [
        ModuleRun(
            case.series.voltage_V,
            case.series.current_A,
            free_run_V(network, to_grid(as_cell_run(case.series, *size), DT_S), case.initial_soc),
        )
        for case in (module_case(cell, layout, seed) for seed in _IDENTIFIED)
    ]
    rest_A = 0.005 * cell_type(cell).parameters.capacity_Ah * layout.cells_in_parallel
    return {kind: identify_module(kind, known, *size, rest_A) for kind in KINDS}


def judge(
    cell: str, network: LocalModelNetwork, modules: dict[str, ModuleModel], cases: list[Case]
) -> list[dict[str, Any]]:
    """Figures of every module model over all cases, a row for each and sensor; offsets are those of one cell."""
    rows, curve = [], slope_over_soc(network)
    for sensor, offset_C, offset_V in SENSORS:
        known = replace(FuzzyObserver(network).settings, voltage_offset_std_V=offset_V)
        for kind, module in modules.items():
            seeing = ModuleObserver(FuzzyObserver(network, known), module)
            offset_A = module.cells_in_parallel * offset_C * network.cell.capacity_Ah
            volts = module.cells_in_series * offset_V
            each = [
                one_case(seeing, curve, *case, offset_A, volts, module.cells_in_series) for case in enumerate(cases)
            ]
            rows.append({"cell": cell, "sensor": sensor, "observer": f"module model {kind}", **summary(each)})
    return rows


def module_case(cell: str, layout: ModuleLayout, seed: int) -> Case:
    """Random load with rests and a stepping chamber on a module of its own spread."""
    rng = np.random.default_rng([15_485_863, seed])
    parameters = cell_type(cell).parameters
    initial_soc = float(rng.uniform(0.2, 0.9))
    n = round(CASE_S / DT_S) + 1
    current_A = layout.cells_in_parallel * load_A(n, parameters.capacity_Ah, initial_soc, rng)
    ambient_degC = chamber_degC(n, rng)
    module = Module(parameters, replace(layout, seed=seed), initial_soc, float(ambient_degC[0]))
    sensors = Sensors(SensorParameters(), rng)
    rows, soc = [], np.empty(n)
    for k, (current, degC) in enumerate(zip(current_A.tolist(), ambient_degC.tolist(), strict=True)):
        module.ambient_degC = degC
        truth = module.step(current, DT_S if k else 0.0)
        rows.append(sensors.measure(truth, current, degC))
        soc[k] = truth.soc
    voltage, measured, temperature, ambient = (np.array(column) for column in zip(*rows, strict=True))
    name = f"{cell} module {seed}"
    return Case(TimeSeries(np.arange(n) * DT_S, measured, voltage, temperature, ambient, soc, name), float(soc[0]))


def _layout(text: str) -> ModuleLayout:
    in_series, parallel = text.split("x")
    return replace(SPREAD, cells_in_series=int(in_series), cells_in_parallel=int(parallel))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", choices=("nmc", "lfp"), default=["nmc", "lfp"])
    parser.add_argument("--layout", type=_layout, default="4x1", help="cells in series x parallel")
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--models", type=Path, help="folder in which models of the cell are kept between runs")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
