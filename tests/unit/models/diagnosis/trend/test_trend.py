from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.diagnosis.trend.life import Trend
from models.diagnosis.trend.trend import trend
from tests.unit.models.diagnosis.cells import simple_network
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

FRESH_OHM = 0.02
# Share of the capacity that is lost, and by which the resistance grows, in a cycle.
LOST, GROWN = 0.01, 0.02
CYCLES = (0, 1, 5, 10, 20)


def cycle(number: int, capacity_lost: float = LOST, grown: float = GROWN) -> TimeSeries:
    """Pulses on a slow swing through the state of charge, in one cycle of a cell's life."""
    n = 4000
    swing = 0.5 * CAPACITY_AH * np.sin(2.0 * np.pi * np.arange(n) / n)
    current_A = steps_A(n, 50 + number, largest_A=4.0) + swing
    more_V = grown * number * FRESH_OHM * current_A
    run = true_run(
        current_A,
        capacity_Ah=CAPACITY_AH * (1.0 - capacity_lost * number),
        added_V=more_V,
        noise_V=5e-4,
        seed=50 + number,
    )
    return TimeSeries(
        run.time_s, run.current_A, run.voltage_V, run.temperature_degC, run.ambient_degC, name=f"cycle {number}"
    )


def followed(runs: list[TimeSeries]) -> Trend:
    return trend(simple_network(CAPACITY_AH), runs, [SOC] * len(runs), memory=known_runs())


@pytest.fixture(scope="module")
def life() -> Trend:
    return followed([cycle(number) for number in CYCLES])


def test_capacity_and_resistance_are_told_with_their_uncertainty(life: Trend) -> None:
    for number, each in zip(CYCLES, life.runs, strict=True):
        truth_Ah = CAPACITY_AH * (1.0 - LOST * number)
        assert each.state.capacity_Ah == pytest.approx(truth_Ah, rel=0.05)
        assert abs(each.state.capacity_Ah - truth_Ah) < 2.0 * each.state.capacity_std_Ah
        middle = int(np.argmin(each.state.resistance_std_Ohm))
        truth_Ohm = FRESH_OHM * (1.0 + GROWN * number)
        assert each.state.resistance_Ohm[middle] == pytest.approx(truth_Ohm, rel=0.05)
        assert abs(each.state.resistance_Ohm[middle] - truth_Ohm) < 4.0 * each.state.resistance_std_Ohm[middle]


def test_what_nobody_has_seen_is_less_certain(life: Trend) -> None:
    """The swing of this one goes beyond what the cell is known for."""
    state = life.runs[-1].state
    assert state.resistance_std_Ohm.max() > 2.0 * state.resistance_std_Ohm.min()


def test_a_new_cell_says_nothing_and_an_old_one_what_has_changed(life: Trend) -> None:
    verdicts = [each.diagnosis.verdict for each in life.runs]
    assert verdicts[:2] == ["nothing_missing", "nothing_missing"]
    assert [each.diagnosis.findings for each in life.runs[:2]] == [(), ()]
    assert "nothing_missing" not in verdicts[3:]
    assert "capacity" in {each.effect for each in life.runs[-1].diagnosis.findings}


def test_the_answer_has_every_field_of_the_contract(life: Trend) -> None:
    answer = life.to_json()
    assert [each["run"] for each in answer["runs"]] == [f"cycle {number}" for number in CYCLES]
    for each in answer["runs"]:
        assert set(each) >= {"run", "capacity_Ah", "resistance", "verdict", "findings"}
        assert set(each["capacity_Ah"]) == {"value", "std"}
        assert all(set(told) == {"soc", "value_Ohm", "std_Ohm"} for told in each["resistance"])


def test_a_run_out_of_reach_is_named() -> None:
    with pytest.raises(ModelError, match="cycle 0"):
        trend(simple_network(CAPACITY_AH), [cycle(0)], [3.0], memory=known_runs())
    with pytest.raises(ModelError, match="no run"):
        followed([])


def test_a_gap_in_a_run_is_no_news() -> None:
    run = cycle(0)
    lost = np.where((run.time_s > 1000.0) & (run.time_s < 1500.0), np.nan, run.voltage_V)
    assert followed([replace(run, voltage_V=lost)]).runs[0].diagnosis.verdict == "nothing_missing"


def test_a_record_given_twice_does_not_bear_itself_out() -> None:
    once = cycle(10)
    with pytest.raises(ModelError, match=r"run 3 \(again\) is the same record as run 2 \(cycle 10\).*leave one"):
        followed([cycle(0), once, replace(once, name="again")])


def test_a_run_without_current_is_refused_with_what_it_lacks() -> None:
    run = cycle(0)
    idle = replace(run, current_A=np.full(len(run), 0.002), name="idle")
    with pytest.raises(
        ModelError, match=r"idle: its current stays at or below 0\.002 A, at least 0\.0\d+ A.*leave it out"
    ):
        followed([run, idle])


def test_a_run_of_five_samples_is_refused_as_short() -> None:
    run = cycle(0)
    short = replace(run, **{name: getattr(run, name)[:5] for name in ("time_s", "current_A", "voltage_V")},
                    temperature_degC=run.temperature_degC[:5], ambient_degC=None, name="short")  # fmt: skip
    with pytest.raises(ModelError, match=r"short: 5 samples .* in 5 s, at least 30 are needed; leave it out"):
        followed([short])
