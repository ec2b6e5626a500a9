"""A sequential design played on a simulated cell: what each visit tells, and the hours saved at an asked accuracy.

``python benchmarks/design_sequential.py [--cell nmc] [--seed 0] [--target-std 5e-4] [--json]``

A pre-test gives a network of one local model, from which the first visit is designed. After each visit, a network of
six local models is fitted to what the visits measured, and the next visit is designed from it; its free run on a drive
cycle that no fit saw is compared with the noise-free voltage. The test ends when all levels have been visited and the
largest of the parameters' standard deviations (normalised units) is as small as asked.
"""

import argparse
import json
import sys
import time
from typing import Any

import numpy as np
from design_families import DT_S, INITIAL_SOC, LEVELS, SIX, drive_profile, limits_of
from rich.console import Console
from rich.table import Table
from simulated_cells import noise_V, play
from threadpoolctl import threadpool_limits

from models.data.metrics import metrics
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.design.optimise.block_design import DesignRequest
from models.design.optimise.reference_model import experiment_with, first_reference, pre_test
from models.design.optimise.sequential import sequential_design
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from simulators.catalogue import cell_type
from simulators.cell import Cell
from simulators.sensors import SensorParameters, Sensors

_AMBIENT_DEGC, _DURATION_S = 25.0, 14_000.0


class Bench:
    """A cell that goes on where the visit before has left it, and the log of all visits."""

    def __init__(self, cell: str, seed: int) -> None:
        self._cell = Cell(cell_type(cell).parameters, INITIAL_SOC, _AMBIENT_DEGC)
        self._sensors = Sensors(SensorParameters(), np.random.default_rng([seed, 2]))
        self._read = [self._sensors.measure(self._cell.step(0.0, 0.0), 0.0, _AMBIENT_DEGC)]

    def play(self, current_A: FloatArray, soc: float) -> TimeSeries:
        """Play currents and read the sensors; the first sample is the last of the visit before."""
        first = len(self._read) - 1
        for each in current_A.tolist():
            self._read.append(self._sensors.measure(self._cell.step(each, DT_S), each, _AMBIENT_DEGC))
        return self._series(first, soc)

    def log(self) -> TimeSeries:
        """All visits as one run."""
        return self._series(0, INITIAL_SOC)

    def _series(self, first: int, soc: float) -> TimeSeries:
        voltage_V, current_A, degC, ambient = (np.array(part) for part in zip(*self._read[first:], strict=True))
        time_s = DT_S * np.arange(len(voltage_V))
        return TimeSeries(time_s, current_A, voltage_V, degC, ambient, np.where(time_s == 0.0, soc, np.nan), "visits")


def main() -> int:
    arguments = _arguments()
    with threadpool_limits(1, user_api="blas"):
        result = run(arguments.cell, arguments.seed, arguments.target_std)
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0


def run(cell: str, seed: int, target_std: float) -> dict[str, Any]:
    """Play one sequential design."""
    capacity_Ah, limits = cell_type(cell).parameters.capacity_Ah, limits_of(cell)
    first = pre_test(limits, capacity_Ah, INITIAL_SOC, _DURATION_S, DT_S, seed)
    reference = first_reference([play(cell, first, (seed, 90)).series], capacity_Ah, DT_S)
    held_out = play(cell, drive_profile(capacity_Ah, np.random.default_rng([seed, 70])), (seed, 80))
    drive, bench, errors_mV = to_grid(held_out.series, DT_S), Bench(cell, seed), list[float]()

    def refit(_: list[TimeSeries], __: list[float]) -> LocalModelNetwork:
        # One log: a run by itself would be taken to begin at rest.
        network = fit_network([bench.log()], capacity_Ah=capacity_Ah, structure=SIX, dt_s=DT_S).network
        errors_mV.append(metrics(held_out.truth_V, free_run_V(network, drive, INITIAL_SOC))["rmse_mV"])
        return network

    experiment = experiment_with(reference, INITIAL_SOC, use_prior=False, noise_V=noise_V())
    began = time.process_time()
    request = DesignRequest(limits, _DURATION_S, soc_levels=LEVELS, seed=seed)
    found = sequential_design(experiment, request, target_std, bench.play, refit)
    hours = np.cumsum([len(each.current_A) for each in found.rounds]) * DT_S / 3600.0
    return {
        "cell": cell,
        "seed": seed,
        "target_std": target_std,
        "reached": found.reached,
        "played_h": found.played_s / 3600.0,
        "planned_h": found.planned_s / 3600.0,
        "saved_h": found.saved_h,
        "cpu_seconds": time.process_time() - began,
        "visits": [
            {"hours": h, "soc": r.soc, "largest_std": r.largest_std, "mean_std": r.mean_std, "drive_rmse_mV": e}
            for h, r, e in zip(hours.tolist(), found.rounds, errors_mV, strict=True)
        ],
    }


def _print(result: dict[str, Any]) -> None:
    table = Table(title=f"{result['cell']}, seed {result['seed']}: asked {result['target_std']:g}")
    for heading in ("hours", "SoC", "largest std", "mean std", "drive / mV"):
        table.add_column(heading)
    for row in result["visits"]:
        table.add_row(
            f"{row['hours']:.2f}",
            f"{row['soc']:.2f}",
            f"{row['largest_std']:.3g}",
            f"{row['mean_std']:.3g}",
            f"{row['drive_rmse_mV']:.2f}",
        )
    console = Console(width=100)
    console.print(table)
    end = "reached" if result["reached"] else "not reached"
    console.print(
        f"{end} after {result['played_h']:.2f} h of {result['planned_h']:.2f} h: {result['saved_h']:.2f} h saved",
        highlight=False,
    )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cell", default="nmc")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target-std", type=float, default=5e-4, help="of every parameter, normalised units")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
