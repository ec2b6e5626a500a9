"""Measured cells by command line: what a model lacks is named and added, and the held-out error falls.

``python benchmarks/diagnosis_measured.py --data FOLDER [--work FOLDER] [--only NAME ...] [--steps N] [--json]``

Each case is a chain of the commands that a person would type: `fit`, then `diagnose` and `add-effect` with the effect
that is named first, until nothing is named, the held-out error rises, or N effects are added. In change mode it is
`fit` and `diagnose` alone. Models and rows are kept in `--work` (rows.jsonl): a chain that was done is not done again.
Records marked "judge only" may be judged with, but not passed on: only their names stand here.
"""

import argparse
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.console import Console
from rich.table import Table
from row_file import Row, add_row, read_rows

_TIMEOUT_S = 900.0
# An error that rises by more is a step that did harm.
_ROSE = 1.02
_PANASONIC = ("panasonic_18650pf", 2.968, ("drive_*_Cycle_*", "drive_*_NN*"), ("drive_*_US06*", "drive_*_HW*"))
_A123_MIDDLE = ("a123_esc", 2.03, ("dyn_P05", "dyn_P45", "dyn_P25_recharge25"), ("dyn_P25",))
_A123_COLD = ("a123_esc", 2.03, ("dyn_P25", "dyn_P45", "dyn_P25_recharge25"), ("dyn_P05",))
_A123_DRIVES = ("a123_esc", 2.03, ("dyn_P05", "dyn_P45"), ("dyn_P25", "dyn_P25_recharge25"))
_A123_SLOW = ("a123_esc", 2.03, ("dyn_P05", "dyn_P45", "ocv_P25"), ("dyn_P25",))
_NMC = ("pybatteryid_nmc", 0.95557, ("nmc_identification_data",), ("nmc_drive_cycle_data",))


@dataclass(frozen=True)
class Case:
    """A chain: record with capacity, training and judged runs; the first model; the right effects, in order."""

    name: str
    record: tuple[str, float, tuple[str, ...], tuple[str, ...]]
    first: tuple[str, ...]
    right: tuple[frozenset[str], ...]
    mode: str = "structure"


def _bounded(left_out: str) -> tuple[str, ...]:
    return ("--structure", "bounded", "--without", left_out)


def _one(*names: str) -> tuple[frozenset[str], ...]:
    return (frozenset(names),)


_WARM, _SLOW, _LOOP = "temperature_dependence", "relaxation", "hysteresis"
CASES = (
    Case("panasonic_minimal", _PANASONIC, ("--structure", "minimal"), _one(_WARM) + _one("charge_transfer", _SLOW)),
    Case("panasonic_no_temperature", _PANASONIC, _bounded(_WARM), _one(_WARM)),
    Case("panasonic_no_relaxation", _PANASONIC, _bounded(_SLOW), _one(_SLOW)),
    Case("a123_25_no_hysteresis", _A123_MIDDLE, _bounded(_LOOP), _one(_LOOP)),
    Case("a123_5_no_hysteresis", _A123_COLD, _bounded(_LOOP), _one(_LOOP)),
    Case("a123_drives_no_hysteresis", _A123_DRIVES, _bounded(_LOOP), _one(_LOOP)),
    Case("a123_25_minimal", _A123_MIDDLE, ("--structure", "minimal"), _one(_LOOP)),
    Case("a123_slow_no_hysteresis", _A123_SLOW, _bounded(_LOOP), _one(_LOOP)),
    Case("a123_slow_minimal", _A123_SLOW, ("--structure", "minimal"), _one(_LOOP)),
    Case("nmc_drive_cycle", _NMC, (), _one("soc_dependence", "series_resistance", "charge_transfer"), "change"),
)


def main() -> int:
    arguments = _arguments()
    with TemporaryDirectory() as scratch:
        work = arguments.work or Path(scratch)
        work.mkdir(parents=True, exist_ok=True)
        kept = work / "rows.jsonl"
        done = {row["case"]: row for row in read_rows(kept)}
        rows = []
        for case in CASES:
            if arguments.only and case.name not in arguments.only:
                continue
            if case.name not in done:
                done[case.name] = judge(case, arguments.data, work, arguments.steps)
                add_row(kept, done[case.name])
            rows.append(done[case.name])
    if arguments.json:
        sys.stdout.write(json.dumps(rows, indent=1) + "\n")
    else:
        _show(rows)
    return 0


def judge(case: Case, data: Path, work: Path, steps: int) -> Row:
    """Play a chain; the row has what was named and the held-out error in mV after each step."""
    folder, capacity_Ah, train, judged = case.record
    runs, held_out = _files(data / folder, train), _files(data / folder, judged)
    started, model = time.monotonic(), work / f"{case.name}_0.json"
    fit = ["fit", *runs, "--validate", *held_out, "--capacity-Ah", str(capacity_Ah), *case.first, "--out", str(model)]
    _told(fit)
    named, added, errors_mV = list[str](), list[str](), list[float]()
    rest = list[str]()
    while True:
        answer = _told(["diagnose", str(model), *held_out, "--train", *runs, "--mode", case.mode])
        named.append(answer["findings"][0]["effect"] if answer["findings"] else answer["verdict"])
        rest.append(f"{answer['verdict']} {answer['findings'][0]['confidence']:.2f}" if answer["findings"] else "")
        if case.mode == "change" or not answer["findings"] or len(added) == steps:
            break
        new = work / f"{case.name}_{len(added) + 1}.json"
        put_in = _told(
            ["add-effect", str(model), named[-1], "--train", *runs, "--validate", *held_out, "--out", str(new)]
        )
        errors_mV = errors_mV or [put_in["error_before_mV"]]
        errors_mV.append(put_in["error_after_mV"])
        added.append(named[-1])
        if errors_mV[-1] > _ROSE * errors_mV[-2]:
            break
        model = new
    named_right = all(found in right for found, right in zip(named, case.right, strict=False))
    return {
        "case": case.name,
        "named": named,
        "answers": rest,
        "added": added,
        "errors_mV": errors_mV,
        "right": named_right and len(named) >= len(case.right),
        "falls": all(b < a for a, b in pairwise(errors_mV)),
        "seconds": time.monotonic() - started,
    }


def _files(folder: Path, patterns: tuple[str, ...]) -> list[str]:
    found = [str(path) for pattern in patterns for path in sorted(folder.glob(f"{pattern}.csv.gz"))]
    if not found:
        raise SystemExit(
            f"{folder}: there is no {', '.join(patterns)} (.csv.gz); give the folder of the records with --data"
        )
    return found


def _told(words: list[str]) -> Row:
    """Answer of one call of the command line."""
    call = [sys.executable, "-m", "bench_service.cli", *words, "--json"]
    done = subprocess.run(call, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    if done.returncode != 0:
        raise SystemExit(f"bench-service {words[0]}: exit {done.returncode}: {done.stderr.strip()}")
    return json.loads(done.stdout)


def _show(rows: list[Row]) -> None:
    table = Table("case", "named, one after the other", "held-out error mV", "right", "falls", "s")
    for row in rows:
        errors = " -> ".join(f"{each:.1f}" for each in row["errors_mV"])
        right = "yes" if row["right"] else "no"
        falls = "yes" if row["falls"] else "no"
        table.add_row(row["case"], ", ".join(row["named"]), errors, right, falls, f"{row['seconds']:.0f}")
    Console(width=160).print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n", 1)[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with a folder for each record")
    parser.add_argument("--work", type=Path, help="models and rows are kept here; what is there is not done again")
    parser.add_argument("--only", nargs="+", choices=[case.name for case in CASES], default=[])
    parser.add_argument("--steps", type=int, default=3, help="effects that are added at most")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
