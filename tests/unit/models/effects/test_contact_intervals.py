"""When a contact was bad."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.effects import effect
from models.effects.contact_intervals import bad_contact, smallest_found_Ohm
from models.effects.view import View
from tests.unit.models.effects.linear_cell import LinearCell, linear_view

N, NOISE_V = 6000, 1e-3
BAD = (np.sin(np.arange(N) / 350.0) > 0.6) | ((np.arange(N) > 4300) & (np.arange(N) < 4700))


def view(extra_V: FloatArray, seed: int = 3, *, steady: bool = False) -> View:
    """A run of the linear cell with a fault: a drive cycle, or 20 minutes of a current and rests between."""
    plain = linear_view(n=N)
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-3.0, 2.0, N // 20), 20)
    if steady:
        current = np.tile(np.repeat([-1.5, 0.0, 1.5, 0.0], [1200, 300, 1200, 300]), 2)
    charge_Ah = np.cumsum(current) / 3600.0
    run = replace(plain.run, current_A=current, charge_Ah=charge_Ah)
    known = replace(plain, run=run, index=np.arange(N))
    noise = NOISE_V * rng.standard_normal(N)
    # The model is off by what it says of a resistance over the state of charge, and of large currents.
    off_V = 2e-3 * known.soc * current + 2e-3 * current * np.abs(current) + 5e-3 * np.sin(np.arange(N) / 900.0)
    return replace(known, run=replace(run, voltage_V=known.voltage_V + extra_V(current) + noise + off_V))


@pytest.mark.parametrize("ohm", [0.006, 0.015])
def test_the_intervals_of_a_drive_cycle_are_found(ohm: float) -> None:
    found = bad_contact(view(lambda current: ohm * current * BAD))
    assert np.mean(found == BAD) > 0.97


def test_under_a_steady_current_a_jump_tells() -> None:
    one = view(lambda current: 0.02 * current * BAD, steady=True)
    loaded = one.run.current_A != 0.0
    assert np.mean((bad_contact(one) == BAD)[loaded]) > 0.95


@pytest.mark.parametrize("steady", [False, True])
def test_without_one_there_are_none(steady: bool) -> None:
    assert not any(bad_contact(view(lambda current: 0.0 * current, seed, steady=steady)).any() for seed in range(4))


def test_a_resistance_that_stays_is_none() -> None:
    assert not bad_contact(view(lambda current: 0.02 * current)).any()


def test_a_spike_is_none() -> None:
    spiked = np.isin(np.arange(N), [700, 1900, 1901, 4000])
    assert not bad_contact(view(lambda current: 0.2 * spiked + 0.0 * current)).any()


def test_samples_without_a_voltage_do_not_matter() -> None:
    one = view(lambda current: 0.015 * current * BAD)
    holes = one.run.voltage_V.copy()
    holes[1000:1200] = np.nan
    found = bad_contact(replace(one, run=replace(one.run, voltage_V=holes, measured=np.isfinite(holes))))
    assert np.mean(found == BAD) > 0.95


def test_its_column_is_the_current_while_it_is_bad() -> None:
    one = view(lambda current: 0.015 * current * BAD)
    regressors, forms = effect("intermittent_contact").regressors, effect("intermittent_contact").expected.forms
    assert regressors is not None and forms is not None
    bad = bad_contact(one)
    np.testing.assert_array_equal(regressors(one)[:, 0], np.where(bad, one.run.current_A, 0.0))
    (form,) = forms(one)
    assert form.told[0].name == "resistance_Ohm"
    np.testing.assert_allclose(form.columns[:, 0], form.told[0].weights[0] * np.where(bad, one.run.current_A, 0.0))


def test_a_short_run_has_none() -> None:
    short = linear_view(LinearCell(), n=100)
    assert not bad_contact(short).any()


@pytest.mark.parametrize("steady", [False, True])
def test_the_stated_size_is_found_and_half_of_it_is_not(steady: bool) -> None:
    def share_found(factor: float) -> float:
        found = []
        for seed in range(20, 30):
            ohm = factor * smallest_found_Ohm(view(lambda current: 0.0 * current, seed, steady=steady), [BAD])
            found.append(bad_contact(view(lambda current, r=ohm: r * current * BAD, seed, steady=steady)).any())
        return float(np.mean(found))

    assert share_found(1.1) >= 0.8
    assert share_found(0.5) <= 0.2


def test_a_contact_that_never_comes_or_goes_is_found_at_no_size() -> None:
    one = view(lambda current: 0.0 * current)
    assert smallest_found_Ohm(one, [np.zeros(N, dtype=bool)]) == np.inf
    unmeasured = replace(one, run=replace(one.run, measured=np.arange(N) < 8))
    assert smallest_found_Ohm(unmeasured, [BAD]) == np.inf


def test_where_none_is_found_one_might_have_been_for_some_minutes() -> None:
    expected = effect("intermittent_contact").expected
    assert expected.forms is not None and expected.unseen is not None and expected.found_from is not None
    one = view(lambda current: 0.0 * current)
    assert not expected.forms(one)[0].columns.any()
    assert 0.3 < np.mean(expected.unseen(one)[0].columns[one.run.current_A != 0.0] != 0.0) < 0.7
    assert 0.0 < expected.found_from(one) < 0.1
