"""Logs as nobody wishes them end in an answer or in one line that says what to do, never in a raw exception."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.diagnosis.evidence.evidence import Evidence
from models.pipeline.addition import add_effect
from models.pipeline.fit import fit_network
from simulators.cell import Cell
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import CELL, fitted, run
from tests.unit.models.simulated_cells import record

Log = Callable[[], TimeSeries]


def rows(chosen: np.ndarray | slice, one: TimeSeries | None = None) -> TimeSeries:
    one = run(6) if one is None else one
    columns = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
    return replace(one, **{name: getattr(one, name)[chosen] for name in columns})


@cache
def base() -> TimeSeries:
    """Pulses, then rest; so short that a diagnosis looks at each sample, which costs a cube of their number."""
    return rows(slice(2500, 2900))


@cache
def judged() -> TimeSeries:
    return rows(slice(2500, 2900), run(9))


def spiked(column: str, size: float) -> TimeSeries:
    values = getattr(base(), column).copy()
    values[[17, 100, 101, 200, 333]] += size
    return replace(base(), **{column: values})


def missing(column: str, chosen: slice) -> TimeSeries:
    values = getattr(base(), column).copy()
    values[chosen] = np.nan
    return replace(base(), **{column: values})


def rounded(volts: float, amperes: float) -> TimeSeries:
    one = base()
    return replace(
        one, voltage_V=volts * np.round(one.voltage_V / volts), current_A=amperes * np.round(one.current_A / amperes)
    )


def cc_cv() -> TimeSeries:
    k = np.arange(4000)
    current = 0.5 * CELL.capacity_Ah * np.where(k < 2000, 1.0, np.exp(-(k - 2000) / 900.0))
    return record(Cell(CELL, 0.45, 25.0), current, 3)


LOGS: dict[str, Log] = {
    "two samples": lambda: rows(slice(0, 2)),
    "thirty samples": lambda: rows(slice(0, 30)),
    "200 samples": lambda: rows(slice(500, 700)),
    "rest only": lambda: replace(base(), current_A=np.zeros(len(base()))),
    "flat": lambda: replace(base(), voltage_V=np.full(len(base()), 3.7)),
    "one direction": lambda: record(Cell(CELL, 0.8, 25.0), np.full(3000, -0.4 * CELL.capacity_Ah), 3),
    "CC-CV": cc_cv,
    "outliers of the voltage": lambda: spiked("voltage_V", 4.0),
    "outliers of the current": lambda: spiked("current_A", 500.0),
    "outliers of the temperature": lambda: spiked("temperature_degC", 150.0),
    "no temperature": lambda: missing("temperature_degC", slice(None)),
    "no voltage": lambda: missing("voltage_V", slice(None)),
    "one voltage": lambda: missing("voltage_V", slice(1, None)),
    "steps missing": lambda: rows(np.r_[0:500, 1500:2000, 2600:3000]),
    "coarse converter": lambda: rounded(0.05, 0.5),
    "every 60 s": lambda: rows(slice(None, None, 60)),
    "tiny currents": lambda: replace(base(), current_A=1e-6 * base().current_A),
    "wrong unit": lambda: replace(base(), current_A=1e3 * base().current_A),
}

# Where a diagnosis takes longest: one more kind of what the others show.
_LONG = {
    "CC-CV",
    "one direction",
    "outliers of the temperature",
    "outliers of the voltage",
    "coarse converter",
    "steps missing",
    "tiny currents",
    "two samples",
}


def ends_well(what: Callable[[], object]) -> None:
    try:
        what()
    except ModelError as error:
        text = str(error)
        assert "\n" not in text and 20 < len(text) < 400


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.proof) if name in _LONG else name for name in LOGS]
)
def test_a_change_in_an_odd_log(name: str) -> None:
    log = LOGS[name]()
    ends_well(lambda: diagnose(fitted().network, [log], [SOC]))
    ends_well(lambda: diagnose(fitted().network, [judged()], [SOC], train=[log], train_soc=[SOC]))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.proof) if name in _LONG else name for name in LOGS]
)
def test_a_structure_against_an_odd_log(name: str) -> None:
    log, bare = LOGS[name](), fitted(without=("hysteresis",)).network
    ends_well(lambda: diagnose(bare, [log], [SOC], mode="structure"))


@pytest.mark.parametrize(
    "name",
    [
        "rest only",
        "one voltage",
        pytest.param("CC-CV", marks=pytest.mark.proof),
        pytest.param("outliers of the current", marks=pytest.mark.proof),
        "every 60 s",
    ],
)
def test_an_effect_added_from_an_odd_log(name: str) -> None:
    log = LOGS[name]()
    ends_well(lambda: add_effect(fitted().network, "hysteresis", [log], [SOC], [run(9)], [SOC]))


def test_a_fit_beside_a_log_without_a_voltage() -> None:
    log = LOGS["no voltage"]()
    ends_well(
        lambda: fit_network([log, run(2)], capacity_Ah=CELL.capacity_Ah, structure="bounded", initial_soc=[SOC, SOC])
    )


def test_numbers_far_apart_are_factored_or_said() -> None:
    rng = np.random.default_rng(0)
    narrow = rng.standard_normal((300, 2))
    x = np.hstack([narrow, narrow @ np.array([[1e8], [-1e8]])])
    y, blocks = rng.standard_normal(300), np.arange(300) // 10
    assert np.isfinite(Evidence(y, x, np.zeros((3, 3)), blocks).cost)
    with pytest.raises(ModelError, match="outliers"):
        _ = Evidence(y, np.where(x > 1e8, np.nan, x), np.zeros((3, 3)), blocks).cost
