"""Structure mode on blind cases: a network whose structure lacks an effect that its cell has.

``python benchmarks/diagnosis_structure.py [--cases 60] [--first-seed 0] [--null-share 0.5] [--json]``

Each seed draws a cell without any effect that the structure lacks (open-circuit curve, ohmic resistance and two fast
pairs remain), a profile, and none, one or two effects of random size. A network without output feedback with just the
structure of the bare cell is fitted to the training run; the diagnosis sees that run and a second one.
"""

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
from diagnosis_cells import CHANGES, CHEMISTRIES, PROFILES, Rig, chamber_degC, current_A, play, random_cell
from diagnosis_change import INITIAL_SOC, NONE, TWINS, show
from threadpoolctl import threadpool_limits

from models.diagnosis import diagnose
from models.identification import fit_network
from models.structure import InputChannel, PartitionAxis, Structure
from simulators.cell import Branch, CellParameters
from simulators.sensors import SensorParameters

TRAIN_S, RUN_S = 20_000.0, 14_000.0
# Range of the size of each effect that a refitted network cannot take in, as in `CHANGES`.
LACKING = (
    "charge_discharge_asymmetry",
    "charge_transfer",
    "current_offset",
    "entropic_voltage",
    "hysteresis",
    "relaxation",
    "resistance_growth",
    "self_discharge",
    "temperature_dependence",
)
BRANCHES_S = (1.5, 25.0)


def main() -> int:
    arguments = _arguments()
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.cases):
            row = judge(seed, arguments.null_share, arguments.effects)
            rows.append(row)
            print(
                f"{seed:4d} {row['cell']} {row['profile']:8s} {row['truth']:27s} {row['size']:9.2g} train "
                f"{row['train_mV']:6.2f} mV -> {row['verdict']:16s} {row['named']:27s} "
                f"{'ok' if row['right'] else 'WRONG':5s} confidence {row['confidence']:.2f} "
                f"{row['before_mV']:.2f} -> {row['after_mV']:.2f} mV rivals {','.join(row['rivals'])} "
                f"{row['seconds']:.1f} s",
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


def bare_cell(chemistry: str, rng: np.random.Generator) -> CellParameters:
    """A cell with an open-circuit curve, an ohmic resistance and two pairs whose time constants are known."""
    p = random_cell(chemistry, rng)
    return replace(
        p,
        ohmic_at_empty_Ohm=0.0,
        fast_1=Branch(p.fast_1.resistance_Ohm, BRANCHES_S[0]),
        fast_2=Branch(p.fast_2.resistance_Ohm, BRANCHES_S[1]),
        slow=Branch(0.0, p.slow.time_constant_s),
        hysteresis_amplitude_V=0.0,
        charge_transfer_V=0.0,
        activation_K=0.0,
        dU_dT_V_per_K=0.0,
    )


def bare_structure() -> Structure:
    """Just what the bare cell shows."""
    pairs = tuple(InputChannel(f"low_pass:{tau_s:g}") for tau_s in BRANCHES_S)
    return Structure(
        0,
        (InputChannel("soc", delay=1), InputChannel("current"), *pairs),
        (PartitionAxis("soc", k_sigma=0.7),),
        1.0,
        name="bare",
    )


def with_effect(rig: Rig, name: str, rng: np.random.Generator) -> tuple[Rig, float]:
    """Give the bare cell an effect of random size."""
    p = rig.cell
    if name == "charge_transfer":
        size = float(rng.uniform(0.02, 0.06))
        exchange_A = p.capacity_Ah * float(np.exp(rng.uniform(np.log(0.1), np.log(0.8))))
        return replace(rig, cell=replace(p, charge_transfer_V=size, exchange_current_A=exchange_A)), size
    if name == "relaxation":
        size = float(np.exp(rng.uniform(np.log(0.003), np.log(0.02))))
        return replace(rig, cell=replace(p, slow=Branch(size, p.slow.time_constant_s))), size
    change, (low, high), both = CHANGES[name]
    size = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    size = -size if both and rng.uniform() < 0.5 else size
    return change(rig, size), size


def judge(seed: int, null_share: float, chosen: list[str]) -> dict[str, Any]:
    """Draw one case, fit the network that lacks the effect, diagnose."""
    rng = np.random.default_rng([seed, 11])
    chemistry, profile = str(rng.choice(CHEMISTRIES)), str(rng.choice(PROFILES))
    truth = NONE if rng.uniform() < null_share else str(rng.choice(chosen))
    moves = truth in ("entropic_voltage", "temperature_dependence") or bool(rng.uniform() < 0.3)
    rig, size = Rig(bare_cell(chemistry, rng), SensorParameters()), 0.0
    if truth != NONE:
        rig, size = with_effect(rig, truth, rng)
    runs = []
    for number, duration_s in enumerate((TRAIN_S, RUN_S)):
        current = current_A(profile, rig.cell.capacity_Ah, INITIAL_SOC, duration_s, rng)
        chamber = chamber_degC(moves, len(current), rng)
        runs.append(play(rig, current, chamber, INITIAL_SOC, np.random.default_rng([seed, number]), f"run {number}")[0])
    fit = fit_network([runs[0]], capacity_Ah=rig.cell.capacity_Ah, structure=bare_structure(), dt_s=1.0)
    began = time.perf_counter()
    answer = diagnose(fit.network, [runs[1]], [INITIAL_SOC], train=[runs[0]], train_soc=[INITIAL_SOC], mode="structure")
    seconds = time.perf_counter() - began
    first = answer.findings[0] if answer.findings else None
    named = first.effect if first else NONE if answer.verdict == "nothing_missing" else "unknown_effect"
    return {
        "seed": seed,
        "cell": chemistry,
        "profile": profile,
        "truth": truth,
        "size": size,
        "train_mV": fit.train["rmse_mV"],
        "named": named,
        "verdict": answer.verdict,
        "right": named == truth or {named, truth} <= TWINS,
        "rivals": list(first.confounded_with) if first else [],
        "confidence": first.confidence if first else 1.0,
        "margin": first.evidence["margin"] if first else 0.0,
        "before_mV": first.error_before_mV if first else answer.unexplained_mV,
        "after_mV": first.error_after_mV if first else answer.unexplained_mV,
        "parameter_error": 0.0,
        "seconds": seconds,
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Shares and the confusion matrix."""
    cases = [row for row in rows if row["truth"] != NONE]
    nulls = [row for row in rows if row["truth"] == NONE]
    return {
        "cases": len(cases),
        "right_share": sum(row["right"] for row in cases) / max(len(cases), 1),
        "nulls": len(nulls),
        "false_alarm_share": sum(row["named"] != NONE for row in nulls) / max(len(nulls), 1),
        "confusion": [[*pair, n] for pair, n in sorted(Counter((r["truth"], r["named"]) for r in rows).items())],
        "seconds_median": float(np.median([row["seconds"] for row in rows])),
    }


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--null-share", type=float, default=0.5)
    parser.add_argument("--effects", nargs="+", choices=LACKING, default=list(LACKING))
    parser.add_argument("--rows", metavar="FILE", help="append one JSON line for each case")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
