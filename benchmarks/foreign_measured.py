"""Measured records with a fault computed into a real log, and pairs of an electrochemical simulator's records.

Used by `diagnosis_foreign.py`. Of a measured cell, training and judged runs are of one block of temperature; a fault is
what a contact, a wrong sensor, a late clock or a wrong statement would have made of the log.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from diagnosis_pybamm import RIGHT
from foreign_cells import contact_is_bad

from bench_service.exchange.read import read_run_file
from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries

# Of the Panasonic drive cycles: folder, capacity, training and judged runs of each block.
_PANASONIC, _CAPACITY_AH = "panasonic_18650pf", 2.968
_BLOCKS = ("25degC", "10degC", "0degC")
_COLDEST = "m10degC"
_MOST_S = 9000.0


@dataclass(frozen=True)
class Fault:
    """A fault in a log.

    Attributes
    ----------
    truth : name in the contract
    size : true value of its first parameter; None where that is not known
    put_in : log and stated state of charge -> the same with the fault
    """

    truth: str
    size: float | None
    put_in: Callable[[TimeSeries, float], tuple[TimeSeries, float]]


def _volts(run: TimeSeries, by: np.ndarray) -> TimeSeries:
    return replace(run, voltage_V=run.voltage_V + by)


def _late(run: TimeSeries, delay_s: float) -> TimeSeries:
    return replace(run, voltage_V=np.interp(run.time_s - delay_s, run.time_s, run.voltage_V))


def _contact(run: TimeSeries, ohm: float) -> TimeSeries:
    return _volts(run, ohm * run.current_A * contact_is_bad(run.time_s - run.time_s[0], float(len(run))))


FAULTS = (
    Fault("series_resistance", 0.005, lambda run, soc: (_volts(run, 0.005 * run.current_A), soc)),
    Fault("series_resistance", 0.010, lambda run, soc: (_volts(run, 0.010 * run.current_A), soc)),
    Fault("voltage_offset", 0.010, lambda run, soc: (_volts(run, np.full(len(run), 0.010)), soc)),
    Fault("voltage_offset", -0.010, lambda run, soc: (_volts(run, np.full(len(run), -0.010)), soc)),
    Fault("current_gain", 0.02, lambda run, soc: (replace(run, current_A=1.02 * run.current_A), soc)),
    Fault("current_offset", 0.03, lambda run, soc: (replace(run, current_A=run.current_A + 0.03), soc)),
    Fault("initial_soc", None, lambda run, soc: (run, soc - 0.03)),
    Fault("dead_time", 2.0, lambda run, soc: (_late(run, 2.0), soc)),
)

# Further ones, put in only where they are asked for.
ASKED_FAULTS = (
    *(
        Fault("intermittent_contact", ohm, lambda run, soc, ohm=ohm: (_contact(run, ohm), soc))
        for ohm in (0.005, 0.01, 0.02)
    ),
    *(
        Fault("voltage_gain", by, lambda run, soc, by=by: (_volts(run, by * run.voltage_V), soc))
        for by in (0.003, -0.003, 0.006)
    ),
    Fault("current_gain", 0.06, lambda run, soc: (replace(run, current_A=1.06 * run.current_A), soc)),
)


# Small ones of a fixed size, put into each log that is left out in turn.
SMALL_FAULTS = (
    Fault("voltage_offset", 0.005, lambda run, soc: (_volts(run, np.full(len(run), 0.005)), soc)),
    Fault("series_resistance", 0.005, lambda run, soc: (_volts(run, 0.005 * run.current_A), soc)),
    Fault("current_gain", 0.02, lambda run, soc: (replace(run, current_A=1.02 * run.current_A), soc)),
    Fault("current_offset", 0.03, lambda run, soc: (replace(run, current_A=run.current_A + 0.03), soc)),
    Fault("initial_soc", None, lambda run, soc: (run, soc - 0.03)),
)


@dataclass(frozen=True)
class Records:
    """Runs to learn from, and runs to judge with their truth (None: nothing has changed).

    Attributes
    ----------
    name : of the base
    capacity_Ah : of the cell
    train : runs to learn from; each starts where its first `soc_ref` says
    nulls, cases : (truth, size, log, stated state of charge)
    """

    name: str
    capacity_Ah: float
    train: list[TimeSeries]
    nulls: list[TimeSeries]
    cases: list[tuple[str, float | None, TimeSeries, float]]


def measured_records(data: Path, asked: tuple[str, ...] = ()) -> list[Records]:
    """Drive cycles of the Panasonic cell, each block of temperature for itself; each judged run has two faults.

    Parameters
    ----------
    asked : faults that are put in, of the usual ones and of `ASKED_FAULTS`; none: the usual ones
    """
    faults = [each for each in (*FAULTS, *ASKED_FAULTS) if each.truth in asked] if asked else FAULTS
    folder, found, fault = data / _PANASONIC, [], 0
    for block in _BLOCKS:
        runs = {path.name: _cut(path) for path in sorted(folder.glob(f"drive_{block}_*.csv.gz"))}
        train = [run for name, run in runs.items() if "Cycle" in name]
        nulls = [run for name, run in runs.items() if "Cycle" not in name]
        cases = []
        for run in nulls:
            for _ in range(2):
                one = faults[fault % len(faults)]
                cases.append((one.truth, _size(one, run), *one.put_in(run, start_soc(run))))
                fault += 1
        found.append(Records(f"{_PANASONIC} {block}", _CAPACITY_AH, train, nulls, cases))
    return found


def left_out_records(data: Path) -> list[Records]:
    """Panasonic drive cycles, block by block: each run that a model did not see, without and with each small fault.

    The four mixed cycles of a block are trained on, and judge the others; then three of them are, and judge the fourth.
    """
    found = []
    for block in (*_BLOCKS, _COLDEST):
        runs = {path.name: _cut(path) for path in sorted((data / _PANASONIC).glob(f"drive_{block}_*.csv.gz"))}
        cycles = [name for name in runs if "Cycle" in name]
        splits = [(cycles, [name for name in runs if name not in cycles])]
        splits += [([name for name in cycles if name != out], [out]) for out in cycles]
        for number, (train, judged) in enumerate(splits):
            logs = [runs[name] for name in judged]
            found.append(
                Records(
                    f"{_PANASONIC} {block} left out {number}",
                    _CAPACITY_AH,
                    [runs[name] for name in train],
                    logs,
                    [
                        (fault.truth, _size(fault, run), *fault.put_in(run, start_soc(run)))
                        for run in logs
                        for fault in SMALL_FAULTS
                    ],
                )
            )
    return found


def _size(fault: Fault, run: TimeSeries) -> float | None:
    return start_soc(run) if fault.truth == "initial_soc" else fault.size


def _cut(path: Path) -> TimeSeries:
    run = read_run_file(path, None).series
    kept = run.time_s <= run.time_s[0] + _MOST_S
    columns = {
        name: None if getattr(run, name) is None else getattr(run, name)[kept]
        for name in ("time_s", "current_A", "voltage_V", "temperature_degC", "soc_ref")
    }
    # The chamber's column is mostly empty and reads 0 in part of it.
    return TimeSeries(**columns, name=run.name)  # pyright: ignore[reportArgumentType]


def pybamm_records(data: Path) -> list[Records]:
    """The pairs: the same cell without and with one effect."""
    found = []
    for folder in sorted(path for path in (data / "pybamm").iterdir() if (path / "meta.json").exists()):
        meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))
        runs = {path.name.split(".")[0]: read_run_file(path, None).series for path in sorted(folder.glob("*.csv*"))}
        train = [run for name, run in runs.items() if name.startswith("base_ident")]
        nulls = [run for name, run in runs.items() if name.startswith("base_valid")]
        hidden = [run for name, run in runs.items() if name.startswith("hidden_valid")]
        cases: list[tuple[str, float | None, TimeSeries, float]] = []
        if folder.name != "null":
            cases = [("|".join(sorted(RIGHT[folder.name])), None, run, start_soc(run)) for run in hidden]
        found.append(
            Records(f"pybamm {folder.name}", meta["capacity_Ah"], train, nulls + (hidden if not cases else []), cases)
        )
    return found
