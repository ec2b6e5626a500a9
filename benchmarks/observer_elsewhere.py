"""State of charge of measured cells at temperatures that their models were never at, in one table.

``python benchmarks/observer_elsewhere.py --data FOLDER [--only RECORD/SPLIT ...] [--start-off -0.2] [--json]``

Splits stand in `observer_elsewhere.toml`. A bounded network is identified and its observer tuned on the training runs;
each judged run is observed from a stated state of charge that is so much off, once as the product does it and once as
if the model had been trained at every temperature. Error and share of the samples in the 95 % band count from a tenth
of the run on, against the files' own counter.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from real_cells_table import Runs, Split, read_runs, read_table, splits_of
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.data.resampling import GridRun, to_grid
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.observer.tuning.tuning import with_tuned_observer
from models.pipeline.fit import fit_network
from models.uncertainty.bands import NORMAL_95

_TABLE = Path(__file__).with_suffix(".toml")
KINDS = ("present", "as if trained everywhere")


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for name, record in read_table(_TABLE).items():
            for split in splits_of(name, record, arguments.data):
                if not arguments.only or f"{name}/{split.name}" in arguments.only:
                    for row in _rows(split, arguments.start_off):
                        rows.append(row)
                        print(json.dumps(row), file=sys.stderr, flush=True)
    if not rows:
        print(f"none of {', '.join(arguments.only)} is in {_TABLE.name}", file=sys.stderr)
        return 2
    if arguments.json:
        print(json.dumps(rows))
    else:
        _show(rows)
    return 0


def _rows(split: Split, start_off: float) -> Iterator[dict[str, Any]]:
    train, judge = read_runs(split, split.train), read_runs(split, split.judge)
    network = _model(split, train)
    domain = {name: ends for name, ends in network.record.domain.items() if name != "temperature_degC"}
    everywhere = replace(network, record=replace(network.record, domain=domain))
    for run, soc in zip(judge.with_reference(split.capacity_Ah), judge.soc, strict=True):
        grid = to_grid(run, network.dt_s)
        for kind, model in zip(KINDS, (network, everywhere), strict=True):
            figures = _figures(FuzzyObserver(model), grid, soc + start_off)
            yield {"record": split.record, "split": split.name, "run": run.name, "observer": kind, **figures}


def _model(split: Split, train: Runs) -> LocalModelNetwork:
    fitted = fit_network(
        train.series, capacity_Ah=split.capacity_Ah, structure="bounded", initial_soc=train.soc, dt_s=split.dt_s
    )
    return with_tuned_observer(fitted.network, train.series, train.soc)


def _figures(observer: FuzzyObserver, run: GridRun, start: float) -> dict[str, float]:
    _, rows = observer.replay(observer.initial(start), run.current_A, run.voltage_V, run.temperature_degC)
    assert run.soc_ref is not None
    known = np.flatnonzero(~np.isnan(run.soc_ref))
    late = known[known >= len(run) // 10]
    error, std = rows[late, 0] - run.soc_ref[late], rows[late, 1]
    return {
        "soc_rmse": float(np.sqrt(np.mean(error**2))),
        "end_error": float(error[-1]),
        "coverage_95": float(np.mean(np.abs(error) <= NORMAL_95 * std)),
        "mean_std": float(std.mean()),
    }


def _show(rows: list[dict[str, Any]]) -> None:
    table = Table(title="RMS error of the SoC in %, share in the 95 % band, mean stated standard deviation in %")
    for column in ("record", "split", "run", *KINDS):
        table.add_column(column)
    for one in range(0, len(rows), len(KINDS)):
        pair = rows[one : one + len(KINDS)]
        said = [f"{100 * r['soc_rmse']:.2f}  {100 * r['coverage_95']:.0f} %  {100 * r['mean_std']:.2f}" for r in pair]
        table.add_row(pair[0]["record"], pair[0]["split"], pair[0]["run"], *said)
    Console(width=140).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, metavar="FOLDER", help="of measured records")
    parser.add_argument("--only", nargs="+", metavar="RECORD/SPLIT", help="of the splits")
    parser.add_argument("--start-off", type=float, default=-0.2, help="stated less true state of charge at the start")
    parser.add_argument("--json", action="store_true", help="print one JSON array and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
