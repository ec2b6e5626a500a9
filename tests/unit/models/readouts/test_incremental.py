"""dQ/dV and dV/dQ of curves that are known in closed form."""

import numpy as np
import pytest

from models.readouts.incremental import incremental


def loop(n: int = 20_000) -> tuple[np.ndarray, np.ndarray]:
    """Charge and discharge by one ampere-hour on V = 3 + 0.5 Q^2, seen by a sensor of 1 mV."""
    up = np.linspace(0.0, 1.0, n)
    charge_Ah = np.concatenate([up, up[::-1]])
    return 3.0 + 0.5 * charge_Ah**2 + 1e-3 * np.random.default_rng(1).standard_normal(2 * n), charge_Ah


def test_both_curves_are_those_of_the_closed_form_in_both_directions() -> None:
    for found in incremental(*loop(), step_V=0.02, step_Ah=0.02).values():
        inner = (found.voltage_V > 3.05) & (found.voltage_V < 3.45)
        charge_Ah = np.sqrt(2.0 * (found.voltage_V[inner] - 3.0))
        assert found.dQ_dV_Ah_per_V[inner] == pytest.approx(1.0 / charge_Ah, rel=0.05)
        assert found.dV_dQ_V_per_Ah == pytest.approx(found.charge_Ah, abs=0.01)


def test_charge_is_neither_lost_nor_made() -> None:
    voltage_V, charge_Ah = loop()
    for found in incremental(voltage_V, charge_Ah, step_V=0.003, step_Ah=0.01).values():
        assert found.dQ_dV_Ah_per_V.sum() * 0.003 == pytest.approx(1.0)


def test_a_rest_tells_nothing_and_a_missing_voltage_is_passed_over() -> None:
    assert incremental(np.full(9, 3.6), np.zeros(9), 0.005, 0.01) == {}
    voltage_V, charge_Ah = loop(200)
    voltage_V[50:60] = np.nan
    found = incremental(voltage_V[:200], charge_Ah[:200], 0.005, 0.02)
    assert list(found) == ["charge"] and np.isfinite(found["charge"].dQ_dV_Ah_per_V).all()


def test_one_wild_value_asks_for_no_bins_without_end() -> None:
    voltage_V, charge_Ah = loop(100)
    voltage_V[3] = 1e12
    assert len(incremental(voltage_V, charge_Ah, 0.005, 0.02)["charge"].voltage_V) < 30_000
