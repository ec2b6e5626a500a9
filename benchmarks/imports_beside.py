"""Files of cyclers as we read them and as batterydf and PyProBE do, side by side.

    python -m benchmarks.imports_beside FOLDER --reader-python PATH [--reader-python PATH ...]

The readers are no part of the project's environment: name the interpreters of environments with ``batterydf`` and with
``PyProBE-Data``, one each since they want other versions of the same packages. A row of ours must be one of theirs, in
order, with the same current, voltage and time from the first row. Nothing says by itself who is right where they
differ; exit status 1 only where a reading of theirs holds no row of ours.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices
from benchmarks.import_samples import FACTS

WORKER = Path(__file__).with_name("import_readers.py")
Arrays = dict[str, Any]
# Half of the last digit that any of the files has.
NEAR = {"after_s": 1e-3, "current_A": 1e-7, "voltage_V": 1e-7}

# Rows of theirs within which our next one must be.
WINDOW = 200


def main() -> int:
    """Print a line for each file and reader."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--reader-python", type=Path, action="append", required=True, metavar="PATH")
    arguments = parser.parse_args()
    files = sorted(path for path in arguments.folder.rglob("*") if path.is_file() and path.suffix != ".json")
    ours = {path.name: read for path in files if (read := own(path)) is not None}
    alien = 0
    for python in arguments.reader_python:
        for answer, theirs in asked(python, files):
            text, strange = beside(ours.get(answer["file"]), theirs, answer["complaint"])
            alien += strange
            print(f"{answer['file'][:40]:40s} {answer['reader']} {answer['version']}: {text}")
    return int(alien > 0)


def own(path: Path) -> Arrays | None:
    """Read a file as the service does; None where it refuses."""
    facts = FACTS.get(path.name)
    try:
        run = import_file(path, Choices(current_sign=facts.sign if facts else None))
    except RunFileError:
        return None
    columns = run.columns()
    run.close()
    return columns


def asked(python: Path, files: list[Path]) -> list[tuple[dict[str, Any], Arrays]]:
    """Let the readers of one environment read the files."""
    with tempfile.TemporaryDirectory() as name:
        command = [str(python), str(WORKER), name, *map(str, files)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        answers = json.loads(Path(name, "answer.json").read_text())
        found = []
        for k, answer in enumerate(answers):
            with np.load(Path(name, f"{k}.npz")) as arrays:
                found.append((answer, dict(arrays)))
    return found


def beside(ours: Arrays | None, theirs: Arrays, complaint: str) -> tuple[str, bool]:
    """Say how two readings of a file differ, and whether they have nothing in common."""
    if ours is None:
        return ("neither reads it" if complaint else f"reads {len(theirs['time_s'])} rows of what we refuse"), False
    if complaint:
        return f"does not read it: {complaint}", False
    n, more = len(ours["time_s"]), len(theirs["time_s"]) - len(ours["time_s"])
    rest = f"; {more} rows more" if more else ""
    if len(rows_of(_from_zero(ours), _from_zero(theirs))) == n:
        return f"all {n} rows equal{rest}", False
    chosen = rows_of(ours, theirs)
    if len(chosen) == n:
        shift_s = theirs["time_s"][chosen] - ours["time_s"]
        return f"all {n} rows equal but for times, off by up to {np.ptp(shift_s):.4g} s{rest}", False
    turned = ours | {"current_A": -ours["current_A"]}
    how = "all with the other sign" if len(rows_of(turned, theirs)) == n else "they have other values"
    return f"{len(chosen)} of our {n} rows are theirs; {how}", not chosen and "sign" not in how


def _from_zero(rows: Arrays) -> Arrays:
    return rows | {"after_s": rows["time_s"] - rows["time_s"][0]}


def rows_of(ours: Arrays, theirs: Arrays) -> list[int]:
    """Rows of theirs that are ours, in order; with the time where both have ``after_s``."""
    names = [name for name in NEAR if name in ours]
    mine, other = (np.stack([rows[name] for name in names], axis=1) for rows in (ours, theirs))
    near = [NEAR[name] for name in names]
    chosen: list[int] = []
    at = 0
    for row in mine:
        hits = np.all(np.abs(other[at : at + WINDOW] - row) <= near, axis=1)
        if hits.any():
            chosen.append(at + int(np.argmax(hits)))
            at = chosen[-1] + 1
    return chosen


if __name__ == "__main__":
    sys.exit(main())
