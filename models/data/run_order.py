"""One order of runs, whatever order they were named in, and records that were given twice.

Which samples are held out together, and with that what a fit chooses and a diagnosis believes, goes by the place of a
run among the others. A command that lists files by name and a page that lists them by date must get the same answer.
"""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray, TimeSeries


def run_order(runs: list[TimeSeries]) -> list[int]:
    """Return the places of runs in the order that their content gives: by temperature, load, length and voltage.

    Runs of the same content, which may be told apart by name only, stay as they were given.
    """
    return sorted(range(len(runs)), key=lambda place: _content(runs[place]))


def in_order(runs: list[TimeSeries], soc: list[float]) -> tuple[list[TimeSeries], list[float]]:
    """Return runs and their states of charge at the start in the order of `run_order`."""
    order = run_order(runs)
    return [runs[k] for k in order], [soc[k] for k in order]


def same_record(one: TimeSeries, other: TimeSeries) -> bool:
    """Whether two runs hold the same samples, whatever they are called."""
    return all(
        np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
        for name in ("time_s", "current_A", "voltage_V")
    )


def check_no_repeat(runs: list[TimeSeries], taker: str) -> None:
    """Refuse a record that stands twice: it would count as two runs that bear each other out.

    Raises
    ------
    ModelError
        It says which runs they are, and that `taker`, such as "a series", takes each once.
    """
    if (found := first_repeat(runs)) is not None:
        again, first = found
        raise ModelError(
            f"run {again + 1} ({runs[again].name}) is the same record as run {first + 1} ({runs[first].name}): "
            f"{taker} takes each record once; leave one of them out"
        )


def first_repeat(runs: list[TimeSeries]) -> tuple[int, int] | None:
    """Places of the first run that is the same record as one before it, and of that one; None: there is none."""
    before: dict[int, list[int]] = {}
    for k, run in enumerate(runs):
        alike = before.setdefault(hash(run.voltage_V.tobytes()), [])
        for j in alike:
            if same_record(runs[j], run):
                return k, j
        alike.append(k)
    return None


def _content(run: TimeSeries) -> tuple[float, ...]:
    return (_mean(run.temperature_degC), _mean(np.abs(run.current_A)), float(len(run)), _mean(run.voltage_V))


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else 0.0
