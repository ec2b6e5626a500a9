"""Logs that begin anywhere: simulated cells, each log cut out of a longer one at a random moment.

``python benchmarks/cut_logs.py [--cells nmc lfp nimh] [--seeds 3] [--first-seed 0] [--train-logs 1]``
``                              [--structure auto] [--json]``

A log begins in a pulse, in a relaxation, on either branch of the hysteresis loop, wherever the cut falls in the first
5000 s of multi-level steps; 14 000 s of it are kept. The model is fitted to one of them or more and judged on others,
once with the state of charge at the cut as it was, once stated `OFF_SOC` off, with a standard deviation as large. What
lies inside the trained ranges stands apart: a log that was cut may leave states of charge to the others. In-class: the
cells are those of `simulators`.
"""

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from models.comparison.figures import compare
from models.comparison.placed_runs import fit_starts, place_runs
from models.data.timeseries import TimeSeries
from models.network.local_model_network import LocalModelNetwork
from models.pipeline import STRUCTURES, fit_network
from simulators.catalogue import CELLS

sys.path.insert(0, str(Path(__file__).parent))
from simulated_cells import DT_S, INITIAL_SOC, noise_V, simulated_run

LENGTH_S = 14000.0
CUT_S = (600.0, 5000.0)
OFF_SOC = 0.05
N_JUDGED = 3


@dataclass(frozen=True)
class CutLog:
    """A log with its true state of charge at the first sample, and the current that flows there."""

    series: TimeSeries
    soc: float
    first_A: float
    capacity_Ah: float


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                rows.append(judge(cell, seed, arguments.structure, arguments.train_logs))
                if not arguments.json:
                    print(_line(rows[-1]), flush=True)
    if arguments.json:
        print(json.dumps(rows))
    return 0


def judge(cell: str, seed: int, structure: str, n_train: int = 1) -> dict[str, Any]:
    """Fit to cut logs; errors, bands and states of charge found of `N_JUDGED` others, the same however many train."""
    judged = [cut_log(cell, seed, number) for number in range(1, 1 + N_JUDGED)]
    train = [cut_log(cell, seed, number) for number in (0, *range(1 + N_JUDGED, N_JUDGED + n_train))]
    network = fit_network(
        [log.series for log in train],
        capacity_Ah=train[0].capacity_Ah,
        structure=structure,
        initial_soc=[log.soc for log in train],
        dt_s=DT_S,
    ).network
    series = [log.series for log in judged]
    known = compare(network, series, [log.soc for log in judged], [1e-3] * N_JUDGED)
    side = [(-1.0) ** k for k in range(N_JUDGED)]
    stated = [log.soc + OFF_SOC * each for log, each in zip(judged, side, strict=True)]
    doubted = compare(network, series, stated, [OFF_SOC] * N_JUDGED)
    found = [run["initial_soc"] for run in doubted["runs"]]
    band = known["band"]
    noise_mV = 1e3 * noise_V()
    return {
        "cell": cell,
        "seed": seed,
        "structure": network.structure.name,
        "begins_at_A": [log.first_A for log in (*train, *judged)],
        "first_minute_over_noise": known["overall"]["rmse_mV"] / noise_mV,
        "fitted_start_over_noise": known["overall_fitted_start"]["rmse_mV"] / noise_mV,
        **_inside(network, judged, noise_mV),
        "band_holds": None if band is None else band["coverage_95"],
        "off_fitted_start_over_noise": doubted["overall_fitted_start"]["rmse_mV"] / noise_mV,
        "soc_error": [float(each["value"] or 0.0) - log.soc for each, log in zip(found, judged, strict=True)],
        "soc_std": [each["std"] for each in found],
    }


def _inside(network: LocalModelNetwork, judged: list[CutLog], noise_mV: float) -> dict[str, Any]:
    """Error inside the trained ranges from fitted starts over the noise, and the share of samples that lies there."""
    placed = place_runs(network, [log.series for log in judged], [log.soc for log in judged])
    fitted = fit_starts(network, placed, [1e-3] * len(judged))
    inside = np.concatenate([each.inside for each in fitted])
    error_mV = 1e3 * np.concatenate([each.residual_V for each in fitted])[inside]
    return {
        "inside_over_noise": float(np.sqrt(np.nanmean(error_mV**2))) / noise_mV if inside.any() else None,
        "inside_share": float(inside.mean()),
    }


def cut_log(cell: str, seed: int, number: int) -> CutLog:
    """A log from a random moment of a longer run on; the same seed and number give the same one."""
    whole = simulated_run(cell, seed, number, CUT_S[1] + LENGTH_S)
    rng = np.random.default_rng([seed, number, 2])
    begin = round(float(rng.uniform(*CUT_S)) / DT_S)
    kept = slice(begin, begin + round(LENGTH_S / DT_S) + 1)
    series = whole.series
    # The simulated current sensor has no offset: what it reads is, in the sum, what flowed.
    moved_Ah = float(np.sum(series.current_A[1 : begin + 1])) * DT_S / 3600.0
    log = replace(
        series,
        time_s=series.time_s[kept] - series.time_s[begin],
        current_A=series.current_A[kept],
        voltage_V=series.voltage_V[kept],
        temperature_degC=series.temperature_degC[kept],
        ambient_degC=None if series.ambient_degC is None else series.ambient_degC[kept],
        soc_ref=None,
    )
    return CutLog(log, INITIAL_SOC + moved_Ah / whole.capacity_Ah, float(series.current_A[begin]), whole.capacity_Ah)


def _line(row: dict[str, Any]) -> str:
    off = max(abs(each) for each in row["soc_error"])
    return (
        f"{row['cell']} seed {row['seed']} ({row['structure']}): {row['first_minute_over_noise']:.2f} x noise from the "
        f"first minute, {row['fitted_start_over_noise']:.2f} from all "
        f"({row['inside_over_noise']:.2f} on the {100.0 * row['inside_share']:.0f} % inside), "
        f"band holds {100.0 * row['band_holds']:.1f} %; "
        f"stated {100.0 * OFF_SOC:.0f} points off: {row['off_fitted_start_over_noise']:.2f} x, "
        f"state of charge found to {100.0 * off:.2f} points"
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="simulated logs that begin anywhere")
    parser.add_argument("--cells", nargs="+", choices=CELLS, default=list(CELLS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--train-logs", type=int, default=1, help="logs that the model is fitted to")
    parser.add_argument("--structure", choices=STRUCTURES, default="auto")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
