"""dQ/dV and dV/dQ of a measurement and of a simulation, side by side."""

import numpy as np
import pytest

from models.readouts.incremental_beside import beside

N, CAPACITY_AH = 12_000, 2.0
TIME_S = np.arange(N) * 3.0


def cycle(rate: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """A charge, a rest, and a discharge, each over 0.9 of the capacity."""
    n = round(0.9 * 3600.0 / rate / 3.0)
    current = np.zeros(N)
    current[:n], current[-n:] = rate * CAPACITY_AH, -rate * CAPACITY_AH
    return current, np.cumsum(current) * 3.0 / 3600.0


def volts(charge_Ah: np.ndarray, step: float) -> np.ndarray:
    """A slope of 0.4 V per Ah with a stage's step at a charge."""
    return 3.4 + 0.4 * charge_Ah + 0.03 * np.tanh((charge_Ah - step) / 0.05)


def test_the_stage_of_each_is_where_it_is_and_is_as_steep() -> None:
    current, charge = cycle()
    measured = volts(charge, 1.0) + 1e-3 * np.random.default_rng(2).standard_normal(N)
    found = beside(TIME_S, current, charge, (measured, volts(charge, 1.2)), CAPACITY_AH)
    assert [each.way for each in found] == ["charge", "discharge"]
    for each in found:
        assert each.rate == pytest.approx(0.2, rel=0.01)
        assert (each.width_V, each.width_Ah) == (pytest.approx(0.01), pytest.approx(0.02))
        peaks = each.charge_Ah[np.nanargmax(each.dV_dQ_V_per_Ah, axis=1)]
        np.testing.assert_allclose(peaks, [1.0, 1.2], atol=0.02)
        assert each.dV_dQ_V_per_Ah[:, 60] == pytest.approx([0.4, 0.4], rel=0.1)
        # A step over charge is a dip over voltage: both are flat elsewhere, at the inverse of the slope.
        dips = each.voltage_V[60:-60][np.nanargmin(each.dQ_dV_Ah_per_V[:, 60:-60], axis=1)]
        np.testing.assert_allclose(dips, [3.8, 3.88], atol=0.015)
        assert np.nanmedian(each.dQ_dV_Ah_per_V, axis=1) == pytest.approx([2.5, 2.5], rel=0.15)


def test_charge_is_kept_by_the_smoothing() -> None:
    current, charge = cycle()
    for each in beside(TIME_S, current, charge, (volts(charge, 1.0), volts(charge, 1.0)), CAPACITY_AH):
        moved = np.nansum(each.dQ_dV_Ah_per_V, axis=1) * (each.voltage_V[1] - each.voltage_V[0])
        np.testing.assert_allclose(moved, 1.8, rtol=0.02)


def test_a_short_or_a_fast_way_shows_nothing() -> None:
    rng = np.random.default_rng(3)
    drive = np.repeat(rng.uniform(-2.0, 2.0, N // 40), 40)
    charge = np.cumsum(drive) * 3.0 / 3600.0
    assert beside(TIME_S, drive, charge, (volts(charge, 1.0), volts(charge, 1.0)), CAPACITY_AH) == []
    fast, charge = cycle(2.0)
    assert beside(TIME_S, fast, charge, (volts(charge, 1.0), volts(charge, 1.0)), CAPACITY_AH) == []


def test_voltages_that_are_missing_do_not_break_it() -> None:
    current, charge = cycle()
    measured = volts(charge, 1.0)
    measured[300:340] = np.nan
    found = beside(TIME_S, current, charge, (measured, volts(charge, 1.0)), CAPACITY_AH)
    assert len(found) == 2
    assert beside(TIME_S, current, charge, (np.full(N, np.nan), measured), CAPACITY_AH) == []
