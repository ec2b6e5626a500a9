"""Random limits on simulated cells: whether any designed current leaves one, and whether the cell's voltage does.

``python benchmarks/design_limits.py [--cases 500] [--seed 0] [--cells nmc lfp] [--out ROWS] [--json]``

Each case draws a cell, a reference network (one local model, six along the SoC, or a bounded network; all fitted to a
pre-test), a kind of signal, one in four a sequence over four levels and the ends of the window, current, ramp, SoC
window, net charge and voltage window, and a start. What is designed is played on the simulated cell without noise.
Refused cases are counted; an ascent has two starts, since it is the limits that are judged. Rows are kept in a file one
by one; what is there already is not done again.
"""

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from design_families import SIX, limits_of
from rich.console import Console
from rich.table import Table
from row_file import add_row, read_rows
from simulated_cells import play
from threadpoolctl import threadpool_limits

from models.data.timeseries import FloatArray
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.design import design
from models.design.optimise.block_design import DesignRequest
from models.design.optimise.reference_model import bounded_reference, experiment_with, first_reference, pre_test
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from simulators.catalogue import cell_type
from simulators.cell import Cell

DT_S, AMBIENT_DEGC = 1.0, 25.0
SIGNALS = ("optimal", "aprbs", "prbs", "multisine")
_PRE_TEST_S, _PRE_TEST_SOC = 14_000.0, 0.5
_DURATION_S, _SEQUENCE_S = (200.0, 1500.0), (8000.0, 14_000.0)
_SEQUENCES, _LEVELS = 0.25, (0.2, 0.4, 0.6, 0.8)
# Rounding of sums over a run.
_ROUNDING = 1e-7
# Open-circuit voltages that the ends of the window are drawn around.
_REST_V = {"nmc": (3.4, 4.1), "lfp": (3.2, 3.34)}
_LEAST_HIGH_V = {"nmc": 3.7, "lfp": 3.4}


@dataclass(frozen=True)
class Case:
    """One random request and where the cell stands."""

    cell: str
    reference: str
    start_soc: float
    request: DesignRequest


def main() -> int:
    arguments = _arguments()
    networks: dict[tuple[str, str], LocalModelNetwork] = {}
    with threadpool_limits(1, user_api="blas"):
        for cell in arguments.cells:
            networks |= references(cell, arguments.seed)
        began, known = time.process_time(), _known(arguments.out, arguments.seed)
        rows = [known[number] for number in sorted(known) if number < arguments.cases]
        for number in range(arguments.cases):
            if number in known:
                continue
            case = draw(np.random.default_rng([arguments.seed, number]), arguments.cells, number)
            row = {"number": number, "draw": arguments.seed}
            rows.append(row | judge(case, networks[case.cell, case.reference]))
            add_row(arguments.out, rows[-1])
            if number % 100 == 99:
                print(f"{number + 1} of {arguments.cases}", file=sys.stderr, flush=True)
    result = summary(rows) | {"seed": arguments.seed, "cpu_seconds": time.process_time() - began}
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result)
    return 0


def references(cell: str, seed: int) -> dict[tuple[str, str], LocalModelNetwork]:
    """Networks of one and of six local models and a bounded one, fitted to a pre-test."""
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    profile = pre_test(limits_of(cell), capacity_Ah, _PRE_TEST_SOC, _PRE_TEST_S, DT_S, seed)
    run = play(cell, profile, (seed, 90)).series
    six = fit_network([run], capacity_Ah=capacity_Ah, structure=SIX, dt_s=DT_S).network
    bounded = bounded_reference([run], capacity_Ah, DT_S, [_PRE_TEST_SOC])
    return {(cell, "one"): first_reference([run], capacity_Ah, DT_S), (cell, "six"): six, (cell, "bounded"): bounded}


def draw(rng: np.random.Generator, cells: list[str], number: int) -> Case:
    """Draw limits of all kinds; some contradict each other."""
    cell = str(rng.choice(cells))
    capacity_Ah, window_V = cell_type(cell).parameters.capacity_Ah, cell_type(cell).limits.voltage_V
    start = rng.uniform(0.2, 0.8)
    soc = (max(0.1, start - rng.uniform(0.05, 0.4)), min(0.9, start + rng.uniform(0.05, 0.4)))
    current_A = (-rng.uniform(0.5, 2.0) * capacity_Ah, rng.uniform(0.3, 1.0) * capacity_Ah)
    voltage_V = (rng.uniform(window_V[0], _REST_V[cell][0]), rng.uniform(_LEAST_HIGH_V[cell], window_V[1]))
    ramp = None if rng.uniform() < 0.6 else (-rng.uniform(0.2, 5.0), rng.uniform(0.2, 5.0))
    net = None if rng.uniform() < 0.7 else (-rng.uniform(0.0, 0.05) * capacity_Ah, rng.uniform(0.0, 0.05) * capacity_Ah)
    is_sequence = rng.uniform() < _SEQUENCES
    net = None if is_sequence else net
    limits = Limits(current_A, soc, voltage_V=voltage_V, ramp_A_per_s=ramp, net_charge_Ah=net)
    signal, duration_s = str(rng.choice(SIGNALS)), float(rng.uniform(*_DURATION_S))
    request = DesignRequest(limits, duration_s, signal=signal, n_starts=2, seed=number)
    if is_sequence:
        levels = tuple(float(soc[0] + share * (soc[1] - soc[0])) for share in _LEVELS)
        duration_s = float(rng.uniform(*_SEQUENCE_S))
        request = replace(request, signal="optimal", soc_levels=levels, duration_s=duration_s)
    return Case(cell, str(rng.choice(["one", "six", "bounded"])), float(start), request)


def judge(case: Case, network: LocalModelNetwork) -> dict[str, Any]:
    """Design, play without noise, and measure by how much each limit is exceeded; negative: room left."""
    row: dict[str, Any] = {"cell": case.cell, "reference": case.reference, "signal": case.request.signal}
    experiment = experiment_with(network, case.start_soc, use_prior=False)
    try:
        current = design(experiment, case.request).current_A
    except InfeasibleError as error:
        return row | {"refused": str(error)}
    limits = case.request.limits
    simulated = Cell(cell_type(case.cell).parameters, case.start_soc, AMBIENT_DEGC)
    truth = [simulated.step(float(each), DT_S) for each in current]
    voltage, soc = (np.array([getattr(out, name) for out in truth]) for name in ("voltage_V", "soc"))
    assert limits.voltage_V is not None
    row |= {
        "refused": None,
        "voltage_mV": 1e3 * _over(voltage, limits.voltage_V),
        "soc": _over(soc, limits.soc),
        "current_A": _over(current, limits.current_A),
        "mean_c_rate": float(np.abs(current).mean()) / network.cell.capacity_Ah,
    }
    if limits.ramp_A_per_s is not None:
        steps = np.diff(np.concatenate([[0.0], current, [0.0]])) / DT_S
        row["ramp_A_per_s"] = _over(steps, limits.ramp_A_per_s)
    if limits.net_charge_Ah is not None:
        row["net_charge_Ah"] = _over(np.array([current.sum() * DT_S / 3600.0]), limits.net_charge_Ah)
    return row


def _known(path: Path | None, seed: int) -> dict[int, dict[str, Any]]:
    return {row["number"]: row for row in read_rows(path) if row["draw"] == seed}


def _over(values: FloatArray, window: tuple[float, float]) -> float:
    return float(max(window[0] - values.min(), values.max() - window[1]))


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How many runs left which limit, and the largest excess."""
    played = [row for row in rows if row["refused"] is None]
    limits = {}
    for name in ("current_A", "ramp_A_per_s", "net_charge_Ah", "soc", "voltage_mV"):
        over = np.array([row[name] for row in played if name in row])
        if len(over):
            worst = float(over.max())
            limits[name] = {"runs": len(over), "outside": int((over > _ROUNDING).sum()), "largest_excess": worst}
    reasons = Counter(row["refused"].split(":")[0].split(" is ")[0][:60] for row in rows if row["refused"])
    return {
        "cases": len(rows),
        "played": len(played),
        "mean_c_rate": float(np.mean([row["mean_c_rate"] for row in played])) if played else None,
        "limits": limits,
        "refused_for": dict(reasons.most_common()),
    }


def _print(result: dict[str, Any]) -> None:
    table = Table(title=f"{result['played']} of {result['cases']} random requests played, seed {result['seed']}")
    for heading in ("limit", "runs", "outside", "largest excess (negative: room left)"):
        table.add_column(heading)
    for name, found in result["limits"].items():
        table.add_row(name, str(found["runs"]), str(found["outside"]), f"{found['largest_excess']:.3g}")
    console = Console(width=110)
    console.print(table)
    for reason, count in result["refused_for"].items():
        console.print(f"refused {count} x: {reason}", highlight=False)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cells", nargs="+", default=["nmc", "lfp"])
    parser.add_argument("--out", type=Path, help="rows so far, one JSON object a line; read, and added to")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
