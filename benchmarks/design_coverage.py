"""Designed sequences against families of test signals on foreign cells, judged over the whole window that was asked.

``python benchmarks/design_coverage.py [--chemistries nmc lfp] [--truths particle spread] [--seeds 10] [--out ROWS]``

The cells are two of the foreign truths of `simulators`, drawn until the chemistry is the one asked for; seeds take them
in turn. All signals last the same time within SoC 0.1..0.92, -2C..1C and the voltage limits, from SoC 0.5 at rest. The
designed sequence has for reference a network fitted to a pre-test of the same cell with other noise; it trains nothing
else. Each signal is played, a bounded network is fitted to what the sensors read, and its free run is held against the
noise-free voltage of runs of five kinds that go through the whole window, by sensors that are right: what it differs by
is beyond the noise. Rows are kept one by one in a file; what is there already is not done again.
"""

import argparse
import itertools
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from foreign_cells import KINDS, TRUTHS, Plan, Rig, logged, profile_A, random_rig, segment_A, true_columns
from rich.console import Console
from rich.table import Table
from row_file import add_row, read_rows
from threadpoolctl import threadpool_limits

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.design.constraints.limits import Limits
from models.design.design import design
from models.design.optimise.block_design import OPTIMAL, DesignRequest
from models.design.optimise.reference_model import experiment_with, pre_test
from models.design.request import read_request
from models.design.sequence.profile import Profile
from models.design.test_signals import find_families
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network

DT_S, INITIAL_SOC, AMBIENT_DEGC = 1.0, 0.5, 25.0
C_RATES, SOC = (-2.0, 1.0), (0.1, 0.92)
LEVELS = 8
TRUTHS_HERE = ("particle", "spread")
_WINDOW_V = {"nmc": (2.6, 4.25), "lfp": (2.3, 3.7)}
# Left between the open-circuit voltage at the window's ends and the limits, at the least.
_ROOM_V = 0.3
_WARMEST_DEGC = 60.0
# Inside this the former sequences of eight levels went, whatever the window's ends.
_INNER = (0.18, 0.85)
_JUDGED = 2
# What the segments of the judging runs are given on top, of the capacity: they must get on.
_ON = 0.1
# Families that replay a load cycle get one of the kind "drive".
_CYCLE_S = 1800


@dataclass(frozen=True, eq=False)
class Judge:
    """A run that no fit sees: the sensors' readings of current and temperature, and the noise-free voltage."""

    series: TimeSeries
    truth_V: FloatArray


def main() -> int:
    arguments = _arguments()
    rows = read_rows(arguments.out)
    with threadpool_limits(1, user_api="blas"):
        for chemistry in arguments.chemistries:
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                truth = arguments.truths[seed % len(arguments.truths)]
                for row in judge(chemistry, truth, seed, arguments, rows):
                    rows.append(row)
                    add_row(arguments.out, row)
    result = {"rows": rows, "summary": summary(rows)}
    if arguments.json:
        print(json.dumps(result))
    else:
        _print(result["summary"])
    return 0


def judge(
    chemistry: str, truth: str, seed: int, arguments: argparse.Namespace, known: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """All signals on one cell; yields a row for each that is not known already."""
    case = {"chemistry": chemistry, "truth": truth, "seed": seed, "duration_s": arguments.duration_s}
    signals = [OPTIMAL, *(find_families() if arguments.families is None else arguments.families)]
    done = {row["signal"] for row in known if all(row[key] == value for key, value in case.items())}
    if done >= set(signals):
        return
    rig = rig_of(chemistry, truth, seed)
    limits = limits_of(rig, chemistry)
    judges = [judging(rig, limits, seed, number) for number in range(_JUDGED)]
    first = pre_test(limits, rig.constants.capacity_Ah, INITIAL_SOC, arguments.duration_s, DT_S, seed)
    reference = fitted(rig, played(rig, _samples(first), 1000 * seed + 900))
    for number, name in enumerate(signals):
        if name in done:
            continue
        began = time.perf_counter()
        try:
            current_A, seconds, said = signal_A(rig, limits, name, seed, (reference, arguments))
        except ModelError as error:
            yield case | {"signal": name, "refused": str(error)}
            continue
        plan = Plan(INITIAL_SOC, np.zeros(1), np.append(0.0, current_A), 0.0)
        columns = true_columns(rig, plan)
        run = logged(rig, plan, columns, 1000 * seed + number)
        network = fitted(rig, run)
        errors = [free_run_error_V(network, each) for each in judges]
        soc = INITIAL_SOC + np.cumsum(current_A) * DT_S / (3600.0 * rig.constants.capacity_Ah)
        row = case | {
            "signal": name,
            "refused": None,
            **zones_mV(errors),
            "soc": [float(soc.min()), float(soc.max())],
            "voltage_exceeded_mV": exceeded_mV(columns[0], limits),
            "warmest_degC": float(columns[1].max()),
            "design_seconds": seconds,
            "seconds": time.perf_counter() - began,
            "said": said,
        }
        print(
            f"{chemistry} {truth} {seed} {name}: {row['error_mV']:.2f} mV over all, {row['inner_mV']:.2f} inside, "
            f"{row['outer_mV']:.2f} near the ends, SoC {soc.min():.3f}..{soc.max():.3f}, design {seconds:.1f} s",
            file=sys.stderr,
            flush=True,
        )
        yield row


def rig_of(chemistry: str, truth: str, seed: int) -> Rig:
    """A cell of a chemistry on a bench whose sensors have noise and steps only."""
    drawn = (random_rig(truth, np.random.default_rng([seed, number, 31])) for number in itertools.count())
    rig = next(each for each in drawn if _is_flat(each) == (chemistry == "lfp") and _stands(each))
    capacity_Ah = rig.constants.capacity_Ah
    return replace(
        rig,
        ambient_degC=AMBIENT_DEGC,
        swing_K=0.0,
        volts=(0.0, 1.0, 1e-3, 1e-4),
        amperes=(0.0, 1.0, 3e-4 * capacity_Ah, 1e-4 * capacity_Ah),
        kelvins=(0.0, 1.0, 0.05, 0.01),
    )


def _stands(rig: Rig) -> bool:
    """Whether a cell takes the largest currents through the whole window without running away."""
    cell = TRUTHS[rig.family].make(rig.constants, SOC[1], AMBIENT_DEGC)
    for rate in C_RATES:
        seconds = round((SOC[1] - SOC[0]) * 3600.0 / abs(rate))
        for _ in range(seconds):
            degC = cell.step(rate * rig.constants.capacity_Ah, 1.0).temperature_degC
            if not -20.0 < degC < _WARMEST_DEGC:
                return False
    return True


def _is_flat(rig: Rig) -> bool:
    if rig.family == "particle":
        return rig.constants.positive.base_V < 4.0
    return rig.constants.empty_V < 3.105


def limits_of(rig: Rig, chemistry: str) -> Limits:
    """Limits of the tests, a data sheet's voltages unless they leave a cell no room in the window."""
    capacity_Ah = rig.constants.capacity_Ah
    low, high = (TRUTHS[rig.family].make(rig.constants, soc, AMBIENT_DEGC).step(0.0, 0.0).voltage_V for soc in SOC)
    window_V = (min(_WINDOW_V[chemistry][0], low - _ROOM_V), max(_WINDOW_V[chemistry][1], high + _ROOM_V))
    return Limits((C_RATES[0] * capacity_Ah, C_RATES[1] * capacity_Ah), SOC, voltage_V=window_V)


def signal_A(
    rig: Rig, limits: Limits, name: str, seed: int, asked: tuple[LocalModelNetwork, argparse.Namespace]
) -> tuple[FloatArray, float, dict[str, Any]]:
    """(n,) currents of a signal, the seconds that its design took, and what the design says of it."""
    capacity_Ah = rig.constants.capacity_Ah
    reference, arguments = asked
    cycle_A = np.clip(
        profile_A("drive", capacity_Ah, 0.6, np.random.default_rng([seed, 60]), _CYCLE_S), *limits.current_A
    )
    own = {"soc_levels": levels_of(arguments.levels)} if name == OPTIMAL else {"cycle_A": cycle_A}
    request = replace(DesignRequest(limits, arguments.duration_s, signal=name, seed=seed), **own)
    found = design(experiment_with(reference, INITIAL_SOC), request)
    return found.current_A, found.seconds, found.coverage.to_json()


def levels_of(count: int) -> tuple[float, ...]:
    """Levels as a request with a number of them has them."""
    limits = {"current_A": [-1.0, 1.0], "soc": list(SOC)}
    return read_request({"duration_s": 1.0, "limits": limits, "soc_levels": count}).soc_levels


def _samples(profile: Profile) -> FloatArray:
    count = round(profile.duration_s / DT_S)
    index = np.searchsorted(profile.time_s, (np.arange(count) + 1e-6) * DT_S, side="right") - 1
    return profile.current_A[index]


def played(rig: Rig, current_A: FloatArray, seed: int) -> TimeSeries:
    """What the sensors read of a current from rest; current k flows from sample k to k + 1."""
    plan = Plan(INITIAL_SOC, np.zeros(1), np.append(0.0, current_A), 0.0)
    return logged(rig, plan, true_columns(rig, plan), seed)


def fitted(rig: Rig, run: TimeSeries) -> LocalModelNetwork:
    """Bounded network of one run."""
    return fit_network(
        [run], capacity_Ah=rig.constants.capacity_Ah, structure="bounded", dt_s=DT_S, initial_soc=[INITIAL_SOC]
    ).network


def judging(rig: Rig, limits: Limits, seed: int, number: int) -> Judge:
    """A run of all kinds through the whole window: to its upper end, down to the lower one, and up again."""
    capacity_Ah, rng = rig.constants.capacity_Ah, np.random.default_rng([seed, number, 70])
    per_As, soc, parts = 1.0 / (3600.0 * capacity_Ah), INITIAL_SOC, list[FloatArray]()
    for sign, end in ((1.0, SOC[1]), (-1.0, SOC[0]), (1.0, SOC[1])):
        while sign * (end - soc) > 1e-3:
            kind = str(rng.choice(KINDS))
            part = np.clip(segment_A(kind, capacity_Ah, sign, rng) + _ON * sign * capacity_Ah, *limits.current_A)
            path = soc + np.cumsum(part) * DT_S * per_As
            inside = (path >= SOC[0]) & (path <= SOC[1])
            if not inside[0]:
                # One sample would already leave the window: on for a minute, or the rest of the way in smaller ones.
                part = np.full(60, np.clip((end - soc) / (60 * DT_S * per_As), *limits.current_A))
            elif not inside.all():
                part = part[: int(np.argmin(inside))]
            parts += [part, np.zeros(int(rng.integers(0, 600)))]
            soc += float(part.sum()) * DT_S * per_As
    plan = Plan(INITIAL_SOC, np.zeros(1), np.append(0.0, np.concatenate(parts)), 0.0)
    columns = true_columns(rig, plan)
    return Judge(logged(rig, plan, columns, 1000 * seed + 800 + number), columns[0])


def free_run_error_V(network: LocalModelNetwork, judge: Judge) -> tuple[FloatArray, FloatArray]:
    """(n,) error against the noise-free voltage, and the counted state of charge."""
    run = to_grid(judge.series, DT_S)
    soc = INITIAL_SOC + run.charge_Ah / network.cell.capacity_Ah
    return free_run_V(network, run, INITIAL_SOC) - judge.truth_V[: len(run.time_s)], soc


def exceeded_mV(voltage_V: FloatArray, limits: Limits) -> float:
    """By how much a cell's voltage leaves its limits; negative: room left."""
    assert limits.voltage_V is not None
    low, high = limits.voltage_V
    return 1e3 * float(max(low - voltage_V.min(), voltage_V.max() - high))


def zones_mV(errors: list[tuple[FloatArray, FloatArray]]) -> dict[str, float]:
    """Root mean square over all, inside, and near the ends of the window."""
    error, soc = (np.concatenate(parts) for parts in zip(*errors, strict=True))
    inner = (soc > _INNER[0]) & (soc < _INNER[1])
    return {
        name: 1e3 * float(np.sqrt(np.mean(error[where] ** 2)))
        for name, where in (("error_mV", np.ones(len(error), bool)), ("inner_mV", inner), ("outer_mV", ~inner))
    }


def summary(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Median errors of each signal, and on how many cells the designed sequence is below it."""
    out = []
    for chemistry in dict.fromkeys(row["chemistry"] for row in rows):
        own = [row for row in rows if row["chemistry"] == chemistry and row["refused"] is None]
        designed = {row["seed"]: row["error_mV"] for row in own if row["signal"] == OPTIMAL}
        for signal in dict.fromkeys(row["signal"] for row in own):
            these = [row for row in own if row["signal"] == signal]
            both = [(designed[row["seed"]], row["error_mV"]) for row in these if row["seed"] in designed]
            out.append(
                {
                    "chemistry": chemistry,
                    "signal": signal,
                    "cells": len(these),
                    **{
                        name: float(np.median([row[name] for row in these]))
                        for name in ("error_mV", "inner_mV", "outer_mV")
                    },
                    "designed_below": sum(ours < theirs for ours, theirs in both),
                }
            )
        others: dict[int, float] = {}
        for row in own:
            if row["signal"] != OPTIMAL:
                others[row["seed"]] = min(row["error_mV"], others.get(row["seed"], np.inf))
        below = [designed[seed] < others[seed] for seed in designed if seed in others]
        out.append(
            {"chemistry": chemistry, "signal": "every family", "cells": len(below), "designed_below": sum(below)}
        )
    return out


def _print(found: list[dict[str, Any]]) -> None:
    table = Table(title="Error against the noise-free voltage over the whole window, median over cells")
    for heading in ("cell", "signal", "cells", "over all / mV", "inside", "near the ends", "designed is below"):
        table.add_column(heading)
    for row in found:
        figures = [f"{row[name]:.2f}" if name in row else "" for name in ("error_mV", "inner_mV", "outer_mV")]
        below = "" if row["signal"] == OPTIMAL else f"{row['designed_below']} of {row['cells']}"
        table.add_row(row["chemistry"], row["signal"], str(row["cells"]), *figures, below)
    Console(width=120).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--chemistries", nargs="+", choices=("nmc", "lfp"), default=["nmc", "lfp"])
    parser.add_argument("--truths", nargs="+", choices=TRUTHS_HERE, default=list(TRUTHS_HERE))
    parser.add_argument("--families", nargs="*", help="default: all")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--levels", type=int, default=LEVELS)
    parser.add_argument("--duration-s", type=float, default=14_000.0)
    parser.add_argument("--out", type=Path, help="rows so far, one JSON object a line; read, and added to")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
