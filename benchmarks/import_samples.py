"""Reads every file of a folder with the reader of cyclers' files, whole and mutilated, and prints what came of it.

    python -m benchmarks.import_samples FOLDER

Each table of text is compared with a reader of a few lines that knows nothing of ours: it is told by hand in which
column what stands (`FACTS`), splits lines and calls float. A file whose Battery Data Format twin lies in the folder is
compared with that too. Then each is written anew in every way of `import_variants.TABLE_VARIANTS`: what comes of it
must be the same record, its first rows, or one clear line. Exit status 1 where something is wrong.
"""

from __future__ import annotations

import argparse
import gzip
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices
from benchmarks.import_variants import TABLE_VARIANTS, Arrays, Table, Variant, record, record_variants, table_of


@dataclass(frozen=True)
class Facts:
    """By hand: how a file is written, and which column (from 0) holds what, in which scale."""

    separator: str
    header: int  # lines before that of the names
    time: tuple[int, float]
    current: tuple[int, float]
    voltage: int
    temperature: int | None = None
    cycle: int | None = None
    step: int | None = None
    dates: bool = False
    twin: str = ""
    sign: str | None = None
    left_out: str = ""


FACTS = {
    "sample_data_arbin.csv": Facts(",", 0, (2, 1.0), (9, 1.0), 10, 23, 4, 5),
    "sample_data_maccor.csv": Facts(",", 2, (3, 1.0), (7, 1.0), 8, 10, 1, 2),
    "sample_data_basytec.txt": Facts("\t", 12, (0, 1.0), (8, 1.0), 7, 22, 26, 5),
    "sample_data_novonix.csv": Facts(",", 20, (3, 3600.0), (5, 1.0), 6, 8, 1, 13),
    "Sample_data_biologic_CA1.txt": Facts("\t", 102, (2, 1.0), (4, 1e-3), 3, 15, 12, 1),
    "Sample_data_biologic_timestamped.txt": Facts("\t", 97, (2, 1.0), (4, 1e-3), 3, 15, 12, 1, dates=True),
    "Sample_data_biologic_no_header.mpt": Facts("\t", 0, (8, 1.0), (11, 1e-3), 10, 17, 29, 6),
    "Landt_raw.csv.gz": Facts(
        ",", 6, (4, 1.0), (6, 1.0), 7, None, 1, 2, twin="SINTEF__LiGrR2032__2024-04-30__25degC__Landt.bdf.csv.gz"
    ),
    "SINTEF__LiGrR2032__2024-04-30__25degC__Landt.bdf.csv.gz": Facts(",", 0, (0, 1.0), (2, 1.0), 1, None, None, 3),
    "SINTEF__SLPBA842124HV__2024-10-23__Rate_25degC__Neware__Time_Bug.bdf.csv.gz": Facts(
        ",", 0, (0, 1.0), (2, 1.0), 1, 6, 3, 4, left_out="clock falls back"
    ),
    "sample.bdf.csv": Facts(",", 0, (0, 1.0), (2, 1.0), 1, sign="discharge-positive"),
}
_SCALE = {"time_s": 1e-6, "current_A": 1e-9, "voltage_V": 1e-9, "temperature_degC": 1e-9}


def read_plainly(path: Path, facts: Facts) -> tuple[Table, Arrays]:
    """Read a file by its facts: split lines, call float."""
    content = gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    lines = content.decode("utf-8-sig").replace("\r\n", "\n").split("\n")
    names = lines[facts.header].split(facts.separator)
    rows = [line.split(facts.separator) for line in lines[facts.header + 1 :] if line.strip()]
    wide = len(rows[0])
    table = Table((names + [""] * wide)[:wide], rows, facts.time[0], facts.current[0], facts.voltage)
    cells = {
        "time_s": facts.time[0],
        "current_A": facts.current[0],
        "voltage_V": facts.voltage,
        "temperature_degC": facts.temperature,
        "cycle_count": facts.cycle,
        "step_count": facts.step,
    }
    arrays: Arrays = {}
    for name, k in cells.items():
        if k is not None and not (name == "time_s" and facts.dates):
            arrays[name] = np.array([float(row[k]) if row[k].strip() else np.nan for row in rows])
    if facts.dates:
        clock = [row[facts.time[0]].split()[1].split(":") for row in rows]
        seconds = np.array([int(h) * 3600 + int(m) * 60 + float(s) for h, m, s in clock])
        arrays["time_s"] = seconds - seconds[0]
    arrays["time_s"] = arrays["time_s"] * facts.time[1]
    arrays["current_A"] = arrays["current_A"] * facts.current[1] * (-1.0 if facts.sign else 1.0)
    if facts.left_out:
        arrays = _without_fallbacks(arrays)
    return table, arrays


def _without_fallbacks(arrays: Arrays) -> Arrays:
    time = arrays["time_s"]
    keep = np.concatenate([[True], ~((time[1:-1] < time[:-2]) & (time[2:] >= time[:-2])), [True]])
    return {name: values[keep] for name, values in arrays.items()}


def differences(found: Arrays, truth: Arrays, n: int) -> str:
    """Say what differs in the first `n` rows; empty where nothing does."""
    if len(found["time_s"]) != n:
        return f"{len(found['time_s'])} rows, not {n}"
    for name, values in truth.items():
        if name not in found:
            return f"{name} is missing"
        wrong = ~np.isclose(found[name], values[:n], rtol=1e-9, atol=_SCALE.get(name, 0.0), equal_nan=True)
        if wrong.any():
            k = int(np.argmax(wrong))
            return f"{name} is {found[name][k]} at row {k}, not {values[k]}"
    return ""


def try_variant(path: Path, table: Table, variant: Variant, truth: Arrays, choices: Choices | None = None) -> str:
    """Write a variant, read it, and say what is wrong with what came of it; empty where nothing is."""
    path.write_bytes(variant.write(table))
    given = {key: value for key, value in variant.choices.items() if key != "days"}
    try:
        run = import_file(path, choices or Choices(**given))
    except QuestionError as error:
        if variant.expect == "asks" and (not variant.asks or error.asks == variant.asks) and "\n" not in str(error):
            return ""
        return f"asks {error.asks}: {error}"
    except RunFileError as error:
        return "" if variant.expect == "refused" and "\n" not in str(error) else f"refused: {error}"
    found, remarks = run.columns(), " / ".join(run.remarks)
    run.close()
    if variant.expect in ("asks", "refused"):
        return f"read {run.n} rows without a word"
    if variant.remark not in remarks:
        return f"does not say {variant.remark!r}: {remarks}"
    if variant.expect == "rest":
        return ""
    n = len(truth["time_s"])
    if variant.expect == "part":
        n = len(found["time_s"])
        if not 1 < n < len(truth["time_s"]):
            return f"{n} rows of {len(truth['time_s'])}"
    shift = {"time_s": truth["time_s"] + 86400.0} if "days" in variant.choices else {}
    return differences(found, {**truth, **shift}, n)


def real_file(path: Path, facts: Facts, directory: Path) -> list[str]:
    """Compare one file, and everything made of it; returns what is wrong."""
    table, truth = read_plainly(path, facts)
    base = Choices(current_sign=facts.sign)
    run = import_file(path, base)
    problems = [text for text in [differences(run.columns(), truth, len(truth["time_s"]))] if text]
    run.close()
    if facts.twin:
        twin = import_file(path.parent / facts.twin)
        wanted = {name: values for name, values in twin.columns().items() if name != "temperature_degC"}
        problems += [f"twin: {text}" for text in [differences(run_columns(path, base), wanted, twin.n)] if text]
        twin.close()
    for title, variant in TABLE_VARIANTS.items():
        if not _applies(title, facts, table):
            continue
        wrong = try_variant(
            directory / f"{path.name.split('.')[0]}.csv", table, variant, truth, _choices(variant, base)
        )
        if wrong:
            problems.append(f"{title}: {wrong}")
    return problems


def run_columns(path: Path, choices: Choices) -> Arrays:
    """Columns of a file."""
    run = import_file(path, choices)
    columns = run.columns()
    run.close()
    return columns


def _choices(variant: Variant, base: Choices) -> Choices | None:
    if base.current_sign is None or variant.expect in ("asks", "refused"):
        return None
    return Choices(**{"current_sign": base.current_sign, **variant.choices})


def _applies(title: str, facts: Facts, table: Table) -> bool:
    """Variants that mean something for this table."""
    if facts.left_out and title in ("a third twice", "a third twice, told", "each row twice", "clock falls back"):
        return False
    if facts.sign or facts.dates:
        return not any(word in title for word in ("sign", "twice", "clock", "cut in", "unknown"))
    for mark, word in (("\t", "tab"), ("|", "|"), (";", ";")):
        if word in title and any(mark in cell for row in [table.names, *table.rows[:20]] for cell in row):
            return False
    short = len(table.rows) < 40
    return not (short and any(word in title for word in ("sign", "cut in its last", "third", "clock")))


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        directory = Path(name)
        for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "meta.json"):
            wrong += _print_file(path, directory)
        truth = record()
        every = {title: (table_of(truth), variant) for title, variant in TABLE_VARIANTS.items()} | record_variants(
            truth
        )
        bad = {t: w for t, (table, v) in every.items() if (w := try_variant(directory / "own.csv", table, v, truth))}
        print(f"{'own record':44s} {len(every)} variants, {len(bad)} wrong")
        for title, text in bad.items():
            print(f"    {title}: {text}")
        wrong += len(bad)
    return 1 if wrong else 0


def _print_file(path: Path, directory: Path) -> int:
    facts = FACTS.get(path.name)
    try:
        run = import_file(path, Choices(current_sign=facts.sign if facts else None))
    except RunFileError as error:
        print(f"{path.name[:44]:44s} {str(error).removeprefix(str(path))[2:150]}")
        return 0 if facts is None else 1
    current = run.columns()["current_A"]
    span = f"{np.nanmin(current):+.4g} to {np.nanmax(current):+.4g} A"
    run.close()
    problems = real_file(path, facts, directory) if facts else []
    checked = "equal, and its variants" if facts and not problems else f"{len(problems)} wrong" if facts else "read"
    print(f"{path.name[:44]:44s} {run.mapping.name:9s} {run.n:6d} rows {span:26s} {checked}")
    for text in problems:
        print(f"    {text}")
    return len(problems)


if __name__ == "__main__":
    sys.exit(main())
