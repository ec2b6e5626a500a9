"""What each family of test signals is worth on simulated cells: parameter accuracy, and the error on drive cycles.

``python benchmarks/design_families.py [--cells nmc lfp] [--seeds 10] [--structure six] [--json]``

All signals last the same time within -2C..1C, SoC 0.1..0.9 and the cell's voltage limits, from SoC 0.5 at rest. The
designed one is a whole sequence, pulses and rests included. Its reference model comes from a pre-test of the same cell
with other noise, of which only a network of one local model is made (``optimal``), or one with the structure that its
data choose (``optimal, fitted reference``); ``optimal, round 2`` is designed with the network that was fitted to the
first designed run, ``optimal, load cycle`` within the currents' histogram of a drive of the same kind as those that
judge. Each signal is played on the cell, a network is fitted to what the sensors read, and its free run on drive cycles
that no fit has seen is compared with the noise-free voltage.
Parameter standard deviations are the Cramer-Rao bounds of one and the same network of the cell for all signals, as
geometric mean; a network of 6 local models along the SoC with relaxation, fitted to two other runs. With the same
network, the error on the drive cycles that noise alone leaves: what remains beside it is the structure's.
"""

import argparse
import json
import sys
import time
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from simulated_cells import noise_V, play
from threadpoolctl import threadpool_limits

from models.data.metrics import metrics
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray
from models.design import Profile, StepProfileRequest, step_profile
from models.design.answer import even_cycle
from models.design.constraints.limits import Limits
from models.design.design import Design, design
from models.design.information.experiment import Evaluator, Experiment
from models.design.information.parameters import parameter_std
from models.design.optimise.block_design import DesignRequest
from models.design.optimise.reference_model import experiment_with, first_reference, pre_test
from models.design.sequence.excitation_sequence import compact_profile
from models.design.test_signals import find_families
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from simulators.catalogue import cell_type

DT_S, INITIAL_SOC = 1.0, 0.5
C_RATES, SOC = (-2.0, 1.0), (0.1, 0.9)
LEVELS = tuple(np.linspace(0.12, 0.85, 8).round(3).tolist())
_PRE_TEST_S = 14_000.0
_DRIVE_S, _DRIVE_SOC = 5000.0, 0.5
SIX = Structure(
    output_order=1,
    inputs=(InputChannel("soc", delay=1), InputChannel("current", order=1), InputChannel("relaxation:600")),
    axes=(PartitionAxis("soc", initial=6, splittable=False, k_sigma=0.5),),
    dt_s=DT_S,
    name="six",
)
OPTIMAL, FITTED, SECOND, BOUNDED = "optimal", "optimal, fitted reference", "optimal, round 2", "optimal, load cycle"
_DESIGNED = ("first", "fitted", "second", "cycle")


def main() -> int:
    arguments = _arguments()
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            judge_network = _judge_network(cell)
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                for row in judge(cell, seed, arguments, judge_network):
                    rows.append(row)
                    print(
                        f"{cell} {seed} {row['signal']}: std {row['parameter_std']:.3g}, "
                        f"{row['drive_rmse_mV']:.2f} mV on drive cycles, {row['drive_noise_mV']:.4f} mV of it by noise",
                        file=sys.stderr,
                        flush=True,
                    )
    result = {"structure": arguments.structure, "rows": rows, "summary": _summary(rows)}
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result["summary"])
    return 0


def judge(
    cell: str, seed: int, arguments: argparse.Namespace, judge_network: LocalModelNetwork
) -> list[dict[str, Any]]:
    """All signals on one cell with one seed."""
    limits = limits_of(cell)
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    first = pre_test(limits, capacity_Ah, INITIAL_SOC, _PRE_TEST_S, DT_S, seed)
    pre_run = play(cell, first, (seed, 90)).series
    reference = first_reference([pre_run], capacity_Ah, DT_S)
    drives = [drive_profile(capacity_Ah, np.random.default_rng([seed, 70 + i])) for i in range(2)]
    held_out = [play(cell, drive, (seed, 80 + i)) for i, drive in enumerate(drives)]
    rows = []

    def add(signal: str, found: Design, number: int) -> LocalModelNetwork:
        began = time.perf_counter()
        run = play(cell, found.profile(), (seed, number))
        structure = SIX if arguments.structure == SIX.name else arguments.structure
        network = fit_network([run.series], capacity_Ah=capacity_Ah, structure=structure, dt_s=DT_S).network
        errors = []
        for drive in held_out:
            grid = to_grid(drive.series, DT_S)
            errors.append(metrics(drive.truth_V, free_run_V(network, grid, INITIAL_SOC))["rmse_mV"])
        row = {
            "cell": cell,
            "seed": seed,
            "signal": signal,
            "duration_s": found.duration_s,
            "parameter_std": _mean_std(judge_network, found.current_A),
            "drive_noise_mV": _noise_error_mV(judge_network, found.current_A, drives),
            "drive_rmse_mV": float(np.sqrt(np.mean(np.square(errors)))),
            "voltage_exceeded_mV": 1e3 * _exceeded(run.truth_V, limits),
            "design_seconds": found.seconds,
            "fit_seconds": time.perf_counter() - began,
        }
        rows.append(row)
        return network

    # Another drive of the same kind: what the designer is told of the use, and what the drive cycle family replays.
    known = drive_profile(capacity_Ah, np.random.default_rng([seed, 60]))
    cycle_A, _ = even_cycle(known.time_s, known.current_A)
    experiment = experiment_with(reference, INITIAL_SOC, use_prior=False, noise_V=noise_V())
    request = DesignRequest(limits, arguments.duration_s, soc_levels=LEVELS, seed=seed)
    if "first" in arguments.designed or "second" in arguments.designed:
        fitted = add(OPTIMAL, design(experiment, request), 0)
        if "second" in arguments.designed:
            again = experiment_with(fitted, INITIAL_SOC, use_prior=False, noise_V=noise_V())
            add(SECOND, design(again, request), 1)
    if "cycle" in arguments.designed:
        bounded = DesignRequest(limits, arguments.duration_s, soc_levels=LEVELS, cycle_A=cycle_A, seed=seed)
        add(BOUNDED, design(experiment, bounded), 2)
    if "fitted" in arguments.designed:
        network = fit_network([pre_run], capacity_Ah=capacity_Ah, structure="auto", dt_s=DT_S).network
        rich = experiment_with(network, INITIAL_SOC, use_prior=False, noise_V=noise_V())
        add(FITTED, design(rich, request), 3)
    for number, name in enumerate(find_families()):
        if arguments.families is not None and name not in arguments.families:
            continue
        asked = DesignRequest(
            limits, arguments.duration_s, signal=name, cycle_A=cycle_A, final_rest_s=arguments.family_rest_s, seed=seed
        )
        add(name, design(experiment, asked), 10 + number)
    return rows


def limits_of(cell: str) -> Limits:
    """Limits of the tests."""
    kind = cell_type(cell)
    capacity_Ah = kind.parameters.capacity_Ah
    return Limits((C_RATES[0] * capacity_Ah, C_RATES[1] * capacity_Ah), SOC, voltage_V=kind.limits.voltage_V)


def drive_profile(capacity_Ah: float, rng: np.random.Generator) -> Profile:
    """Short trips: acceleration, cruise, braking with recuperation, standing; charged back in between."""
    current, charge = [], 0.0
    while len(current) < _DRIVE_S:
        up, cruise, down, stand = (int(rng.integers(low, high)) for low, high in ((4, 15), (5, 60), (4, 12), (3, 40)))
        hard = rng.uniform(0.5, 2.0)
        trip = [
            *(-hard * capacity_Ah * rng.uniform(0.8, 1.0, up)),
            *(-rng.uniform(0.1, 0.6) * capacity_Ah * rng.uniform(0.7, 1.3, cruise)),
            *(rng.uniform(0.2, 0.9) * capacity_Ah * rng.uniform(0.7, 1.0, down)),
            *np.zeros(stand),
        ]
        charge += sum(trip) / 3600.0 / capacity_Ah
        current += trip
        if charge < -0.25:
            count = int(0.4 * 3600.0 / 0.8)
            current += [0.8 * capacity_Ah] * count
            charge += 0.4
    return compact_profile(np.array(current), DT_S)


def _judge_network(cell: str) -> LocalModelNetwork:
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    current = (C_RATES[0] * capacity_Ah, C_RATES[1] * capacity_Ah)
    request = StepProfileRequest(capacity_Ah, current, SOC, INITIAL_SOC, 20_000.0, DT_S)
    runs = [play(cell, step_profile(request, np.random.default_rng([5, i])), (5, i)).series for i in range(2)]
    return fit_network(runs, capacity_Ah=capacity_Ah, structure=SIX, dt_s=DT_S).network


def _mean_std(network: LocalModelNetwork, current_A: FloatArray) -> float:
    experiment = Experiment(network, INITIAL_SOC, noise_V(), 25.0)
    return float(np.exp(np.log(parameter_std(Evaluator(experiment, len(current_A)).information(current_A))).mean()))


def _noise_error_mV(network: LocalModelNetwork, current_A: FloatArray, drives: list[Profile]) -> float:
    """Error on the drives that the sensors' noise alone leaves: what a test is worth where the structure is right."""
    experiment = Experiment(network, INITIAL_SOC, noise_V(), 25.0)
    information = Evaluator(experiment, len(current_A)).information(current_A)
    squares = []
    for drive in drives:
        cycle_A, _ = even_cycle(drive.time_s, drive.current_A)
        psi = Evaluator(experiment, len(cycle_A)).predict(cycle_A).sensitivity_V
        squares.append(float(np.mean(np.einsum("kp,pk->k", psi, np.linalg.solve(information, psi.T)))))
    return 1e3 * float(np.sqrt(np.mean(squares)))


def _exceeded(voltage_V: FloatArray, limits: Limits) -> float:
    assert limits.voltage_V is not None
    return float(max(limits.voltage_V[0] - voltage_V.min(), voltage_V.max() - limits.voltage_V[1], 0.0))


def _summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    out = []
    for cell in dict.fromkeys(row["cell"] for row in rows):
        for signal in dict.fromkeys(row["signal"] for row in rows):
            own = [row for row in rows if row["cell"] == cell and row["signal"] == signal]
            keys = ("parameter_std", "drive_noise_mV", "drive_rmse_mV")
            stds, noise, errors = (np.array([row[key] for row in own]) for key in keys)
            out.append(
                {
                    "cell": cell,
                    "signal": signal,
                    "seeds": len(own),
                    "parameter_std": float(np.exp(np.log(stds).mean())),
                    "drive_noise_mV": float(noise.mean()),
                    "drive_rmse_mV": float(errors.mean()),
                    "drive_rmse_worst_mV": float(errors.max()),
                    "voltage_exceeded_mV": max(row["voltage_exceeded_mV"] for row in own),
                }
            )
    return out


def _print(summary: list[dict[str, Any]]) -> None:
    table = Table(title="Test signals of the same duration")
    for heading in (
        "cell",
        "signal",
        "std (geometric mean)",
        "over optimal",
        "drive cycles / mV",
        "worst",
        "V over / mV",
    ):
        table.add_column(heading)
    best = {row["cell"]: row["parameter_std"] for row in summary if row["signal"] == OPTIMAL}
    for row in summary:
        table.add_row(
            row["cell"],
            row["signal"],
            f"{row['parameter_std']:.3g}",
            f"{row['parameter_std'] / best[row['cell']]:.2f}",
            f"{row['drive_noise_mV']:.4f}",
            f"{row['drive_rmse_mV']:.2f}",
            f"{row['voltage_exceeded_mV']:.1f}",
        )
    Console(width=130).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", nargs="+", default=["nmc", "lfp"])
    parser.add_argument("--families", nargs="*", help="literature families; default: all")
    parser.add_argument("--designed", nargs="*", choices=_DESIGNED, default=_DESIGNED, help="default: all")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--structure", default=SIX.name, help="six: the judging network's; or full, minimal, auto")
    parser.add_argument("--duration-s", type=float, default=14_000.0)
    parser.add_argument(
        "--family-rest-s",
        type=float,
        default=0.0,
        help="rest that ends the literature families, part of their time",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
