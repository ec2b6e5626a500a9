"""Free-run error on measured and physics-based records, with every file listed.

``python benchmarks/measured_cells.py panasonic --data FOLDER [--structures auto full minimal ...] [--json]``
``python benchmarks/measured_cells.py pybamm --data FOLDER [--cases NAME ...] [--json]``

`panasonic`: drive cycles of one NCR18650PF at 25 to -10 degC (P. Kollmeyer, doi:10.17632/wykht8y7tg.1). Trained on
`Cycle_*` and `NN`, judged on `US06` and `HW*`. Besides the structures by name: `full` as it was found, and the same
without its temperature axis, its hysteresis axis and its relaxation input, each with size and poles chosen again.

`pybamm`: records of a single-particle model with electrolyte; each case's folder holds `base_ident` and `base_valid`.
The model is made from the first alone. Of the second, what lies inside the trained ranges of SoC, current and
temperature is judged; the rest is counted.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run
from models.comparison.simulated_runs import simulate_runs
from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import Structure
from models.pipeline.fit import FitResult, fit_network

PANASONIC_CAPACITY_AH = 2.968
STRUCTURES = ("auto", "full", "minimal")
WITHOUT = ("temperature", "hysteresis", "relaxation")


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for row in {"panasonic": panasonic, "pybamm": pybamm}[arguments.records](arguments):
            rows.append(row)
            if not arguments.json:
                print(json.dumps(row), file=sys.stderr)
    if arguments.json:
        print(json.dumps({"records": arguments.records, "rows": rows}))
    else:
        _print(arguments.records, rows)
    return 0


def panasonic(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """One row for each structure."""
    train = _read(arguments.data, ("drive_*_Cycle_*", "drive_*_NN*"))
    judged = _read(arguments.data, ("drive_*_US06*", "drive_*_HW*"))

    def row(name: str, structure: str | Structure) -> tuple[dict[str, Any], FitResult]:
        result = fit_network(train, capacity_Ah=PANASONIC_CAPACITY_AH, structure=structure, validate=judged)
        assert result.validation is not None
        return {
            "structure": name,
            "held_out_rmse_mV": result.validation["rmse_mV"],
            "train_rmse_mV": result.train["rmse_mV"],
            "runs": {run["run"]: run["rmse_mV"] for run in result.validation_runs},
            "n_local_models": result.network.partition.n_models,
            "candidates": len(result.candidates),
            "seconds": result.seconds,
        }, result

    for name in arguments.structures:
        found, result = row(name, name)
        yield found
        if name == "full":
            for part in WITHOUT:
                yield row(f"full without {part}", without(result.network.structure, part))[0]


def without(structure: Structure, part: str) -> Structure:
    """Return the structure without the axes and inputs of one kind."""

    def keeps(signal: str) -> bool:
        return signal.partition(":")[0] != part

    return replace(
        structure,
        inputs=tuple(channel for channel in structure.inputs if keeps(channel.signal)),
        axes=tuple(axis for axis in structure.axes if keeps(axis.signal)),
        name=f"{structure.name} without {part}",
    )


def pybamm(arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """One row for each case."""
    folders = sorted(path for path in arguments.data.iterdir() if (path / "meta.json").exists())
    for folder in folders:
        if arguments.cases and folder.name not in arguments.cases:
            continue
        capacity_Ah = json.loads((folder / "meta.json").read_text())["capacity_Ah"]
        result = fit_network(_read(folder, ("base_ident*",)), capacity_Ah=capacity_Ah, structure="auto")
        yield {
            "case": folder.name,
            "train_rmse_mV": result.train["rmse_mV"],
            **_inside(result.network, folder),
            "n_local_models": result.network.partition.n_models,
            "candidates": len(result.candidates),
            "seconds": result.seconds,
        }


def _inside(network: LocalModelNetwork, folder: Path) -> dict[str, float]:
    """Error on the second record inside the trained ranges; NaN where the case has none."""
    if not list(folder.glob("base_valid*")):
        return {"inside_rmse_mV": float("nan"), "outside_share": float("nan")}
    judged = _read(folder, ("base_valid*",))
    compared = simulate_runs(network, judged, [start_soc(run) for run in judged])
    error = np.concatenate([each.residual_V for each in compared])
    inside = np.concatenate([each.inside for each in compared])[~np.isnan(error)]
    squared = error[~np.isnan(error)] ** 2
    return {
        "inside_rmse_mV": 1e3 * float(np.sqrt(squared[inside].mean())),
        "outside_share": float(1.0 - inside.mean()),
    }


def _read(folder: Path, patterns: tuple[str, ...]) -> list[TimeSeries]:
    paths = [path for pattern in patterns for path in sorted(folder.glob(pattern))]
    if not paths:
        raise SystemExit(f"{folder}: no file like {', '.join(patterns)}; name the folder with --data")
    return [read_run(path) for path in paths]


def _print(records: str, rows: list[dict[str, Any]]) -> None:
    table = Table(title=f"Free run, {records}")
    names = [name for name in rows[0] if name != "runs"]
    for name in names:
        table.add_column(name, justify="left" if isinstance(rows[0][name], str) else "right")
    for row in rows:
        table.add_row(*(f"{row[name]:.2f}" if isinstance(row[name], float) else str(row[name]) for name in names))
    Console().print(table)
    for row in rows:
        if "runs" in row:
            listed = ", ".join(f"{run} {rmse_mV:.1f}" for run, rmse_mV in row["runs"].items())
            Console().print(f"{row['structure']}: {listed} mV", soft_wrap=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("records", choices=("panasonic", "pybamm"))
    parser.add_argument("--data", type=Path, required=True, help="folder with the records")
    parser.add_argument("--structures", nargs="+", choices=STRUCTURES, default=list(STRUCTURES))
    parser.add_argument("--cases", nargs="+", help="of pybamm; default: all")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
