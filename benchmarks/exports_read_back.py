"""Each format that a run goes out in, read back by readers of others and compared column by column.

``python -m benchmarks.exports_read_back --reader-python PATH [--reader-python PATH ...] [--json]``

The readers are no part of the project's environment. Install them in some of their own and name the interpreters; what
one does not have is left out:

    python3 -m venv readers && readers/bin/pip install batterydf==0.1.0 polars fastparquet mat4py asammdf mdfreader \
        rocrate roc-validator scipy
    python3 -m venv later && later/bin/pip install \
        git+https://github.com/battery-data-alliance/battery-data-format@1412b98

Two records go out: cycles of a simulated cell, played by a service, with a model made from them and its comparison; and
made-up numbers with many digits, missing values and no date. Values must be equal to the bit, missing ones missing, no
column may be absent or unknown, units and names those of the format. Exit status 1 where anything is not.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench_service.client import BenchClient
from bench_service.exchange.write import encode_run, export_formats
from bench_service.store.samples import SampleReader

WORKER = Path(__file__).with_name("export_readers.py")
Columns = Mapping[str, Any]
CRATE = "ro-crate"
# Of the format's own documents, not of our tables: which label is which of our columns.
LABELS = {
    "Test Time / s": "time_s",
    "Current / A": "current_A",
    "Voltage / V": "voltage_V",
    "Ambient Temperature / degC": "ambient_degC",
    "Step Count / 1": "step_count",
    "Cycle Count / 1": "cycle_count",
}
START = "started_unix_s"  # of MDF in whole microseconds
SURFACE = {False: "Surface Temperature / degC", True: "Surface Temperature T1 / degC"}
UNITS = {"A": "A", "V": "V", "degC": "degC", "s": "s"}
CONFIG = """
data_dir = "data"
institution = "Read-back laboratory"
[bench.sim]
[bench.sim.simulate]
lock_step = true
"""
PROTOCOL = {
    "schema": "bench-protocol-1",
    "name": "two cycles",
    "record": {"time_s": 10},
    "steps": [{"step": "loop", "count": 2, "steps": [
        {"step": "cc_cv", "rate_C": 1.0, "voltage_V": 4.1, "until": {"rate_C": "C/10"}},
        {"step": "rest", "until": {"time_s": 600}},
        {"step": "constant_current", "rate_C": -1.0, "until": {"voltage_V": 3.0}},
        {"step": "rest", "until": {"time_s": 600}}]}],
}  # fmt: skip


class Record(NamedTuple):
    """A record: its columns by our names, when it began, and its files."""

    name: str
    columns: Columns
    started_unix_s: float | None
    files: dict[str, Path]


def main() -> int:
    """Make the records, ask each reader, print what came of it."""
    arguments = _arguments()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for record in (played(Path(scratch)), awkward(Path(scratch))):
            for python in arguments.reader_python:
                rows += asked(record, python)
    missing = {*export_formats(), CRATE} - {row["format"] for row in rows}
    if arguments.json:
        print(json.dumps({"rows": rows, "read by nobody": sorted(missing)}))
    else:
        for row in rows:
            what = "; ".join(row["wrong"]) or f"equal, {row['n_columns']} columns"
            said = "".join(f"\n    says: {each}" for each in row["said"])
            print(f"{row['record']:8s} {row['format']:18s} {row['reader']:28s} {what}{said}")
        print(f"read by nobody: {', '.join(sorted(missing)) or 'none'}")
    return int(bool(missing) or any(row["wrong"] for row in rows))


def played(scratch: Path) -> Record:
    """Let a service play cycles of a cell and make a model of them; export all over REST."""
    folder = scratch / "played"
    folder.mkdir()
    (folder / "bench.toml").write_text(CONFIG)
    with served(folder) as client:
        cell = client.add_cell(label="left", owner="Ana", metadata={"batch": "7b", "shelf": 3})
        client.put_cell("sim", cell["id"])
        protocol = client.upload_protocol(PROTOCOL, "sim")
        run = client.start_run("sim", None, 1.0, 0.5, protocol_id=protocol["id"], name="cycles")
        run = client.wait_run(run["id"])
        model = client.fit("read back", [run["id"]], run["capacity_Ah"], structure="minimal")
        client.compare(model["id"], [run["id"]])
        files = {}
        for kind in (*export_formats(), CRATE):
            name, content = client.export_named(run["id"], kind)
            files[kind] = _put(folder / kind / name, content)
            if kind.startswith("bdf"):
                metadata = json.dumps(client.metadata(run["id"])).encode()
                _put(files[kind].with_suffix(".metadata.json"), metadata)
    with SampleReader(folder / "data") as reader:
        columns = reader.read(run["id"]).columns
    charging = columns["current_A"][columns["step_count"] == 1]
    if run["state"] != "completed" or not np.all(charging[1:] > 0.0):
        raise RuntimeError(f"the run is {run['state']}, and its charge is no positive current: {run['reason']}")
    return Record("cycles", columns, datetime.fromisoformat(run["started_utc"]).timestamp(), files)


def awkward(scratch: Path) -> Record:
    """Numbers with all their digits, missing values, no date."""
    rng = np.random.default_rng(7)
    n = 5000
    columns = {
        "time_s": np.cumsum(rng.uniform(0.001, 60.0, n)),
        "current_A": rng.normal(size=n) * 10.0 ** rng.integers(-12, 3, n),
        "voltage_V": 3.7 + rng.standard_normal(n) * 1e-7,
        "temperature_degC": rng.uniform(-40.0, 60.0, n),
        "ambient_degC": np.where(rng.uniform(size=n) < 0.5, np.nan, 25.0),
    }
    columns["voltage_V"][[0, 17, n - 1]] = np.nan
    files = {
        kind: _put(scratch / "awkward" / kind / f"awkward{each.suffix}", encode_run(columns, kind))
        for kind, each in export_formats().items()
    }
    for kind, path in files.items():
        if kind.startswith("bdf"):
            _put(path.with_suffix(".metadata.json"), json.dumps({"raw": {"current_sign": "positive charges"}}).encode())
    return Record("awkward", columns, None, files)


def _put(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


@contextmanager
def served(folder: Path) -> Iterator[BenchClient]:
    """Give a client of a service in a process of its own, whose bench stands ready."""
    command = [sys.executable, "-m", "bench_service.cli", "serve", "--port", "0", "--json", "--config", "bench.toml"]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        with BenchClient(json.loads(process.stdout.readline())["address"]) as client:
            while client.bench("sim")["state"] != "idle":
                time.sleep(0.1)
            yield client
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


def asked(record: Record, python: Path) -> list[dict[str, Any]]:
    """Let the readers of one environment read a record's files, and compare."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "request.json").write_text(json.dumps({kind: str(path) for kind, path in record.files.items()}))
        subprocess.run([str(python), str(WORKER), str(folder)], check=True, stdout=subprocess.DEVNULL)
        answers = json.loads((folder / "answer.json").read_text())
        for k, answer in enumerate(answers):
            with np.load(folder / f"answer_{k}.npz") as arrays:
                answer["columns"] = dict(arrays)
    return [_row(record, answer) for answer in answers]


def _row(record: Record, answer: dict[str, Any]) -> dict[str, Any]:
    said = [each for each in answer["complaints"] if each.startswith("recommended:")]
    wrong = [each for each in answer["complaints"] if each not in said]
    if answer["reader"] != "roc-validator" and not wrong:
        truth = expected(record, answer["format"])
        if "later" in answer["version"]:  # it leaves out what it has no name for
            truth.pop(SURFACE[True], None)
        wrong = differences(answer["columns"], truth)
        wrong += [
            f"unit of {name}: {unit!r}"
            for name, unit in answer["units"].items()
            if unit != UNITS.get(name.rpartition("_")[2], "")
        ]
    reader = f"{answer['reader']} {answer['version']}"
    n_columns = len(answer["columns"])
    return {"record": record.name, "format": answer["format"], "reader": reader, "n_columns": n_columns,
            "wrong": wrong, "said": said}  # fmt: skip


def expected(record: Record, kind: str) -> dict[str, Any]:
    """Columns that a file of one format must have, by the names that it gives them."""
    own = dict(record.columns)
    start = {} if record.started_unix_s is None else {START: np.array([record.started_unix_s])}
    if kind == CRATE:
        return own | _labelled(record, old=False)
    if kind.startswith("bdf"):
        return _labelled(record, old=kind.endswith("0.1.0"))
    # A file of MDF has a date in any case: the beginning of Unix time, where none is known.
    return own | {"mat": start, "mdf4": start or {START: np.zeros(1)}}.get(kind, {})


def _labelled(record: Record, *, old: bool) -> dict[str, Any]:
    names = LABELS | {SURFACE[old]: "temperature_degC"}
    found = {label: record.columns[own] for label, own in names.items() if own in record.columns}
    if record.started_unix_s is not None:
        found["Unix Time / s"] = record.started_unix_s + record.columns["time_s"]
    return found


def differences(found: Columns, truth: Columns) -> list[str]:
    """Say what is missing, too much, or another value; nothing where all is equal to the bit."""
    wrong = [f"{name!r} is missing" for name in truth if name not in found]
    wrong += [f"{name!r} is nothing that was written" for name in found if name not in truth]
    for name in set(found) & set(truth):
        values = np.asarray(truth[name], dtype=np.float64)
        if len(found[name]) != len(values):
            wrong.append(f"{name!r} has {len(found[name])} values, not {len(values)}")
            continue
        near = np.isclose(found[name], values, rtol=0.0, atol=1e-6 if name == START else 0.0, equal_nan=True)
        if not near.all():
            k = int(np.argmax(~near))
            wrong.append(f"{name!r} is {found[name][k]!r} at row {k}, not {values[k]!r}")
    return wrong


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reader-python", type=Path, action="append", required=True, metavar="PATH")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
