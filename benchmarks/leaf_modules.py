"""A measured module with each of the module models S1 to S4: error of each, the observer on it, and its weak group.

``python benchmarks/leaf_modules.py MODULES [--cell-tests CELLS] [--structure auto] [--json]``

MODULES holds the discharges of three used Nissan Leaf modules in series (6 groups of 2 cells; NREL, in
github.com/batterysim/equiv-circ-model, MIT) as discharge_RATE.csv.gz. Each run in turn is left out of everything and
judged by what the others say: with the mean cell identified from the module's own runs, or, with `--cell-tests`, with
a model from tests of one new cell of the type (Wiggins, Allu, Wang, Oak Ridge, doi:10.5281/zenodo.2580327; CELLS holds
hppc_TEMPERATUREdegC.csv.gz).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from leaf_resistance import TEMPERATURES_DEGC, from_full
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run, read_run_file
from models.comparison.module_models import compare_module
from models.module.log import ModuleLog
from models.module.network import ModuleNetwork
from models.network.local_model_network import LocalModelNetwork
from models.observer.module.tuning import module_observer, with_tuned_module
from models.observer.observation import observe
from models.observer.tuning.tuning import with_tuned_observer
from models.pipeline.fit import fit_network
from models.pipeline.module.fit import ModuleFitRequest, fit_module

CAPACITY_AH, CELL_AH, LAYOUT = 55.4, 30.6, (6, 2)
START_OFF = -0.2


def main() -> int:
    arguments = _arguments()
    logs = [_log(path) for path in sorted(arguments.modules.glob("discharge_*.csv.gz"))]
    with threadpool_limits(1, user_api="blas"):
        cell = None if arguments.cell_tests is None else _cell(arguments.cell_tests, arguments.structure)
        rows = [_judged(logs, number, cell, arguments.structure) for number in range(len(logs))]
    if arguments.json:
        print(json.dumps({"runs": rows}))
    else:
        _print(rows)
    return 0


def _log(path: Path) -> ModuleLog:
    read = read_run_file(path, "charge-positive")
    return ModuleLog(read.series, read.cells_V)


def _cell(folder: Path, structure: str) -> LocalModelNetwork:
    print("fitting the cell ...", file=sys.stderr, flush=True)
    runs = [from_full(read_run(folder / f"hppc_{degC}degC.csv.gz")) for degC in TEMPERATURES_DEGC]
    fitted = fit_network(runs, capacity_Ah=CELL_AH, structure=structure, dt_s=1.0)
    return with_tuned_observer(fitted.network, runs, fitted.initial_soc)


def _judged(logs: list[ModuleLog], left_out: int, cell: LocalModelNetwork | None, structure: str) -> dict[str, Any]:
    judged = logs[left_out]
    print(f"leaving out {judged.run.name} ...", file=sys.stderr, flush=True)
    train = [log for number, log in enumerate(logs) if number != left_out]
    in_series, parallel = LAYOUT
    asked = ModuleFitRequest(
        train=train, capacity_Ah=CAPACITY_AH, in_series=in_series, parallel=parallel, cell=cell, structure=structure
    )
    fitted = fit_module(asked)
    compared = compare_module(fitted.model, [judged], [1.0])
    weak = fitted.model.record.weak_group
    model = with_tuned_module(fitted.model, [log.run for log in train], fitted.initial_soc)
    return {
        "run": judged.run.name,
        "chosen": fitted.model.module.kind,
        "resistance_Ohm": fitted.model.module.resistance_Ohm[1],
        "offset_V": fitted.model.module.offset_V[1],
        "trained_mV": {each["kind"]: each["train"]["rmse_mV"] for each in fitted.model.record.compared},
        "judged_mV": {each["kind"]: each["overall"]["rmse_mV"] for each in compared["models"]},
        "weak_group": None if weak is None else weak["group"],
        "weak_group_on_judged": compared["weak_group"] and compared["weak_group"]["group"],
        "text": None if weak is None else weak["text"],
        "soc": {gain: _soc(model, judged, gain) for gain in ("kalman", "steady")},
    }


def _soc(model: ModuleNetwork, log: ModuleLog, gain: str) -> float:
    """RMS of the state of charge against the tester's counter, from a tenth of the run on."""
    found = observe(module_observer(model, gain), log.run, 1.0 + START_OFF, None)
    assert found.soc_ref is not None
    late = slice(len(found.soc) // 10, None)
    return float(np.sqrt(np.nanmean((found.soc[late] - found.soc_ref[late]) ** 2)))


def _print(rows: list[dict[str, Any]]) -> None:
    kinds = list(rows[0]["judged_mV"])
    table = Table(title="Each run judged by what the others say: RMSE of the module's voltage in mV (on the others)")
    heads = ("left out", *kinds, "taken", "R / mOhm", "V0 / mV", "weak group", "SoC RMS % kalman", "steady")
    for heading in heads:
        table.add_column(heading, justify="left" if heading == "left out" else "right")
    for row in rows:
        table.add_row(
            row["run"],
            *(f"{row['judged_mV'][kind]:.1f} ({row['trained_mV'][kind]:.1f})" for kind in kinds),
            row["chosen"],
            f"{1e3 * row['resistance_Ohm']:.3f}",
            f"{1e3 * row['offset_V']:.1f}",
            f"{row['weak_group']} ({row['weak_group_on_judged']})",
            *(f"{100 * row['soc'][gain]:.2f}" for gain in ("kalman", "steady")),
        )
    Console(width=150).print(table)
    print(rows[0]["text"])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("modules", type=Path, metavar="MODULES")
    parser.add_argument("--cell-tests", type=Path, metavar="CELLS")
    parser.add_argument("--structure", default="bounded")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
