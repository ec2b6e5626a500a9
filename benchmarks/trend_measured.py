"""A cell's life as `trend` tells it, of measured cells that aged, beside what their records tell without a model.

``python benchmarks/trend_measured.py --data FOLDER [--cells A,B0029,...] [--structure auto] [--json]``

FOLDER holds `samsung30q` and `nasa`, each with `meta.json`. A model of each cell is made from the first two charges
that begin empty and the first two discharges; all other records are followed as one series. Counted charge is the truth
of the capacity, the step of the first second that of the resistance at the state of charge where the record begins.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

from bench_service.exchange.read import read_run
from models.data.timeseries import TimeSeries
from models.diagnosis.trend.life import Places, RunTrend
from models.diagnosis.trend.trend import trend
from models.pipeline.fit import fit_network

Row = dict[str, Any]
FOLDERS = ("samsung30q", "nasa")
_FRESH = 2
# A first charge holds less than this part of a full one where the cell came half charged.
_WHOLE = 0.9


@dataclass(frozen=True)
class Aged:
    """One record.

    Attributes
    ----------
    run : samples
    at : cycle or number of the record
    begins : state of charge
    counted_Ah : of the whole record, where it is a full charge or discharge
    step_Ohm : resistance of the first second, where it was logged
    """

    run: TimeSeries
    at: int
    begins: float
    counted_Ah: float | None
    step_Ohm: float | None


def lives(data: Path) -> dict[str, list[Aged]]:
    """Records of each cell in the order of its life."""
    out: dict[str, list[Aged]] = {}
    for folder in FOLDERS:
        meta = json.loads((data / folder / "meta.json").read_text())
        by_cell: dict[str, list[tuple[str, Row]]] = {}
        for name, each in meta.items():
            by_cell.setdefault(each.get("cell") or each["battery"], []).append((name, each))
        for cell, files in by_cell.items():
            full_Ah = max(abs(each["Ah"]) for _, each in files)
            out[cell] = [_aged(data / folder / name, each, full_Ah) for name, each in files]
            out[cell].sort(key=lambda each: each.at)
    return out


def _aged(path: Path, meta: Row, full_Ah: float) -> Aged:
    charge = meta["segment"] == "charge"
    at = meta.get("cycle") or meta["record"]
    counted_Ah = abs(meta["Ah"])
    partly = charge and counted_Ah < _WHOLE * full_Ah and at <= _FRESH**2
    begins = 0.0 if charge else 1.0
    step_Ohm = meta.get("step_resistance_first_second_ohm")
    if partly:
        return Aged(read_run(path), at, 1.0 - counted_Ah / full_Ah, None, step_Ohm)
    return Aged(read_run(path), at, begins, counted_Ah, step_Ohm)


def follow(records: list[Aged], structure: str) -> list[Row]:
    """What is said of each record, beside the truth."""
    fresh = [
        k for begins in (0.0, 1.0) for k in [k for k, each in enumerate(records) if each.begins == begins][:_FRESH]
    ]
    train = [records[k] for k in fresh]
    judged = [each for k, each in enumerate(records) if k not in fresh]
    capacity_Ah = float(np.mean([each.counted_Ah for each in train if each.counted_Ah]))
    soc = [each.begins for each in train]
    runs = [each.run for each in train]
    network = fit_network(runs, capacity_Ah=capacity_Ah, initial_soc=soc, structure=structure).network
    found = trend(
        network,
        [each.run for each in judged],
        [each.begins for each in judged],
        train=runs,
        train_soc=soc,
        places=Places([float(each.at) for each in judged], "cycle"),
    )
    return [_row(each, told) for each, told in zip(judged, found.runs, strict=True)]


def _row(record: Aged, told: RunTrend) -> Row:
    state, diagnosis = told.state, told.diagnosis
    place = int(np.argmin(np.abs(state.soc - record.begins)))
    ohm = float(state.resistance_Ohm[place])
    return {
        "run": record.run.name,
        "at": record.at,
        "capacity_off": state.capacity_Ah / record.counted_Ah - 1.0 if record.counted_Ah else None,
        "resistance_off": ohm / record.step_Ohm - 1.0 if record.step_Ohm else None,
        "verdict": diagnosis.verdict,
        "named": [f"{each.effect} {each.evidence.get('where', '')}".strip() for each in diagnosis.findings],
        "values": [{name: value.value for name, value in each.parameters.items()} for each in diagnosis.findings],
        "error_mV": told.error_mV,
        "unexplained_mV": diagnosis.unexplained_mV,
    }


def _show(cell: str, rows: list[Row]) -> None:
    table = Table("run", "capacity off / %", "resistance off / %", "named", "error / mV", "left / mV", title=cell)
    for row in rows:
        off = [None if row[name] is None else 100.0 * row[name] for name in ("capacity_off", "resistance_off")]
        numbers = ["-" if each is None else f"{each:+.1f}" for each in off]
        errors = (f"{row['error_mV']:.0f}", f"{row['unexplained_mV']:.0f}")
        table.add_row(row["run"], *numbers, ", ".join(row["named"]) or row["verdict"], *errors)
    Console().print(table)


def main() -> int:
    """Run it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with samsung30q and nasa")
    parser.add_argument("--cells", help="default: all")
    parser.add_argument("--structure", default="auto")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    options = parser.parse_args()
    every = lives(options.data)
    wanted = options.cells.split(",") if options.cells else list(every)
    if missing := set(wanted) - set(every):
        parser.error(f"{options.data}: no cell {', '.join(sorted(missing))}; there are {', '.join(every)}")
    out = {}
    with threadpool_limits(1):
        for cell in wanted:
            out[cell] = follow(every[cell], options.structure)
            if not options.json:
                _show(cell, out[cell])
            print(cell, len(out[cell]), file=sys.stderr, flush=True)
    if options.json:
        print(json.dumps(out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
