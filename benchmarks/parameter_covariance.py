"""Stated parameter covariance of networks against their real errors, where the truth is itself a network.

``python benchmarks/parameter_covariance.py [--cases 100] [--samples 6000] [--json]``

In each case a network with random parameters makes the voltage from a new random current, correlated noise is added,
and a network of the same structure is fitted: penalties chosen on held-out blocks, poles freed where there is output
feedback. Reported are the share of parameters within 1.96 of their stated standard deviations, the same for every
parameter over all cases, and the median and largest (estimate - truth)' C^-1 (estimate - truth) over the number of
parameters, which is near 1 where the covariance is right.
"""

import argparse
import json
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.linalg import solve_triangular
from scipy.signal import lfilter
from threadpoolctl import threadpool_limits

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.identification.refinement import Refined, refined_theta
from models.identification.search.fitted import Fitted
from models.identification.shared_poles import fit, moments, output_coefficients, penalties
from models.network.partition import Partition
from models.network.recursion import free_run
from models.network.regression import CellContext, build_dataset, find_scaling
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.uncertainty.held_out import fit_uncertainty

CAPACITY_AH = 2.0
NOISE = 1e-3  # of the voltage's range
INPUTS = (InputChannel("soc", delay=1), InputChannel("current", order=1), InputChannel("low_pass:60"))
AXES = (PartitionAxis("soc", k_sigma=0.5),)
EDGES = np.linspace(0.0, 1.0, 6)


@dataclass(frozen=True)
class Kind:
    """A kind of case: output order, range of the local poles' time constants, and of how long the noise remembers."""

    name: str
    order: int
    noise_s: float
    poles_s: tuple[float, float] = (8.0, 8.0)

    @property
    def shared(self) -> bool:
        """Whether all local models have the pole that the fit is given."""
        return self.poles_s[0] == self.poles_s[1]


KINDS = (
    Kind("no feedback, white", 0, 0.0),
    Kind("no feedback, 30 s", 0, 30.0),
    Kind("shared pole, white", 1, 0.0),
    Kind("shared pole, 30 s", 1, 30.0),
    Kind("own poles, white", 1, 0.0, (6.0, 10.0)),
    Kind("own poles, 30 s", 1, 30.0, (6.0, 10.0)),
)


def main() -> int:
    arguments = _arguments()
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1, user_api="blas"):
        for kind in KINDS:
            rows.append(judge(kind, arguments.cases, arguments.samples, arguments.first_seed))
            if not arguments.json:
                print(f"{kind.name}: {100 * rows[-1]['coverage_95']:.1f} % within 95 %", file=sys.stderr)
    if arguments.json:
        print(json.dumps({"cases": arguments.cases, "samples": arguments.samples, "kinds": rows}))
    else:
        _print(rows, arguments.cases)
    return 0


def judge(kind: Kind, cases: int, n_samples: int, first_seed: int = 0) -> dict[str, Any]:
    """Coverage over many cases of one kind."""
    scores, distances = [], []
    for seed in range(first_seed, first_seed + cases):
        judged = one_case(kind, n_samples, np.random.default_rng([seed, kind.order, round(kind.noise_s)]))
        if judged is not None:
            scores.append(judged[0])
            distances.append(judged[1])
    inside = np.abs(np.array(scores)) <= 1.96
    each = inside.mean(axis=0)
    return {
        "kind": kind.name,
        "cases": len(scores),
        "parameters": inside.shape[1],
        "coverage_95": float(inside.mean()),
        "lowest_of_a_parameter": float(each.min()),
        "highest_of_a_parameter": float(each.max()),
        "median_distance": float(np.median(distances)),
        "largest_distance": float(np.max(distances)),
    }


def one_case(kind: Kind, n_samples: int, rng: np.random.Generator) -> tuple[FloatArray, float] | None:
    """Errors over their stated standard deviations, and the squared distance for each parameter.

    None where the poles differ but held-out data did not show it: the fit is then no network of the truth's structure.
    """
    structure = Structure(kind.order, INPUTS, AXES, 1.0)
    partition = Partition(EDGES[:-1, None], EDGES[1:, None], np.array([0.5]))
    run = _run(n_samples, rng)
    cell = CellContext(CAPACITY_AH)
    scaling = find_scaling(structure, [run], [0.5], cell)
    clean = build_dataset(structure, scaling, [run], [0.5], cell)
    truth = _truth(kind, partition.n_models, rng)
    unknown = replace(clean, y=np.full(len(run), np.nan))
    y = free_run(truth, kind.order, partition.validity(clean.z), unknown)
    data = replace(clean, y=y + NOISE * _noise(kind.noise_s, n_samples, rng))
    a = output_coefficients((8.0,) * kind.order, 1.0)
    sums = moments(partition, data, a, data.groups())
    fitted = Fitted(structure, scaling, data, partition, a, sums, fit(sums, penalties(structure, partition, data, a)))
    refined = Refined(fitted.theta, {}) if kind.shared else refined_theta(fitted, lambda share, text: None)
    if refined.penalties is None and not kind.shared:
        return None
    parameters = fit_uncertainty(fitted, refined.theta, refined.penalties, refined.held_out).parameters
    error = (refined.theta - truth).ravel()
    score = error / np.sqrt(np.diag(parameters.covariance))
    if kind.shared:
        # The pole was given and is right: only the input parameters are judged, and the distance over all of them.
        judged = np.tile(np.arange(truth.shape[1]) >= kind.order, len(truth))
        free = np.concatenate([np.zeros(kind.order), error[judged]])
        return score[judged], _distance(parameters.factor, free) * len(free) / judged.sum()
    return score, _distance(parameters.factor, error)


def _distance(factor: FloatArray, error: FloatArray) -> float:
    """Squared normalised error for each parameter."""
    normalised = solve_triangular(factor, error, lower=True)
    return float(normalised @ normalised) / len(error)


def _truth(kind: Kind, m: int, rng: np.random.Generator) -> FloatArray:
    """Local models of a battery's kind in normalised units, whose gains differ by some percent."""
    static = np.column_stack(
        [
            rng.uniform(0.4, 0.6, m),
            rng.uniform(0.05, 0.07, (m, 2)),
            rng.uniform(0.05, 0.07, m),
            rng.uniform(0.18, 0.2, m),
        ]
    )
    if kind.order == 0:
        return static
    pole = np.exp(-1.0 / rng.uniform(*kind.poles_s, (m, 1)))
    return np.hstack([pole, (1.0 - pole) * static])


def _noise(correlated_s: float, n: int, rng: np.random.Generator) -> FloatArray:
    white = rng.standard_normal(n)
    if correlated_s == 0.0:
        return white
    keep = np.exp(-1.0 / correlated_s)
    slow = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.standard_normal(n + 500))[500:]
    return np.sqrt(0.5) * (white + slow)


def _run(n: int, rng: np.random.Generator) -> GridRun:
    """Random steps of 5 to 80 s between SoC 0.1 and 0.9."""
    current, soc, k = np.zeros(n), 0.5, 1
    while k < n:
        length = min(int(rng.integers(5, 80)), n - k)
        drawn = float(rng.uniform(-6.0, 6.0))
        move = drawn * length / 3600.0 / CAPACITY_AH
        drawn = drawn if 0.1 < soc + move < 0.9 else -drawn
        current[k : k + length] = drawn
        soc += drawn * length / 3600.0 / CAPACITY_AH
        k += length
    return GridRun(
        name="case",
        dt_s=1.0,
        time_s=np.arange(n) * 1.0,
        current_A=current,
        voltage_V=np.linspace(0.0, 1.0, n),
        temperature_degC=np.full(n, 25.0),
        ambient_degC=None,
        charge_Ah=np.cumsum(current) / 3600.0,
        soc_ref=None,
        segment_starts=(0,),
        measured=np.ones(n, dtype=bool),
    )


def _print(rows: list[dict[str, Any]], cases: int) -> None:
    table = Table(title=f"Stated covariance against real errors, {cases} cases of each kind")
    for heading in (
        "kind",
        "cases",
        "parameters",
        "within 95 %",
        "lowest of one",
        "highest of one",
        "distance",
        "largest",
    ):
        table.add_column(heading, justify="left" if heading == "kind" else "right")
    for row in rows:
        table.add_row(
            row["kind"],
            str(row["cases"]),
            str(row["parameters"]),
            f"{100 * row['coverage_95']:.1f} %",
            f"{100 * row['lowest_of_a_parameter']:.0f} %",
            f"{100 * row['highest_of_a_parameter']:.0f} %",
            f"{row['median_distance']:.2f}",
            f"{row['largest_distance']:.1f}",
        )
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--samples", type=int, default=6000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
