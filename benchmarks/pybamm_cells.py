"""Free-run error on physics-based records, from training to validation of each case.

``python benchmarks/pybamm_cells.py --data FOLDER [--cases NAME ...] [--structure auto] [--json]``

Records of a single-particle model with electrolyte; each case's folder holds `base_ident` and `base_valid`. The model
is made from the first alone. Of the second, what lies inside the trained ranges of SoC, current and temperature is
judged; the rest is counted.
"""

import argparse
import json
import sys
from collections.abc import Iterator
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
from models.pipeline.fit import fit_network


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for row in cases(arguments.data, arguments.cases, arguments.structure):
            rows.append(row)
            print(json.dumps(row), file=sys.stderr, flush=True)
    if arguments.json:
        print(json.dumps({"records": "pybamm", "rows": rows}))
    else:
        _print(rows)
    return 0


def cases(data: Path, wanted: list[str] | None, structure: str) -> Iterator[dict[str, Any]]:
    """One row for each case."""
    folders = sorted(path for path in data.iterdir() if (path / "meta.json").exists())
    if missing := set(wanted or ()) - {folder.name for folder in folders}:
        raise SystemExit(f"{data}: no case {', '.join(sorted(missing))}; name the folder of the cases with --data")
    for folder in folders:
        if wanted and folder.name not in wanted:
            continue
        capacity_Ah = json.loads((folder / "meta.json").read_text())["capacity_Ah"]
        result = fit_network(_read(folder, "base_ident*"), capacity_Ah=capacity_Ah, structure=structure)
        yield {
            "case": folder.name,
            "train_rmse_mV": result.train["rmse_mV"],
            **_inside(result.network, folder),
            "n_local_models": result.network.partition.n_models,
            "candidates": len(result.candidates),
            "seconds": result.seconds,
        }


def _inside(network: LocalModelNetwork, folder: Path) -> dict[str, float | None]:
    """Error on the second record inside the trained ranges; None where the case has no such record."""
    if not list(folder.glob("base_valid*")):
        return {"inside_rmse_mV": None, "outside_share": None}
    judged = _read(folder, "base_valid*")
    compared = simulate_runs(network, judged, [start_soc(run) for run in judged])
    error = np.concatenate([each.residual_V for each in compared])
    inside = np.concatenate([each.inside for each in compared])[~np.isnan(error)]
    squared = error[~np.isnan(error)] ** 2
    return {
        "inside_rmse_mV": 1e3 * float(np.sqrt(squared[inside].mean())) if inside.any() else None,
        "outside_share": float(1.0 - inside.mean()),
    }


def _read(folder: Path, pattern: str) -> list[TimeSeries]:
    paths = sorted(folder.glob(pattern))
    if not paths:
        raise SystemExit(f"{folder}: no file like {pattern}; name the folder of the cases with --data")
    return [read_run(path) for path in paths]


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Free run, physics-based records")
    for name in rows[0]:
        table.add_column(name, justify="left" if name == "case" else "right")
    for row in rows:
        table.add_row(*(_text(value) for value in row.values()))
    Console().print(table)


def _text(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with a folder for each case")
    parser.add_argument("--cases", nargs="+", metavar="NAME", help="default: all")
    parser.add_argument("--structure", default="auto")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
