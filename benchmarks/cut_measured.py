"""Measured logs that begin in the middle: each judged run of a split cut at random, from its state of charge there.

``python benchmarks/cut_measured.py --data FOLDER [--records NAME ...] [--only SPLIT ...] [--cuts 2] [--seed 0]``
``                                  [--json]``

Splits are those of `real_cells.toml`. A bounded network is fitted to the training runs of each; then every judged run
is cut somewhere between a tenth and a half of its samples. What is left is simulated as a part of the whole run, as if
it began at rest, and as `compare` does, from what its first minute says; RMS error in mV over the same samples.
"""

import argparse
import json
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from real_cells_table import Split, read_runs, read_table, splits_of
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.comparison.placed_runs import place_runs
from models.comparison.simulated_runs import RunComparison, beside, on_grid
from models.comparison.start import Start
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network

TABLE = Path(__file__).with_name("real_cells.toml")
WAYS = ("whole", "rest", "placed")


def main() -> int:
    arguments = _arguments()
    table = read_table(TABLE)
    splits = [
        split
        for name in arguments.records or list(table)
        for split in splits_of(name, table[name], arguments.data)
        if not arguments.only or split.name in arguments.only
    ]
    with threadpool_limits(1, user_api="blas"):
        rows = [row for split in splits for row in judge(split, arguments.cuts, arguments.seed)]
    median = {way: float(np.median([row[way] for row in rows])) for way in WAYS}
    if arguments.json:
        print(json.dumps({"rows": rows, "median_mV": median}))
    else:
        _show(rows, median)
    return 0


def judge(split: Split, cuts: int, seed: int) -> list[dict[str, Any]]:
    """Rows of a split, one for each cut of each judged run."""
    train, judged = read_runs(split, split.train), read_runs(split, split.judge)
    network = fit_network(
        train.series,
        capacity_Ah=split.capacity_Ah,
        structure="bounded",
        initial_soc=train.soc,
        dt_s=split.dt_s,
    ).network
    rows = []
    for number, (run, soc) in enumerate(zip(judged.series, judged.soc, strict=True)):
        rng = np.random.default_rng([seed, number])
        rows += [_row(network, split, (run, soc), float(share)) for share in rng.uniform(0.1, 0.5, cuts)]
        print(f"{split.record} {split.name} {run.name}", file=sys.stderr)
    return rows


def _row(network: LocalModelNetwork, split: Split, judged: tuple[TimeSeries, float], share: float) -> dict[str, Any]:
    run, soc = judged
    whole = on_grid(network, run)
    at = int(share * len(whole))
    own_soc = soc + float(whole.charge_Ah[at]) / network.cell.capacity_Ah
    log = _from(run, run.time_s[0] + whole.time_s[at] - whole.time_s[0])
    errors_mV = (
        _rms_mV(beside(network, whole, Start(soc)), at),
        _rms_mV(beside(network, on_grid(network, log), Start(own_soc))),
        _rms_mV(place_runs(network, [log], [own_soc])[0]),
    )
    named = {"record": split.record, "split": split.name, "run": run.name, "soc": own_soc}
    return named | dict(zip(WAYS, errors_mV, strict=True))


def _from(run: TimeSeries, time_s: float) -> TimeSeries:
    kept = run.time_s >= time_s
    columns = {each.name: getattr(run, each.name) for each in fields(run)}
    return replace(run, **{name: c[kept] for name, c in columns.items() if isinstance(c, np.ndarray)})


def _rms_mV(compared: RunComparison, first: int = 0) -> float:
    return 1e3 * float(np.sqrt(np.nanmean(compared.residual_V[first:] ** 2)))


def _show(rows: list[dict[str, Any]], median: dict[str, float]) -> None:
    table = Table("record", "split", "run", "SoC at the cut", "whole run mV", "from rest mV", "as compare has it mV")
    for row in rows:
        errors = [f"{row[way]:.1f}" for way in WAYS]
        table.add_row(row["record"], row["split"], row["run"], f"{row['soc']:.2f}", *errors)
    table.add_row("median", "", "", "", *(f"{median[way]:.1f}" for way in WAYS))
    Console(width=140).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", 1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with a folder for each record")
    parser.add_argument("--records", nargs="+", help="of real_cells.toml; all by default")
    parser.add_argument("--only", nargs="+", help="names of splits")
    parser.add_argument("--cuts", type=int, default=2, help="of each judged run")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
