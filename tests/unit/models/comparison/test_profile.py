"""Mean errors over one variable, apart for the direction of the last current."""

from dataclasses import replace

import numpy as np
import pytest

from models.comparison.profile import error_profiles
from tests.unit.models.comparison.hand_samples import samples


def profile(found: list[dict], variable: str) -> dict:
    return next(each for each in found if each["variable"] == variable)


def test_hysteresis_is_two_lines_apart() -> None:
    direction = np.tile([1.0, -1.0], 1000)
    soc = np.linspace(0.0, 1.0, 2000)
    found = profile(
        error_profiles(replace(samples(2000), soc=soc, direction=direction, error_V=5e-3 * direction)), "soc"
    )
    assert found["quantity"] == "error_mV" and found["unit"] == "1"
    np.testing.assert_allclose(found["after_charge"], 5.0)
    np.testing.assert_allclose(found["after_discharge"], -5.0)
    # Twenty bins of a twentieth each.
    np.testing.assert_allclose(found["at"], np.arange(0.025, 1.0, 0.05))


def test_a_bin_of_seven_samples_says_nothing_and_one_of_eight_does() -> None:
    soc = np.concatenate([np.zeros(100), np.ones(100)])
    for count, known in ((7, False), (8, True)):
        direction = np.full(200, -1.0)
        direction[:count] = 1.0
        found = profile(error_profiles(replace(samples(200), soc=soc, direction=direction)), "soc")
        assert np.isfinite(found["after_charge"][0]) == known
        assert np.isnan(found["after_discharge"][1:-1]).all()


def test_the_open_circuit_curve_is_looked_at_at_rest_alone() -> None:
    c_rate = np.tile([0.0, -1.0], 1000)
    error_V = np.where(c_rate == 0.0, 1e-3, 9e-3)
    moving = replace(samples(2000), soc=np.linspace(0.0, 1.0, 2000), c_rate=c_rate, error_V=error_V)
    found = error_profiles(moving)
    np.testing.assert_allclose(profile(found, "soc_at_rest")["after_discharge"], 1.0)
    np.testing.assert_allclose(profile(found, "soc")["after_discharge"], 5.0, rtol=0.1)
    # And the current where there is one: here a single one, which has no profile.
    assert not any(each["variable"] == "current_A" for each in found)


def test_a_temperature_shows_as_a_resistance_under_load() -> None:
    n = 4000
    degC, c_rate = np.linspace(10.0, 30.0, n), np.tile([-1.0, 0.0, -0.1, 0.5], n // 4)
    current_A = 2.0 * c_rate
    direction = np.where(c_rate > 0.2, 1.0, -1.0)
    found = error_profiles(
        replace(
            samples(n),
            temperature_degC=degC,
            c_rate=c_rate,
            direction=direction,
            error_V=1e-3 * (degC - 20) * current_A,
        )
    )
    warm = profile(found, "temperature_degC")
    assert warm["quantity"] == "resistance_mOhm"
    np.testing.assert_allclose(warm["after_discharge"], np.array(warm["at"]) - 20.0, atol=0.1)
    np.testing.assert_allclose(warm["after_charge"], np.array(warm["at"]) - 20.0, atol=0.1)


@pytest.mark.parametrize(("spread_K", "shown"), [(0.9, False), (1.1, True)])
def test_a_temperature_that_hardly_moves_is_not_shown(spread_K: float, shown: bool) -> None:
    found = error_profiles(replace(samples(1000), temperature_degC=25.0 + spread_K * np.linspace(0.0, 1.0, 1000)))
    assert any(each["variable"] == "temperature_degC" for each in found) == shown


def test_time_since_a_step_is_even_in_its_logarithm_from_a_second_to_an_hour() -> None:
    since = np.geomspace(0.5, 10_000.0, 2000)
    found = profile(error_profiles(replace(samples(2000), since_step_s=since)), "since_step_s")
    steps = np.diff(np.log(found["at"]))
    np.testing.assert_allclose(steps, np.log(3600.0) / 20.0, rtol=1e-9)
    assert 1.0 < found["at"][0] and found["at"][-1] < 3600.0


def test_what_stands_still_has_no_profile() -> None:
    found = {each["variable"] for each in error_profiles(samples(1000))}
    assert found == {"since_step_s", "throughput_Ah", "time_h"}
