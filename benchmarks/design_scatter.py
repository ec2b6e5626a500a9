"""Stated standard deviations of a designed test against the scatter of what is found when it is played.

``python benchmarks/design_scatter.py --data FOLDER [--records NAME ...] [--only SPLIT ...] [--plays 20] [--out ROWS]``

For each split of `real_cells.toml` a bounded network is fitted to the training runs, and a sequence is designed with it
over the window of charge and within the currents that it was trained in. The network plays the cell: its voltage plus
the errors that it makes on the held-out runs, these put together anew for each play (order, sign and place at random).
From each play the parameters that the design is about are found by least squares from what was known before, drawn for
each play from its own covariance. The scatter of what is found about the truth is held against what the design had
stated, and against what white noise of 1 mV would have had it state. Rows are kept in a file one by one; what is there
already is not done again.
"""

import argparse
import json
import sys
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from real_cells import TABLE
from real_cells_judged import fitted
from real_cells_table import Split, read_runs, read_table, splits_of
from rich.console import Console
from rich.table import Table
from row_file import add_row, read_rows
from scipy.linalg import cho_factor, cho_solve
from threadpoolctl import threadpool_limits

from models.comparison.simulated_runs import simulate_runs
from models.data.timeseries import FloatArray
from models.design.constraints.limits import Limits
from models.design.design import design
from models.design.information.experiment import Evaluator, Experiment
from models.design.information.parameters import parameter_std
from models.design.optimise.block_design import DesignRequest
from models.design.optimise.reference_model import experiment_with
from models.network.local_model_network import LocalModelNetwork

_LEVELS, _DURATION_S = 8, (14_400.0, 100_000.0)
_WHITE_V = 1e-3
_RECORDS = ["panasonic_18650pf", "a123_esc", "pybatteryid_nmc", "lgm50_rate"]


def main() -> int:
    arguments = _arguments()
    table, rows = read_table(TABLE), read_rows(arguments.out)
    with threadpool_limits(1, user_api="blas"):
        for name in arguments.records:
            for split in splits_of(name, table[name], arguments.data):
                at = {"record": split.record, "split": split.name}
                wanted = any(fnmatchcase(split.name, only) for only in arguments.only)
                if not wanted or any(row["record"] == name and row["split"] == split.name for row in rows):
                    continue
                row = at | judge(split, arguments)
                rows.append(row)
                add_row(arguments.out, row)
                print(json.dumps(row), file=sys.stderr, flush=True)
    if arguments.json:
        print(json.dumps({"rows": rows}))
    else:
        _print(rows)
    return 0


def judge(split: Split, arguments: argparse.Namespace) -> dict[str, Any]:
    """Fit, design, play, and compare."""
    train, held_out = read_runs(split, split.train), read_runs(split, split.judge)
    network, _ = fitted(split, train, "bounded")
    assert isinstance(network, LocalModelNetwork)
    compared = simulate_runs(network, held_out.series, held_out.soc)
    errors = [_known_part(each.run.voltage_V - each.simulated_V) for each in compared]
    domain = network.record.domain
    soc, current_A = domain["soc"], domain["current_A"]
    request = DesignRequest(
        Limits(current_A, (max(soc[0], 0.0), min(soc[1], 1.0))),
        duration_s(soc, current_A, split.capacity_Ah),
        soc_levels=tuple(np.linspace(*soc, _LEVELS + 2)[1:-1].tolist()),
    )
    experiment = experiment_with(network, float(np.mean(soc)))
    found = design(experiment, request)
    stated = np.array(list(found.parameter_std.values()))
    white = replace(experiment, memory=None, level_V=None, noise_V=_WHITE_V)
    before = parameter_std(Evaluator(white, len(found.current_A)).information(found.current_A))
    scatter = scatter_of(experiment, found.current_A, errors, arguments.plays)
    return {
        "held_out_mV": 1e3 * float(np.sqrt(np.mean(np.concatenate(errors) ** 2))),
        "stated_noise_mV": 1e3 * experiment.noise_V,
        "parameters": len(stated),
        "scatter_over_stated": float(np.median(scatter / stated)),
        "low": float(np.percentile(scatter / stated, 10)),
        "high": float(np.percentile(scatter / stated, 90)),
        "within_2": float(((scatter / stated > 0.5) & (scatter / stated < 2.0)).mean()),
        "scatter_over_white": float(np.median(scatter / before)),
        "design_seconds": found.seconds,
    }


def duration_s(soc: tuple[float, float], current_A: tuple[float, float], capacity_Ah: float) -> float:
    """Three times as long as the way down and up the window takes at the smaller of the largest currents."""
    way_s = 2.5 * (soc[1] - soc[0]) * 3600.0 * capacity_Ah / min(-current_A[0], current_A[1])
    return float(np.clip(3.0 * way_s, *_DURATION_S))


def scatter_of(experiment: Experiment, current_A: FloatArray, errors: list[FloatArray], plays: int) -> FloatArray:
    """(P,) root mean square of what is found less the truth, normalised units."""
    rows = Evaluator(experiment, len(current_A)).predict(current_A).sensitivity_V
    prior, variance = experiment.prior_information(), experiment.working_V**2
    whole = cho_factor(prior + rows.T @ rows / variance)
    spread = np.linalg.cholesky(np.linalg.inv(prior))
    found = []
    for play in range(plays):
        rng = np.random.default_rng([play, 7])
        error = played_error(errors, len(current_A), rng)
        believed = spread @ rng.standard_normal(len(prior))
        found.append(cho_solve(whole, prior @ believed + rows.T @ error / variance))
    return np.sqrt(np.mean(np.square(found), axis=0))


def played_error(errors: list[FloatArray], count: int, rng: np.random.Generator) -> FloatArray:
    """(count,) errors of the held-out runs in another order, each from another place on and with another sign."""
    parts: list[FloatArray] = []
    while sum(len(part) for part in parts) < count:
        for number in rng.permutation(len(errors)).tolist():
            moved = np.roll(errors[number], int(rng.integers(len(errors[number]))))
            parts.append(float(rng.choice([-1.0, 1.0])) * moved)
    return np.concatenate(parts)[:count]


def _known_part(error_V: FloatArray) -> FloatArray:
    return error_V[~np.isnan(error_V)]


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="Scatter over 20 plays, over the stated standard deviation: median, 10 and 90 %")
    for heading in (
        "record",
        "split",
        "held out / mV",
        "stated noise / mV",
        "scatter / stated",
        "within 2",
        "1 mV white",
    ):
        table.add_column(heading)
    for row in rows:
        table.add_row(
            row["record"],
            row["split"],
            f"{row['held_out_mV']:.1f}",
            f"{row['stated_noise_mV']:.1f}",
            f"{row['scatter_over_stated']:.2f} ({row['low']:.2f} to {row['high']:.2f})",
            f"{100.0 * row['within_2']:.0f} %",
            f"{row['scatter_over_white']:.0f}",
        )
    Console(width=120).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path("data"), help="folder with the folders of the records")
    parser.add_argument("--records", nargs="+", metavar="NAME", default=_RECORDS)
    parser.add_argument("--only", nargs="+", metavar="SPLIT", default=["*"], help="splits by name or pattern")
    parser.add_argument("--plays", type=int, default=20)
    parser.add_argument("--out", type=Path, help="rows so far, one JSON object a line; read, and added to")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
