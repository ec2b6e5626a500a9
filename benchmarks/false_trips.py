"""Plausibility rules: trips of cells in normal running (bar: none in 24 h), and what they see of what is wrong.

    python -m benchmarks.false_trips --hours 24 [--rows false_trips.rows]
    python -m benchmarks.false_trips --measured FOLDER
    python -m benchmarks.false_trips --wrong 200 [--seed 1]

Each case is one kind of profile on one simulated cell at one temperature, one place in its charge and one period, seen
through noisy sensors by the rules that a run has. With `--rows` a case that has been played is not played again.
`--measured` takes the logs of real cells that `real_cells.toml` names in their place. `--wrong` puts each way to be
wrong into random cases, from the first pulse or a random moment on: how many are seen, and after how long.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from bench_service.bench.plausibility import Finding, Sample, Watch, band_of, observe
from bench_service.bench.plausibility.band import CellBand
from bench_service.exchange.read import read_run
from benchmarks.real_cells_table import read_table, splits_of
from benchmarks.row_file import Row, add_row, read_rows
from models.design.test_signals import find_families
from models.design.test_signals.family import FamilyRequest
from simulators.catalogue import cell_type
from simulators.cell import Cell
from simulators.sensors import SensorParameters, Sensors

HERE = Path(__file__).parent
CELLS = ("nmc", "lfp", "nimh")
TEMPERATURES_DEGC = (25.0, 0.0, 45.0)
SOCS = (0.5, 0.15, 0.85)
PERIODS_S = (0.1, 1.0, 10.0)
SHARES = (1.0, 0.1)  # of the cell's largest current
LEAST_A = 0.15
REST_SAMPLES = 10  # before each profile
DURATION_S = {0.1: 240.0, 1.0: 1800.0, 10.0: 7200.0}


@dataclass(frozen=True)
class Case:
    """One run."""

    cell: str
    family: str
    temperature_degC: float
    soc: float
    dt_s: float
    share: float
    seed: int

    @property
    def name(self) -> str:
        """Key of its row."""
        numbers = (self.temperature_degC, self.soc, self.dt_s, self.share, self.seed)
        return " ".join([self.cell, self.family, *(f"{number:g}" for number in numbers)])


def cases(seed: int) -> Iterator[Case]:
    """Every combination, for one seed."""
    families = sorted(find_families())
    for cell, family, temperature, soc, dt_s, share in itertools.product(
        CELLS, [*families, "constant"], TEMPERATURES_DEGC, SOCS, PERIODS_S, SHARES
    ):
        yield Case(cell, family, temperature, soc, dt_s, share, seed)


def signal(case: Case, duration_s: float) -> np.ndarray:
    """Set-points of a case, with a rest before them."""
    kind, rng = cell_type(case.cell), np.random.default_rng(case.seed)
    low_A, high_A = (case.share * value for value in kind.limits.current_A)
    if case.family == "constant":
        n = max(4, round(duration_s / case.dt_s))
        held = np.repeat([high_A / 2, 0.0, low_A / 2, 0.0], n // 4)
    else:
        request = FamilyRequest(
            (low_A, high_A),
            (0.05, 0.95),
            kind.parameters.capacity_Ah,
            case.soc,
            duration_s,
            case.dt_s,
            cycle_A=_cycle(duration_s, case.dt_s, rng),
        )
        held = find_families()[case.family].build(request, rng)
    return np.concatenate([np.zeros(REST_SAMPLES), held])


def _cycle(duration_s: float, dt_s: float, rng: np.random.Generator) -> np.ndarray:
    """A load cycle as a vehicle's: drives that discharge, brakings that charge, halts between."""
    n = max(10, round(min(duration_s / 4.0, 600.0) / dt_s))
    driven = np.asarray(lfilter([1.0], [1.0, -math.exp(-dt_s / 5.0)], rng.standard_normal(n)))
    return np.where(np.sin(np.arange(n) * dt_s / 20.0) > -0.7, driven - driven.std(), 0.0)


def samples(case: Case, current_A: np.ndarray) -> Iterator[Sample]:
    """What the sensors give of a case; ends where the cell leaves its limits, as a run would."""
    kind = cell_type(case.cell)
    cell = Cell(kind.parameters, soc=case.soc, ambient_degC=case.temperature_degC)
    sensors = Sensors(SensorParameters(), np.random.default_rng(case.seed))
    low_V, high_V = kind.limits.voltage_V
    for k, value in enumerate(current_A):
        truth = cell.step(float(value), case.dt_s)
        seen = sensors.measure(truth, float(value), case.temperature_degC)
        if not low_V <= seen.voltage_V <= high_V or seen.temperature_degC > kind.limits.temperature_degC[1]:
            return
        yield Sample(k * case.dt_s, seen.voltage_V, seen.current_A, seen.temperature_degC)


def play(case: Case) -> Row:
    """Play a case; its row."""
    kind = cell_type(case.cell)
    band = band_of(kind.parameters.capacity_Ah, kind.limits.voltage_V)
    return watched(case.name, samples(case, signal(case, DURATION_S[case.dt_s])), band)


def watched(name: str, seen: Iterable[Sample], band: CellBand) -> Row:
    """Show samples to the rules until one trips; the row of it."""
    watch, warned, last = Watch(), Counter[str](), None
    trip: Finding | None = None
    for last in seen:
        watch, finding = observe(watch, band, last, LEAST_A)
        if finding is not None and finding.stage == "trip":
            trip = finding
            break
        if finding is not None:
            warned[finding.code] += 1
    time_s = 0.0 if last is None else last.time_s
    return {
        "case": name,
        "hours": time_s / 3600.0,
        "trip": None if trip is None else f"{trip.code} at {time_s:g} s: {trip.text}",
        "code": None if trip is None else trip.code,
        "warned": dict(warned),
    }


def measured(data: Path) -> Iterator[Row]:
    """Logs of real cells, each file once."""
    for name, record in read_table(HERE / "real_cells.toml").items():
        splits = splits_of(name, record, data)
        files = {piece.file for split in splits for piece in (*split.train.values(), *split.judge.values())}
        for file in sorted(files):
            run = read_run(file)
            band = band_of(splits[0].capacity_Ah, (float(run.voltage_V.min()), float(run.voltage_V.max())))
            columns = (run.time_s, run.voltage_V, run.current_A, run.temperature_degC)
            row = watched(file.stem, (Sample(*map(float, each)) for each in zip(*columns, strict=True)), band)
            yield row | {"hours": row["hours"] - float(run.time_s[0]) / 3600.0}


# --- what is wrong -----------------------------------------------------------------------------------------

# Name -> how a sample changes, and whether it is wrong from the beginning on.
Change = Callable[[Sample, Sample], Sample]  # the last right one, this one
WRONG: dict[str, tuple[Change, bool]] = {
    "voltage stuck from the start": (lambda first, s: replace(s, voltage_V=first.voltage_V), True),
    "voltage stuck": (lambda first, s: replace(s, voltage_V=first.voltage_V), False),
    "voltage +0.2 V": (lambda _, s: replace(s, voltage_V=s.voltage_V + 0.2), False),
    "voltage -0.8 V": (lambda _, s: replace(s, voltage_V=s.voltage_V - 0.8), False),
    "temperature stuck": (lambda first, s: replace(s, temperature_degC=first.temperature_degC), False),
    "current reversed in the map": (lambda first, s: replace(s, voltage_V=2 * first.voltage_V - s.voltage_V), True),
    "temperature +0.5 K/s": (
        lambda first, s: replace(s, temperature_degC=s.temperature_degC + 0.5 * (s.time_s - first.time_s)),
        False,
    ),
}
PLAYED_S, LEAST_S = 900.0, 5.0
QUICK_S = (0.1, 1.0)


def spoilt(case: Case, change: Change, from_s: float) -> Iterator[Sample]:
    """Samples of a case that are wrong from a moment on."""
    first: Sample | None = None
    for sample in samples(case, signal(case, max(PLAYED_S, DURATION_S[case.dt_s]))):
        if sample.time_s > from_s + PLAYED_S:
            return
        if first is None or sample.time_s < from_s:
            first = sample
        yield sample if sample.time_s < from_s else change(first, sample)


def wrong(n: int, seed: int) -> Iterator[dict[str, Any]]:
    """For each way to be wrong, n random cases at full load: how many are seen, and after how long."""
    rng = np.random.default_rng(seed)
    chosen = [case for case in cases(seed) if case.dt_s in QUICK_S and case.share == SHARES[0]]
    for name, (change, at_start) in WRONG.items():
        codes, delays_s = Counter[str](), list[float]()
        for index in rng.integers(0, len(chosen), n):
            case = chosen[index]
            kind = cell_type(case.cell)
            from_s = REST_SAMPLES * case.dt_s if at_start else float(rng.uniform(0.1, 0.5)) * DURATION_S[case.dt_s]
            band = band_of(kind.parameters.capacity_Ah, kind.limits.voltage_V)
            row = watched(case.name, spoilt(case, change, from_s), band)
            if row["code"] is None and row["hours"] * 3600.0 < from_s + LEAST_S:  # a cell that was full or empty before
                continue
            codes[str(row["code"])] += 1
            if row["code"] is not None:
                delays_s.append(row["hours"] * 3600.0 - from_s)
        quantiles = [round(float(np.quantile(delays_s, q)), 1) for q in (0.5, 0.95)] if delays_s else []
        yield {"wrong": name, "cases": codes.total(), "seen": len(delays_s), "after_s": quantiles, "codes": dict(codes)}


def main() -> int:
    """Play cases until so many hours have passed; the exit code says whether none has tripped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--measured", type=Path, metavar="FOLDER", help="records of real cells, see real_cells.toml")
    parser.add_argument("--wrong", type=int, default=0, metavar="CASES", help="so many of each way to be wrong")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.wrong:
        for line in wrong(options.wrong, options.seed):
            print(json.dumps(line), flush=True)  # noqa: T201
        return 0
    rows = list[Row]()
    for row in measured(options.measured) if options.measured else _simulated(options.hours, options.rows):
        rows.append(row)
        if row["trip"] or row["warned"]:
            print(json.dumps(row), flush=True)  # noqa: T201
    return _end(rows)


def _simulated(hours: float, kept: Path | None) -> Iterator[Row]:
    known, passed = {row["case"]: row for row in read_rows(kept)}, 0.0
    for case in itertools.chain.from_iterable(map(cases, itertools.count(1))):
        if passed >= hours:
            return
        row = known.get(case.name) or play(case)
        if case.name not in known:
            add_row(kept, row)
        passed += row["hours"]
        yield row


def _end(rows: list[Row]) -> int:
    tripped = sum(row["trip"] is not None for row in rows)
    warned = sum((Counter(row["warned"].keys()) for row in rows), Counter[str]())
    hours = round(sum(row["hours"] for row in rows), 1)
    answer = {"cases": len(rows), "hours": hours, "trips": tripped, "cases_with_warnings": dict(warned)}
    print(json.dumps(answer))  # noqa: T201
    return 1 if tripped else 0


if __name__ == "__main__":
    raise SystemExit(main())
