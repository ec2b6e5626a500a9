"""False trips of the plausibility rules: simulated cells in normal running, every kind of profile (bar: none in 24 h).

    python -m benchmarks.false_trips --hours 24 [--rows false_trips.rows]

Each case is one kind of profile on one simulated cell at one temperature, one place in its charge and one period, seen
through noisy sensors by the rules that a run has. With `--rows` a case that has been played is not played again. Then
each way to be wrong is put into the same signals: how many are seen, and after how long.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench_service.bench.plausibility import Finding, Sample, Watch, band_of, observe
from benchmarks.row_file import add_row, read_rows
from models.design.test_signals import find_families
from models.design.test_signals.family import FamilyRequest
from simulators.catalogue import cell_type
from simulators.cell import Cell
from simulators.sensors import SensorParameters, Sensors

CELLS = ("nmc", "lfp", "nimh")
TEMPERATURES_DEGC = (25.0, 0.0, 45.0)
SOCS = (0.5, 0.15, 0.85)
PERIODS_S = (0.1, 1.0, 10.0)
SHARES = (1.0, 0.1)  # of the cell's largest current
LEAST_A = 0.15
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
    families = sorted(name for name in find_families() if name != "drive_cycle")
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
            (low_A, high_A), (0.05, 0.95), kind.parameters.capacity_Ah, case.soc, duration_s, case.dt_s
        )
        held = find_families()[case.family].build(request, rng)
    return np.concatenate([np.zeros(10), held])


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


def play(case: Case) -> dict[str, Any]:
    """Play a case; its row."""
    kind = cell_type(case.cell)
    band = band_of(kind.parameters.capacity_Ah, kind.limits.voltage_V)
    watch, warned, last = Watch(), Counter[str](), None
    trip: Finding | None = None
    for last in samples(case, signal(case, DURATION_S[case.dt_s])):
        watch, finding = observe(watch, band, last, LEAST_A)
        if finding is not None and finding.stage == "trip":
            trip = finding
            break
        if finding is not None:
            warned[finding.code] += 1
    time_s = 0.0 if last is None else last.time_s
    return {
        "case": case.name,
        "hours": time_s / 3600.0,
        "trip": None if trip is None else f"{trip.code} at {time_s:g} s: {trip.text}",
        "warned": dict(warned),
    }


def main() -> int:
    """Play cases until so many hours have passed; the exit code says whether none has tripped."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rows", type=Path)
    options = parser.parse_args()
    kept: Path | None = options.rows
    known = {row["case"]: row for row in read_rows(kept)}
    rows, hours = list[dict[str, Any]](), 0.0
    for case in itertools.chain.from_iterable(map(cases, itertools.count(1))):
        if hours >= options.hours:
            break
        row = known.get(case.name) or play(case)
        if case.name not in known:
            add_row(kept, row)
        rows.append(row)
        hours += row["hours"]
        if row["trip"] or row["warned"]:
            print(json.dumps(row))  # noqa: T201
    tripped = sum(row["trip"] is not None for row in rows)
    warned = sum((Counter(row["warned"].keys()) for row in rows), Counter[str]())
    answer = {"cases": len(rows), "hours": round(hours, 1), "trips": tripped, "cases_with_warnings": dict(warned)}
    print(json.dumps(answer))  # noqa: T201
    return 1 if tripped else 0


if __name__ == "__main__":
    raise SystemExit(main())
