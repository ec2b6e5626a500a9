"""Change mode on blind cases: a cell is measured, something changes, it is measured again.

``python benchmarks/diagnosis_change.py [--cases 60] [--first-seed 0] [--null-share 0.25] [--json] [--rows FILE]``

Each seed draws chemistry, cell, profile, effect and size. A training run of the cell before the change makes the
reference model; the diagnosis sees that run and one run after the change, over another profile of the same kind.
Prints the confusion matrix, the share of right names, the false alarms, and how far the primary parameter is off.
"""

import argparse
import json
import sys
import time
from collections import Counter
from typing import Any

import numpy as np
from diagnosis_cells import (
    CHAMBER_MOVES,
    CHANGES,
    CHEMISTRIES,
    PROFILES,
    THERMAL,
    Rig,
    chamber_degC,
    current_A,
    play,
    random_cell,
)
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.diagnosis import memory_of
from models.diagnosis.change import analyse_change
from models.diagnosis.change_answer import voltage_confidence
from models.diagnosis.parameters import parameters
from models.effects import effects
from models.resampling import to_grid
from simulators.sensors import SensorParameters

TRAIN_S, RUN_S = 20_000.0, 14_000.0
INITIAL_SOC = 0.85
NONE = "none"
# A change below this shows in no record of 1 mV noise.
LEAST_MV, LEAST_K = 2.0, 0.3
# Of these a log shows the sum only.
TWINS = {"current_offset", "self_discharge"}


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.cases):
            row = judge(seed, arguments.null_share, arguments.effects)
            rows.append(row)
            print(
                f"{seed:4d} {row['cell']} {row['profile']:8s} {row['truth']:27s} {row['size_mV']:6.2f} mV -> "
                f"{row['named']:27s} {'ok' if row['right'] else 'WRONG':5s} confidence {row['confidence']:.2f} "
                f"parameter off {row['parameter_error']:+.2f} ratio {row['ratio']:.2f} margin {row['margin']:.3f} "
                f"rivals {','.join(row['rivals'])}",
                file=sys.stderr,
                flush=True,
            )
            if arguments.rows:
                with open(arguments.rows, "a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
    result = summary(rows)
    if arguments.json:
        print(json.dumps(result))
    else:
        show(result)
    return 0


def judge(seed: int, null_share: float, chosen: list[str]) -> dict[str, Any]:
    """Draw one case, measure before and after, diagnose."""
    rng = np.random.default_rng([seed, 7])
    chemistry, profile = str(rng.choice(CHEMISTRIES)), str(rng.choice(PROFILES))
    truth = NONE if rng.uniform() < null_share else str(rng.choice(chosen))
    moves = truth in CHAMBER_MOVES or bool(rng.uniform() < 0.3)
    rig = Rig(random_cell(chemistry, rng), SensorParameters())
    plan = [current_A(profile, rig.cell.capacity_Ah, INITIAL_SOC, s, rng) for s in (TRAIN_S, RUN_S)]
    chamber = [chamber_degC(moves, len(each), rng) for each in plan]
    train, _ = play(rig, plan[0], chamber[0], INITIAL_SOC, np.random.default_rng([seed, 0]), "before")
    changed, size, run, size_mV = rig, 0.0, None, 0.0
    for attempt in range(6):
        if truth != NONE:
            changed, size = _changed(rig, truth, rng, min(1.0, 0.2 * attempt))
        run, after_V = play(changed, plan[1], chamber[1], INITIAL_SOC, np.random.default_rng([seed, 1]), "after")
        before, before_V = play(rig, plan[1], chamber[1], INITIAL_SOC, np.random.default_rng([seed, 1]), "same")
        size_mV = 1e3 * _size(truth, run.voltage_V, after_V, before_V)
        warmer = float(np.sqrt(np.mean((run.temperature_degC - before.temperature_degC) ** 2)))
        if truth == NONE or (warmer >= LEAST_K if truth in THERMAL else size_mV >= LEAST_MV):
            break
    assert run is not None
    grids = [to_grid(train, 1.0), to_grid(run, 1.0)]
    stated = float(run.soc_ref[0]) if run.soc_ref is not None else INITIAL_SOC
    began = time.perf_counter()
    memory = memory_of([grids[0]], [INITIAL_SOC], rig.cell.capacity_Ah)
    fitted = time.perf_counter()
    analysis = analyse_change(memory, [grids[1]], [stated], list(effects().values()))
    seconds = (fitted - began, time.perf_counter() - fitted)
    named, values, sure, ranking = NONE, {}, 1.0, analysis.ranking
    rivals: tuple[str, ...] = ()
    if analysis.warmth is not None:
        named = analysis.warmth.effect.name
        first = analysis.warmth.effect.parameters
        values = {p.name: v for p, v in zip(first, analysis.warmth.values, strict=True)}
        sure = 0.95
    elif ranking is not None and ranking.significant and ranking.explained:
        assert analysis.comparison is not None
        named, rivals = ranking.candidates[0].effect.name, ranking.rivals
        values = {k: v.value for k, v in parameters(analysis.comparison, ranking.candidates[0]).items()}
        sure = voltage_confidence(ranking)
    elif ranking is not None and ranking.unknown:
        named = "unknown_effect"
    right = named == truth or {named, truth} <= TWINS
    return {
        "seed": seed,
        "cell": chemistry,
        "profile": profile,
        "truth": truth,
        "size": size,
        "size_mV": size_mV,
        "named": named,
        "right": right,
        "rivals": list(rivals),
        "confidence": sure,
        "parameter_error": _off(truth, rig, changed, size, values) if right and truth != NONE else 0.0,
        "ratio": ranking.ratio if ranking else 0.0,
        "margin": ranking.margin if ranking else 0.0,
        "share_of_new": ranking.share_of_new if ranking else 0.0,
        "size_found_mV": 1e3 * ranking.size_V if ranking else 0.0,
        "own_mV": 1e3 * ranking.own_V if ranking else 0.0,
        "held_out_share": ranking.held_out_share if ranking else 0.0,
        "first": ranking.candidates[0].effect.name if ranking else "",
        "seconds": seconds,
    }


def _changed(rig: Rig, truth: str, rng: np.random.Generator, larger: float) -> tuple[Rig, float]:
    change, (low, high), both_signs = CHANGES[truth]
    least = np.log(low) + larger * (np.log(high) - np.log(low))
    size = float(np.exp(rng.uniform(least, np.log(high))))
    size = -size if both_signs and rng.uniform() < 0.5 else size
    return change(rig, size), size


def _size(truth: str, read_V: np.ndarray, after_V: np.ndarray, before_V: np.ndarray) -> float:
    """Change of the voltage in V; of the counted charge's error where the voltage stays as it is."""
    if truth in ("current_offset", "initial_soc", "voltage_offset"):
        return 5e-3
    return float(np.sqrt(np.mean((after_V - before_V) ** 2)))


def _off(truth: str, rig: Rig, changed: Rig, size: float, values: dict[str, float]) -> float:
    """Relative error of the primary parameter."""
    true = {
        "capacity": changed.cell.capacity_Ah,
        "charge_discharge_asymmetry": size,
        "charge_transfer": changed.cell.charge_transfer_V - rig.cell.charge_transfer_V,
        "current_offset": size * rig.cell.capacity_Ah,
        "self_discharge": size * rig.cell.capacity_Ah,
        "heat_transfer": changed.cell.heat_transfer_W_per_K,
        "initial_soc": INITIAL_SOC,
        "relaxation": changed.cell.slow.resistance_Ohm - rig.cell.slow.resistance_Ohm,
    }.get(truth, size)
    if truth == "temperature_sensor":
        return values.get("offset_K", 0.0) / true - 1.0
    if truth in ("ocv_shape", "soc_dependence") or not values:
        return 0.0
    found = next(iter(values.values()))
    if truth == "capacity":
        # Judged on the change, not on the capacity itself.
        return (found - rig.cell.capacity_Ah) / (true - rig.cell.capacity_Ah) - 1.0
    return found / true - 1.0


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and the confusion matrix."""
    cases = [row for row in rows if row["truth"] != NONE]
    nulls = [row for row in rows if row["truth"] == NONE]
    right = [row for row in cases if row["right"]]
    sure = [row for row in rows if row["named"] not in (NONE, "unknown_effect") and 0.85 <= row["confidence"] <= 0.95]
    close = [abs(row["parameter_error"]) <= 0.15 for row in right]
    return {
        "cases": len(cases),
        "right_share": len(right) / max(len(cases), 1),
        "nulls": len(nulls),
        "false_alarm_share": sum(row["named"] != NONE for row in nulls) / max(len(nulls), 1),
        "parameter_within_15_percent": float(np.mean(close)) if close else None,
        "findings_given_about_0.9": len(sure),
        "of_these_right": float(np.mean([row["right"] for row in sure])) if sure else None,
        "confusion": [[*pair, n] for pair, n in sorted(Counter((r["truth"], r["named"]) for r in rows).items())],
        "seconds_median": float(np.median([sum(row["seconds"]) for row in rows])),
    }


def show(result: dict[str, Any]) -> None:
    """Print the confusion matrix and the shares."""
    names = sorted({pair[0] for pair in result["confusion"]} | {pair[1] for pair in result["confusion"]})
    counts = {(truth, named): n for truth, named, n in result["confusion"]}
    table = Table(title="Truth (rows) against the named effect (columns)")
    table.add_column("")
    for number, _ in enumerate(names):
        table.add_column(str(number), justify="right")
    for number, truth in enumerate(names):
        cells = [str(counts.get((truth, named), "")) for named in names]
        table.add_row(f"{number} {truth}", *cells)
    console = Console(width=160)
    console.print(table)
    for key, value in result.items():
        if key != "confusion":
            console.print(f"{key}: {value}")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--null-share", type=float, default=0.25)
    parser.add_argument("--effects", nargs="+", choices=sorted(CHANGES), default=sorted(CHANGES))
    parser.add_argument("--rows", metavar="FILE", help="append one JSON line for each case")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
