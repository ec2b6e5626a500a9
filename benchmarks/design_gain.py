"""Information of a designed current against random binary currents and other optimisers, on one problem.

``python benchmarks/design_gain.py [--peers-python PATH] [--seeds 15] [--json]``

A network of six local models along the SoC (one past output, SoC and two current taps: 30 parameters) is fitted to a
simulated NMC cell; 1000 samples of 1 s within 2C and SoC 0.1..0.9, log det of the information, free-run and one-step
sensitivities. In the second problem the SoC is held within 0.45..0.55, where random currents stay by themselves, and
the six local models lie within 0.4..0.6: there nothing can be gained by moving the charge. Random binary currents of
each clock; the strongest clock is the reference. The other optimisers get the same limits of the current and start from
the same random currents; their results are moved into the SoC window before they are judged. With ``--peers-python``, a
Python that has CasADi, gradient ascent and IPOPT on CasADi's graph of the same problem run in it.
"""

import argparse
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.optimize import minimize
from simulated_cells import noise_V, play
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.design import StepProfileRequest, step_profile
from models.design.constraints.feasible import Demands, Feasible
from models.design.constraints.limits import Limits
from models.design.information.criteria import efficiency
from models.design.information.experiment import SENSITIVITIES, Evaluator, Experiment
from models.design.optimise.ascent import optimise
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from simulators.catalogue import cell_type

DT_S = 1.0
N_SAMPLES = 1000
C_RATE = 2.0
CLOCKS = (1, 2, 5, 10, 20, 50, 100)
_QUASI_NEWTON_STARTS = 3
_PEER = Path(__file__).with_name("design_peer_casadi.py")


@dataclass(frozen=True)
class Problem:
    """A design problem: name, trained SoC window, allowed SoC window."""

    name: str
    trained: tuple[float, float]
    allowed: tuple[float, float]


PROBLEMS = (Problem("whole window", (0.1, 0.9), (0.1, 0.9)), Problem("one level", (0.4, 0.6), (0.45, 0.55)))


def main() -> int:
    arguments = _arguments()
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1, user_api="blas"):
        for problem in PROBLEMS:
            network = reference(problem)
            for sensitivity in SENSITIVITIES:
                rows += judge(problem, network, sensitivity, arguments)
    if arguments.json:
        print(json.dumps({"rows": rows}))
    else:
        _print(rows)
    return 0


def reference(problem: Problem) -> LocalModelNetwork:
    """Six local models, fitted to a simulated run."""
    structure = Structure(
        output_order=1,
        inputs=(InputChannel("soc", delay=1), InputChannel("current", order=1)),
        axes=(PartitionAxis("soc", initial=6, splittable=False, k_sigma=0.5),),
        dt_s=DT_S,
        name="six",
    )
    capacity_Ah = cell_type("nmc").parameters.capacity_Ah
    request = StepProfileRequest(
        capacity_Ah=capacity_Ah,
        current_A=(-C_RATE * capacity_Ah, C_RATE * capacity_Ah),
        soc=problem.trained,
        initial_soc=0.5,
        duration_s=14_000.0,
        dt_s=DT_S,
    )
    run = play("nmc", step_profile(request, np.random.default_rng(0)), seed=(0, 0))
    return fit_network([run.series], capacity_Ah=capacity_Ah, structure=structure, dt_s=DT_S).network


def judge(
    problem: Problem, network: LocalModelNetwork, sensitivity: str, arguments: argparse.Namespace
) -> list[dict[str, Any]]:
    """All methods on one problem."""
    experiment = Experiment(network, 0.5, noise_V(), 25.0, sensitivity)
    amplitude_A = C_RATE * network.cell.capacity_Ah
    demands = Demands(Limits((-amplitude_A, amplitude_A), problem.allowed))
    feasible = Feasible(experiment, demands, N_SAMPLES)
    evaluator = Evaluator(experiment, N_SAMPLES)
    random = {clock: _random_binary(evaluator, feasible, amplitude_A, clock, arguments.seeds) for clock in CLOCKS}
    clock = max(random, key=lambda c: float(np.median(random[c])))
    base = float(np.median(random[clock]))
    size = network.theta.size
    what = {"problem": problem.name, "sensitivity": sensitivity}

    def row(method: str, value: float, seconds: float, **more: Any) -> dict[str, Any]:
        return {**what, "method": method, "efficiency": efficiency(value, base, size), "seconds": seconds, **more}

    rows = [row(f"random binary, {c} s clock, median", float(np.median(random[c])), 0.0) for c in CLOCKS]
    rows.append(row(f"random binary, {clock} s clock, best", float(random[clock].max()), 0.0))
    found, times, cpu = optimise(experiment, demands, 10, n_starts=1), [], []  # the first one compiles
    for _ in range(max(arguments.repeats, 1)):
        began, cpu_began = time.perf_counter(), time.process_time()
        found = optimise(experiment, demands, N_SAMPLES, n_starts=40, seed=1)
        times.append(time.perf_counter() - began)
        cpu.append(time.process_time() - cpu_began)
    reached = found.starts[found.finished]
    more = {
        "median_seconds": float(np.median(times)),
        "cpu_seconds": min(cpu),
        "local_optima": [efficiency(float(v), base, size) for v in np.sort(reached)],
        "gradients": found.iterations,
        "optimality": found.optimality,
    }
    rows.append(row("this project, 40 starts", found.value, min(times), **more))
    value, seconds = _quasi_newton(evaluator, feasible, amplitude_A)
    rows.append(row(f"scipy L-BFGS-B, this gradient, {_QUASI_NEWTON_STARTS} starts", value, seconds))
    if arguments.peers_python:
        for method, current, seconds in _casadi(arguments.peers_python, experiment, problem, amplitude_A):
            rows.append(row(method, evaluator.value(feasible.project(current)), seconds))
    return rows


def _random_binary(evaluator: Evaluator, feasible: Feasible, amplitude_A: float, clock: int, seeds: int) -> FloatArray:
    values = []
    for seed in range(seeds):
        signs = np.random.default_rng([seed, clock]).choice([-1.0, 1.0], -(-N_SAMPLES // clock))
        values.append(evaluator.value(feasible.project(amplitude_A * np.repeat(signs, clock)[:N_SAMPLES])))
    return np.array(values)


def _quasi_newton(evaluator: Evaluator, feasible: Feasible, amplitude_A: float) -> tuple[float, float]:
    def negative(current: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = evaluator.value_and_gradient(current)
        return -value, -gradient

    began, best = time.perf_counter(), -np.inf
    for start in range(_QUASI_NEWTON_STARTS):
        first = np.random.default_rng(start).uniform(-amplitude_A, amplitude_A, N_SAMPLES)
        bounds = [(-amplitude_A, amplitude_A)] * N_SAMPLES
        found = minimize(negative, first, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 200})
        best = max(best, evaluator.value(feasible.project(found.x)))
    return best, time.perf_counter() - began


def _casadi(
    python: str, experiment: Experiment, problem: Problem, amplitude_A: float
) -> list[tuple[str, FloatArray, float]]:
    """Results of the worker: method, current, seconds."""
    document = {
        "network": experiment.network.to_json(),
        "initial_soc": experiment.initial_soc,
        "noise_V": experiment.noise_V,
        "free_run": experiment.sensitivity == "free_run",
        "prior": experiment.prior_information().tolist(),
        "soc": problem.allowed,
        "amplitude_A": amplitude_A,
        "n_samples": N_SAMPLES,
    }
    done = subprocess.run(
        [python, str(_PEER)], input=json.dumps(document), capture_output=True, text=True, timeout=1800, check=False
    )
    if done.returncode != 0:
        print(f"peer failed: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return []
    answers = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return [(a["method"], np.array(a["current_A"]), a["seconds"]) for a in answers]


def _print(rows: list[dict[str, Any]]) -> None:
    table = Table(title="D-efficiency per parameter over the median of random binary currents")
    for heading in ("problem", "sensitivity", "method", "efficiency", "seconds"):
        table.add_column(heading)
    for row in rows:
        seconds = f"{row['seconds']:.2f}" if row["seconds"] else ""
        table.add_row(row["problem"], row["sensitivity"], row["method"], f"{row['efficiency']:.2f}", seconds)
    Console(width=130).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers-python", help="a Python with casadi and numpy; without it these peers are left out")
    parser.add_argument("--seeds", type=int, default=15, help="random binary currents of each clock")
    parser.add_argument("--repeats", type=int, default=5, help="of the design, for its time")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
