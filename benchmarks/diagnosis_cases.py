"""What both benchmarks of the diagnosis share: cases that can be stopped and continued, and the confusion matrix.

Used by `diagnosis_change.py` and `diagnosis_structure.py`. Every case is drawn from (seed, number) alone. Its row goes
to a file of JSON lines as soon as it is judged; a second call with the same file goes on where the first was stopped.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from diagnosis_cells import THERMAL, Rig, seen_as, true_V
from rich.console import Console
from rich.table import Table
from row_file import Row, add_row, read_rows
from threadpoolctl import threadpool_limits

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.answer.findings import Diagnosis
from models.effects import effects
from models.identification.search.given import GivenCandidate
from models.identification.search.search import Search
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import CellContext
from models.network.structure import Structure
from simulators.hidden_effect import Size

NONE, UNKNOWN = "none", "unknown_effect"
# Of these a log shows the sum only: each counts as right with the other as rival.
TWINS = {name for name, effect in effects().items() if effect.twin is not None}
# Sizes of the cases: of the voltage's change over its noise of 1 mV, and of the temperature's.
TARGET_MV, TARGET_K = (2.0, 20.0), (0.3, 3.0)
CLOSE, WORTH = 0.15, 1.15
_CONFIDENCE_EDGES = (0.0, 0.5, 0.7, 0.85, 0.95, 1.01)

Judge = Callable[[int, int, bool], Row]


def run_cases(arguments: argparse.Namespace, judge: Judge) -> int:
    """Judge `--cases` with an effect and `--nulls` without; print shares and confusion matrix."""
    done = _rows(arguments.rows)
    rows = []
    with threadpool_limits(1, user_api="blas"):
        for null in (False, True):
            for number in range(arguments.nulls if null else arguments.cases):
                key = (arguments.seed, number, null)
                row = done.get(key)
                if row is None:
                    row = {"seed": arguments.seed, "number": number, "null": null} | judge(arguments.seed, number, null)
                    add_row(arguments.rows, row)
                    print(line(row), file=sys.stderr, flush=True)
                rows.append(row)
    result = summary(rows)
    if arguments.json:
        print(json.dumps(result))
    else:
        show(result)
    return 0


def parser_of(description: str | None) -> argparse.ArgumentParser:
    """What both read from the command line."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60, help="with one or two effects")
    parser.add_argument("--nulls", type=int, default=20, help="with none")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rows", type=Path, metavar="FILE", help="one JSON line for each case; go on where it ends")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    return parser


def _rows(path: Path | None) -> dict[tuple[int, int, bool], Row]:
    return {(row["seed"], row["number"], row["null"]): row for row in read_rows(path)}


def quick_network(
    run: GridRun, initial_soc: float, capacity_Ah: float, structure: Structure, choice: GivenCandidate | None = None
) -> tuple[LocalModelNetwork, GivenCandidate]:
    """A network without output feedback and without all that a document of it holds; `choice` saves its search."""
    cell = CellContext(capacity_Ah)
    search = Search([run], [initial_soc], cell, lambda _share, _text: None)
    chosen = choice or search.best_within(structure)
    found = search.fitted(chosen)
    return LocalModelNetwork(found.structure, found.partition, found.theta, found.scaling, cell), chosen


@dataclass
class Sight:
    """What an effect does to the readings of one run, without noise.

    Attributes
    ----------
    current, chamber : (n,) of the run
    initial_soc : true one
    """

    current: FloatArray
    chamber: FloatArray
    initial_soc: float
    _seen: dict[tuple[Rig, float, float, float], FloatArray] = field(default_factory=dict)

    def error_V(self, before: Rig, after: Rig) -> FloatArray:
        """(n,) error that a perfect model of the rig before makes on what the sensors read after."""
        key = (before, after.sensors.current_offset_A, after.sensors.current_gain, after.stated_soc_error)
        if key not in self._seen:
            self._seen[key] = seen_as(before, self.current, self.chamber, self.initial_soc, after)
        return true_V(after, self.current, self.chamber, self.initial_soc)[0] - self._seen[key]

    def shows(self, before: Rig, after: Rig, thermal: bool) -> float:
        """RMS change in mV, or of the temperature reading in K."""
        if not thermal:
            return 1e3 * float(np.sqrt(np.mean(self.error_V(before, after) ** 2)))
        now, was = (true_V(rig, self.current, self.chamber, self.initial_soc)[1] for rig in (after, before))
        return float(np.sqrt(np.mean((now - was) ** 2)))


def scaled(
    make: Callable[[float], Rig],
    size: Size,
    rng: np.random.Generator,
    target: float,
    middle_shows: float,
) -> tuple[Rig, float, float] | None:
    """Make a rig with an effect of such a size that it shows by `target`, as far as the effect's range allows.

    Parameters
    ----------
    make : signed size -> rig
    size, rng : range of the size; gives it a sign
    target, middle_shows : by how much it should show, and by how much an effect of middle size does

    Returns
    -------
    The rig, the signed size, and by how much it shows, in proportion to an effect of middle size; None where that is
    less than two thirds of the target.
    """
    sign = size.signed(1.0, rng)
    for_one = middle_shows / middle(size)
    x = float(np.clip(target / max(for_one, 1e-12), 0.3 * size.low, size.high))
    shown = for_one * x
    return (make(sign * x), sign * x, shown) if shown >= target / 1.5 else None


def middle(size: Size) -> float:
    """A draw of middle size."""
    return float(np.sqrt(size.low * size.high))


def is_thermal(name: str) -> bool:
    """Whether an effect shows in the temperature."""
    return name in THERMAL


def same(named: str, truth: str) -> bool:
    """Whether a name counts as right."""
    return named == truth or {named, truth} <= TWINS


def answered(answer: Diagnosis, truth: list[str]) -> Row:
    """What an answer says, and whether that is right."""
    first = answer.findings[0] if answer.findings else None
    # A rival comes after what it is a rival of; that names it.
    found = [
        each
        for k, each in enumerate(answer.findings)
        if not any(each.effect in earlier.confounded_with for earlier in answer.findings[:k])
    ]
    named, rivals = [each.effect for each in found], list(first.confounded_with) if first else []
    told = named or [UNKNOWN if answer.verdict == "unknown_effect" else NONE]
    right = any(same(told[0], each) for each in truth) if truth else told == [NONE]
    among = not right and answer.verdict == "ambiguous" and any(same(r, t) for r in rivals for t in truth)
    return {
        "truth": truth,
        "verdict": answer.verdict,
        "named": told,
        "rivals": rivals,
        "right": right,
        "all_right": bool(truth) and all(any(same(n, t) for n in told) for t in truth),
        "too_many": len(told) > max(len(truth), 1),
        "ambiguous_with_truth": among,
        "confidence": [each.confidence for each in found],
        "named_right": [any(same(name, each) for each in truth) for name in named],
        "parameters": {e.effect: {k: v.value for k, v in e.parameters.items()} for e in answer.findings},
        "evidence": {each.effect: each.evidence for each in answer.findings},
        "unexplained_mV": answer.unexplained_mV,
        "depends_on": list(answer.depends_on),
        "diagnosis_s": answer.seconds,
    }


def stated_power(answer: Diagnosis, truth: list[str]) -> Row | None:
    """Smallest true effect that these data would have shown with 90 %; None where the answer does not say so."""
    return next((each._asdict() for each in answer.power if each.effect in truth), None)


def above_power(row: Row) -> bool:
    """Whether what was changed is larger than what is said to be seen: by its size, else by what it shows, in mV or K.

    Where neither is known the effect was not asked for, or nobody knows how large it is: it counts as large.
    """
    stated, shows = row["power"], row["shows"]
    if stated is None:
        return True
    if stated["size"] is None:
        return False
    if row.get("change") is not None:
        return abs(row["change"]) >= stated["size"]
    least = stated["rms_K"] if set(row["truth"]) & set(THERMAL) else stated["rms_mV"]
    return not shows or max(np.atleast_1d(shows)) >= least


def line(row: Row) -> str:
    """One case in one line."""
    truth = "+".join(row["truth"]) or NONE
    off = row.get("parameter_error")
    sizes = " ".join(f"{each:.1f}" for each in row["shows"])
    return (
        f"{row['number']:4d} {row['cell']} {row['profile']:8s} {truth:40s} {sizes:10s} -> {row['verdict']:15s} "
        f"{'+'.join(row['named']):40s} {'ok' if row['right'] else 'WRONG':5s} "
        f"sure {' '.join(f'{each:.2f}' for each in row['confidence'])} "
        f"off {'' if off is None else f'{off:+.2f}'} rivals {','.join(row['rivals'])} {row['diagnosis_s']:.1f} s"
    )


def summary(rows: list[Row]) -> Row:
    """Shares, calibration and the confusion matrix."""
    single = [row for row in rows if len(row["truth"]) == 1]
    double = [row for row in rows if len(row["truth"]) == 2]
    nulls = [row for row in rows if not row["truth"]]
    off = [abs(row["parameter_error"]) for row in rows if row.get("parameter_error") is not None]
    loud = [row for row in single if row.get("power") is not None and above_power(row)]
    ratios = [row["held_out_ratio"] for row in rows if row.get("held_out_ratio") is not None]
    return {
        "cases": len(single) + len(double),
        "top_1_right": _share([row["right"] for row in single + double]),
        "one_effect": {"cases": len(single), "right": _share([row["right"] for row in single])},
        "two_effects": {
            "cases": len(double),
            "first_right": _share([row["right"] for row in double]),
            "both_right": _share([row["all_right"] for row in double]),
        },
        "more_named_than_there_are": _share([row["too_many"] for row in single + double]),
        "ambiguous_with_truth_among_rivals": sum(row["ambiguous_with_truth"] for row in rows),
        "above_power": {
            "cases": len(loud),
            "first_right": sum(row["right"] for row in loud),
            "ambiguous_with_truth": sum(row["ambiguous_with_truth"] for row in loud),
        },
        "nulls": len(nulls),
        "false_alarms": _share([not row["right"] for row in nulls]),
        "parameter_within_15_percent": _share([each <= CLOSE for each in off]),
        "held_out_ratio": {"cases": len(ratios), "at_most_1.15": _share([each <= WORTH for each in ratios])},
        "confidence": _calibration(rows),
        "confusion": [[*pair, n] for pair, n in sorted(_pairs(rows).items())],
        "diagnosis_s_median": float(np.median([row["diagnosis_s"] for row in rows])) if rows else None,
    }


def _share(flags: list[bool]) -> float | None:
    return float(np.mean(flags)) if flags else None


def _calibration(rows: list[Row]) -> list[Row]:
    """Of the named findings in each range of confidence, how many were right."""
    pairs = [pair for row in rows for pair in zip(row["confidence"], row["named_right"], strict=True)]
    out = []
    for low, high in zip(_CONFIDENCE_EDGES[:-1], _CONFIDENCE_EDGES[1:], strict=True):
        inside = [right for sure, right in pairs if low <= sure < high]
        out.append({"from": low, "to": min(high, 1.0), "findings": len(inside), "right": _share(inside)})
    return out


def _pairs(rows: list[Row]) -> Counter:
    """(truth, named) of the first names; of two effects the one that was named, or else the first."""
    found: Counter = Counter()
    for row in rows:
        named, truth = row["named"][0], row["truth"] or [NONE]
        found[(next((each for each in truth if same(named, each)), truth[0]), named)] += 1
    return found


def show(result: Row) -> None:
    """Print the confusion matrix and the shares."""
    names = sorted({pair[0] for pair in result["confusion"]} | {pair[1] for pair in result["confusion"]})
    counts = {(truth, named): n for truth, named, n in result["confusion"]}
    table = Table(title="Truth (rows) against the effect named first (columns)")
    table.add_column("")
    for number, _ in enumerate(names):
        table.add_column(str(number), justify="right")
    for number, truth in enumerate(names):
        table.add_row(f"{number} {truth}", *[str(counts.get((truth, named), "")) for named in names])
    console = Console(width=160)
    console.print(table)
    for key, value in result.items():
        if key != "confusion":
            console.print(f"{key}: {value}")
