"""A sequence goes to the ends of the window that was asked for, or says what keeps it from there."""

from dataclasses import replace

import numpy as np
import pytest

from models.design.constraints.limits import InfeasibleError, Limits
from models.design.constraints.voltage_band import colder_words
from models.design.coverage import coverage_of
from models.design.design import Design, design
from models.design.optimise.block_design import DesignRequest
from tests.unit.models.design.networks import experiment

WINDOW = (0.1, 0.92)


def designed(**changes: object) -> Design:
    fields: dict[str, object] = {
        "limits": Limits((-6.0, 4.0), WINDOW, voltage_V=(3.0, 4.3)),
        "duration_s": 20_000.0,
        "soc_levels": (0.3, 0.5, 0.7),
        "n_starts": 1,
    }
    return design(experiment(), DesignRequest(**(fields | changes)))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def whole() -> Design:
    return designed()


def test_the_ends_of_the_window_and_of_the_current_are_visited(whole: Design) -> None:
    said = whole.coverage
    np.testing.assert_allclose(said.soc, WINDOW, atol=1e-3)
    assert said.current_A == pytest.approx((-6.0, 4.0)) and said.reasons == ()
    assert said.share > 0.7 and said.temperature_degC is None
    # The largest currents, at several levels.
    behind = [whole.current_A[block.last : block.last + 10] for block in whole.blocks]
    assert sum(after.min() < -5.99 or after.max() > 3.99 for after in behind) >= 4


def test_the_cell_rests_at_the_ends(whole: Design) -> None:
    for end in WINDOW:
        there = np.abs(whole.soc - end) < 1e-3
        assert (whole.current_A[there] == 0.0).sum() * whole.dt_s > 500.0


def test_a_voltage_that_forbids_an_end_is_named_with_what_is_missing() -> None:
    said = designed(limits=Limits((-6.0, 4.0), WINDOW, voltage_V=(3.1, 3.66))).coverage
    # At rest 3.3 V + 0.5 V times the state of charge.
    assert 0.6 < said.soc[1] < 0.72 and said.soc[0] == pytest.approx(0.1, abs=1e-3)
    assert said.soc_short[1] == pytest.approx(0.92 - said.soc[1])
    assert len(said.reasons) == 1 and "SoC 0.920 is not reached" in said.reasons[0] and "voltage_V" in said.reasons[0]


def test_a_duration_that_forbids_the_ends_is_named() -> None:
    said = designed(duration_s=6500.0).coverage
    assert any("duration" in reason for reason in said.reasons) and min(said.soc_short) > 0.05


def test_another_signal_says_where_it_does_not_go() -> None:
    said = designed(signal="aprbs", duration_s=2000.0).coverage
    assert "soc_levels" in said.reasons[0] and said.share < 0.5


def test_a_signal_that_the_voltage_cuts_says_so_and_what_to_do() -> None:
    limits, rest = Limits((-6.0, 4.0), WINDOW, voltage_V=(3.0, 4.3)), np.full(9, 0.5)
    doubt = colder_words(replace(experiment(), coldest_degC=-10.0, temperature_degC=10.0))
    said = coverage_of(limits, rest, np.zeros(9), 1.0, meant_soc=(0.1, 0.5), colder=doubt)
    assert (
        "limit voltage_V" in said.reasons[0] and "state ambient_degC" in said.reasons[0] and "-10.0" in said.reasons[0]
    )
    assert "soc_levels" in said.reasons[1] and "ambient" not in said.reasons[1]
    assert colder_words(replace(experiment(), coldest_degC=24.5)) == colder_words(experiment()) == ""


def test_a_way_that_the_voltage_slows_down_is_named_with_the_unknown_ambient() -> None:
    cold = replace(experiment(), coldest_degC=-10.0)
    asked = DesignRequest(Limits((-6.0, 4.0), WINDOW, voltage_V=(3.0, 4.3)), 2000.0, soc_levels=(0.3, 0.5, 0.7))
    with pytest.raises(InfeasibleError, match="give more time.* limit voltage_V, or state ambient_degC.* -10.0 degC"):
        design(cold, asked)


def test_shares_are_counted_in_cells() -> None:
    limits = Limits((-7.0, 7.0), (0.0, 0.8), temperature_degC=(0.0, 50.0))
    soc, current = np.repeat([0.05, 0.75], 20), np.tile([-6.0, 6.0], 20)
    said = coverage_of(limits, soc, current, 1.0, temperature_degC=np.array([20.0, 29.5]))
    assert said.share == 4 / 56
    assert said.temperature_share == pytest.approx(10.5 / 50.0)
    assert coverage_of(limits, soc[:9], current[:9], 1.0).share == 0.0
    assert said.to_json()["soc_short"] == pytest.approx([0.05, 0.05])
