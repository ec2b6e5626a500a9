"""The long proofs, one after the other; what has been proven already is not proven again.

``python benchmarks/proof.py [--into proof] [--data FOLDER] [NAME ...]``, or ``make proof``

Each proof is another benchmark in the size that docs/results.md quotes; `tests` are those tests that `make test` leaves
out because they take long. What it prints goes to `proof/NAME.txt` once it has ended; a proof whose file is there is
skipped, one that was stopped goes on at its next case where it keeps them (`proof/NAME.rows`, `proof/models`). Records
of real cells are not in the repository: what needs them is left out where `--data` does not name their folder. Ends
with 1 where one has failed.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent
MODELS, ROWS, DATA, TESTS = "{into}/models", "{into}/{name}.rows", "{data}", str(HERE.parent / "tests")
PROOFS: dict[str, tuple[str, ...]] = {
    "tests": ("-m", "pytest", "-m", "proof", "-n", "2", "--dist", "loadfile", "-q", TESTS),
    "recorder_kill": ("recorder_kill", "--kills", "100"),
    "power_cuts": ("power_cuts", "--cuts", "300"),
    "process_kills": ("process_kills", "--kills", "30", "--rows", ROWS),
    "campaign_kills": ("campaign_kills", "--campaigns", "2", "--kills", "10"),
    "stop_under_load": ("stop_under_load", "--presses", "100", "--rows", ROWS),
    "fault_table": ("fault_table", "--moments", "10", "--rows", ROWS),
    "fault_sequences": ("fault_sequences", "--cases", "2000", "--seed", "1"),
    "false_trips": ("false_trips", "--hours", "1000", "--rows", ROWS),
    "many_channels": ("many_channels", "--channels", "64", "--minutes", "10"),
    "sealed_game": ("sealed_game", "--games", "30", "--seed", "7301", "--rows", ROWS, "--json"),
    "diagnosis_structure": ("diagnosis_structure", "--cases", "60", "--nulls", "60", "--rows", ROWS, "--json"),
    "diagnosis_foreign": (
        "diagnosis_foreign",
        *("--cases", "40", "--nulls", "20", "--data", DATA, "--keep", MODELS, "--rows", ROWS, "--json"),
    ),
    "diagnosis_change": ("diagnosis_change", "--cases", "60", "--nulls", "20", "--rows", ROWS, "--json"),
    "simulated_cells": ("simulated_cells", "--seeds", "10", "--structure", "auto", "--json"),
    "observer_cases": ("observer_cases", "--cases", "200", "--filter-cases", "4", "--models", MODELS, "--json"),
    "observer_health": ("observer_health", "--cases", "40", "--models", MODELS, "--json"),
    "observer_modules": ("observer_modules", "--cases", "200", "--models", MODELS, "--json"),
    "observer_elsewhere": ("observer_elsewhere", "--data", DATA, "--json"),
    "trend_cases": ("trend_cases", "--cells", "4", "--json"),
    "trend_measured": ("trend_measured", "--data", f"{DATA}/aged", "--json"),
    "real_cells": ("real_cells", "--data", DATA, "--peers", "--resume", ROWS),
    "pybamm_cells": ("pybamm_cells", "--data", f"{DATA}/pybamm"),
}
_LAST_WORDS = 100


def main() -> int:
    """Run what has no result yet, then show all results."""
    arguments = _arguments()
    arguments.into.mkdir(parents=True, exist_ok=True)
    states = {name: prove(name, arguments.into, arguments.data) for name in arguments.names or PROOFS}
    _show(states, arguments.into)
    return int("failed" in states.values())


def prove(name: str, into: Path, data: Path | None) -> str:
    """Run one proof unless its result is there; returns what became of it."""
    result = into / f"{name}.txt"
    if result.exists():
        return "there"
    if data is None and any(DATA in part for part in PROOFS[name]):
        return "needs --data"
    module, *options = (part.format(into=into, name=name, data=data) for part in PROOFS[name])
    program = [module] if module == "-m" else [str(HERE / f"{module}.py")]
    command = [sys.executable, *program, *options]
    found = filter(None, [str(HERE.parent), os.environ.get("PYTHONPATH")])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(found)}
    print(f"{name} ...", flush=True)
    began_s = time.monotonic()
    with (into / f"{name}.part").open("w", encoding="utf-8") as output:
        status = subprocess.run(command, stdout=output, env=environment).returncode
    print(f"{name}: {time.monotonic() - began_s:.0f} s, status {status}", flush=True)
    if status:
        return "failed"
    (into / f"{name}.part").rename(result)
    return "proven"


def _show(states: dict[str, str], into: Path) -> None:
    table = Table("proof", "", "its last words")
    for name, state in states.items():
        file = into / f"{name}{'.part' if state == 'failed' else '.txt'}"
        words = file.read_text(encoding="utf-8").strip().splitlines() if file.exists() else []
        table.add_row(name, state, words[-1][:_LAST_WORDS] if words else "")
    Console().print(table)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--into", type=Path, default=Path("proof"), help="folder of the results")
    parser.add_argument("--data", type=Path, metavar="FOLDER", help="records of real cells, see real_cells.toml")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PROOFS)}; default: all")
    arguments = parser.parse_args()
    if unknown := set(arguments.names) - set(PROOFS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
