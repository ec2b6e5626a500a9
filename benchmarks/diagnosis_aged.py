"""Change mode on measured cells that aged: what is told of a later pair of files beside the counted charge.

``python benchmarks/diagnosis_aged.py --data FOLDER [--cells A,B0029,...] [--structure bounded] [--json]``

FOLDER holds `samsung30q` and `nasa`, each with `meta.json`. A model is made from the charge and the discharge of one
cycle (whole ones: a charge that begins empty); those of another are held against it. Counted is the charge of the later
discharge. Neighbouring cycles show nothing that a person would call a change. Last, the loaded part of a neighbour's
discharge of `nasa` with the voltage at the load, `voltage_source_V`: the fixture is a series resistance, known from the
two voltages.
"""

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.pipeline.fit import fit_network

sys.path.insert(0, str(Path(__file__).parent))
from trend_measured import Aged, lives

Row = dict[str, Any]
# Cycles, or the records of them, that lie within these of each other are neighbours.
_NEAR = 4
_BAR = 0.02
# Of the largest current, and V at the load, where a discharge is loaded.
_LOADED, _LEAST_V = 0.9, 0.5


def cycles(records: list[Aged]) -> list[tuple[Aged, Aged]]:
    """A whole charge and the discharge that follows it, in the order of a cell's life."""
    every = []
    for charge in records:
        if charge.begins != 0.0 or charge.counted_Ah is None:
            continue
        after = [each for each in records if each.begins == 1.0 and 0 <= each.at - charge.at <= 2]
        if after:
            every.append((charge, after[0]))
    return every


def pairs(records: list[Aged]) -> Iterator[tuple[tuple[Aged, Aged], tuple[Aged, Aged], bool]]:
    """Cycles that follow each other, and whether they are neighbours; of neighbours the first stands for both."""
    every = cycles(records)
    for one, other in pairwise(every):
        if other[0].at - one[0].at <= _NEAR:
            yield one, other, True
    first = [every[0], *(other for one, other in pairwise(every) if other[0].at - one[0].at > _NEAR)]
    for one, other in pairwise(first):
        yield one, other, False
    if len(first) > 2:
        yield first[0], first[-1], False


def judge(cell: str, before: tuple[Aged, Aged], after: tuple[Aged, Aged], near: bool, structure: str) -> Row:
    """Diagnose one pair of cycles."""
    train, soc = [each.run for each in before], [each.begins for each in before]
    known_Ah, counted_Ah = before[1].counted_Ah, after[1].counted_Ah
    assert known_Ah is not None
    assert counted_Ah is not None
    network = fit_network(train, capacity_Ah=known_Ah, initial_soc=soc, structure=structure).network
    runs, starts = [each.run for each in after], [each.begins for each in after]
    told = diagnose(network, runs, starts, train=train, train_soc=soc, mode="change")
    first = told.findings[0] if told.findings and told.verdict in ("missing", "ambiguous") else None
    values = {each.effect: each.parameters for each in told.findings}
    # Lost lithium and lost material say what capacity is left, too.
    capacity = next((own["capacity_Ah"].value for own in values.values() if "capacity_Ah" in own), None)
    return {
        "cell": cell,
        "before": before[0].at,
        "after": after[0].at,
        "near": near,
        "lost": counted_Ah / known_Ah - 1.0,
        "verdict": told.verdict,
        "named": [(each.effect, round(each.confidence, 3)) for each in told.findings],
        "rivals": [] if first is None else list(first.confounded_with),
        "values": {one: {name: each.value for name, each in own.items()} for one, own in values.items()},
        "capacity_off": None if capacity is None else capacity / counted_Ah - 1.0,
        "evidence": {each.effect: each.evidence.get("log_likelihood_over_nothing") for each in told.findings},
        "seconds": told.seconds,
    }


def at_the_load(folder: Path, run: TimeSeries) -> tuple[TimeSeries, float]:
    """A discharge by the voltage at the load where it is one, and the resistance between the two voltages in Ohm."""
    columns = pd.read_csv(folder / f"{run.name.removesuffix('.csv.gz')}.csv.gz")
    loaded = (np.abs(run.current_A) > _LOADED * np.abs(run.current_A).max()) & (columns["voltage_source_V"] > _LEAST_V)
    fixture_V = run.voltage_V - columns["voltage_source_V"].to_numpy()
    resistance_Ohm = float(np.median(-fixture_V[loaded] / run.current_A[loaded]))
    return replace(run, voltage_V=np.where(loaded, run.voltage_V - fixture_V, np.nan)), resistance_Ohm


def judge_fixture(folder: Path, cell: str, before: tuple[Aged, Aged], after: Aged, structure: str) -> Row:
    """Diagnose a discharge by the voltage at the load."""
    train, soc = [each.run for each in before], [each.begins for each in before]
    known_Ah = before[1].counted_Ah
    assert known_Ah is not None
    network = fit_network(train, capacity_Ah=known_Ah, initial_soc=soc, structure=structure).network
    run, fixture_Ohm = at_the_load(folder, after.run)
    told = diagnose(network, [run], [after.begins], train=train, train_soc=soc, mode="change")
    values = {each.effect: each.parameters for each in told.findings}
    found = values["series_resistance"]["resistance_Ohm"].value if "series_resistance" in values else None
    return {
        "cell": cell,
        "at": after.at,
        "fixture_Ohm": fixture_Ohm,
        "verdict": told.verdict,
        "named": [(each.effect, round(each.confidence, 3)) for each in told.findings],
        "off": None if found is None else found / fixture_Ohm - 1.0,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--cells", default="")
    parser.add_argument("--structure", default="bounded")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    wanted, rows = given.cells.split(",") if given.cells else None, []
    fixtures: list[Row] = []
    with threadpool_limits(1, user_api="blas"):
        for cell, records in lives(given.data).items():
            if wanted and cell not in wanted:
                continue
            for before, after, near in pairs(records):
                rows.append(judge(cell, before, after, near, given.structure))
                if given.json:
                    print(json.dumps(rows[-1]), flush=True)
                if near and cell.startswith("B00"):
                    fixtures.append(judge_fixture(given.data / "nasa", cell, before, after[1], given.structure))
                    print(json.dumps(fixtures[-1]), flush=True)
    if not given.json:
        _print(rows)
    return 0


def _print(rows: list[Row]) -> None:
    table = Table("cell", "cycles", "counted", "verdict", "named", "capacity off")
    for row in rows:
        off = row["capacity_off"]
        named = ", ".join(f"{effect} {sure:.2f}" for effect, sure in row["named"])
        told = "-" if off is None else f"{100 * off:+.1f} %"
        counted = "neighbour" if row["near"] else f"{100 * row['lost']:+.1f} %"
        table.add_row(row["cell"], f"{row['before']} to {row['after']}", counted, row["verdict"], named, told)
    Console().print(table)
    near = [row for row in rows if row["near"]]
    aged = [row for row in rows if not row["near"]]
    claims = sum(row["verdict"] != "nothing_missing" for row in near)
    first = sum(bool(row["named"]) and row["named"][0][0] == "capacity" for row in aged)
    exact = sum(row["capacity_off"] is not None and abs(row["capacity_off"]) <= _BAR for row in aged)
    print(f"claims between neighbours: {claims} of {len(near)}")
    print(f"capacity first in {first}, within 2 % in {exact}, of {len(aged)} that aged")


if __name__ == "__main__":
    sys.exit(main())
