"""A network by hats that learns on: what was physical at first stays so."""

from dataclasses import replace

import numpy as np
import pytest

from models.network.free_run import free_run_V
from models.readouts.steady_state import OperatingPoints, settled_voltage
from models.recursive.settings import UpdateSettings
from models.recursive.update import RecursiveUpdate
from tests.unit.models.hand_network import KNOTS, SCALING, grid_run, hats
from tests.unit.models.recursive.test_update import SETTINGS, adversarial, spread_run, twin

KNOT_SOC = SCALING["soc"][0] + KNOTS * (SCALING["soc"][1] - SCALING["soc"][0])


def rest_V(network) -> np.ndarray:
    return settled_voltage(network, OperatingPoints.grid(KNOT_SOC, 0.0, 0.0, 22.5)).voltage_V


@pytest.mark.parametrize("axis", ["soc", "surface_soc:0.05/400/3500"])
def test_step_replay_and_a_plain_twin_agree(axis: str) -> None:
    update = RecursiveUpdate(hats(axis), SETTINGS)
    run, noise = spread_run(400, seed=1)
    voltage = free_run_V(update.network, run, 0.5) + noise
    # Far from all limits, which the twin does not have.
    free = update._rule._replace(rest_low=np.full(len(KNOTS), -np.inf), rest_high=np.full(len(KNOTS), np.inf))
    update._rule = free
    theta, errors = twin(update, run, voltage, 0.5)
    end, out = update.replay(update.initial(0.5), run.current_A, voltage, run.temperature_degC)
    state, single = update.initial(0.5), []
    for sample in zip(run.current_A, voltage, run.temperature_degC, strict=True):
        state, said = update.step(state, *sample)
        single.append((said.model_voltage_V, said.error_V, said.error_std_V))
    np.testing.assert_array_equal(state.theta, end.theta)
    np.testing.assert_array_equal(np.array(single), out)
    np.testing.assert_allclose(end.theta, theta, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(out[:, 1], errors, rtol=0.0, atol=1e-12)
    assert np.abs(end.theta - update.network.theta).max() > 1e-4


def test_a_cell_whose_resistance_has_grown_is_followed() -> None:
    before = hats()
    older = replace(before, theta=before.theta * np.array([1.5, 1.5, 1.0, 1.5, 1.0, 1.0, 1.0]))
    # Gains grow about rest, not about the middle of what is normalised to 0..1.
    older.theta[:, -1] += np.sum((before.theta - older.theta) * RecursiveUpdate(before)._rule.at_rest, axis=1)
    update = RecursiveUpdate(before, UpdateSettings(memory_s=6 * 3600.0))
    current = np.repeat(np.random.default_rng(5).uniform(-4.0, 3.5, 600), 20)
    run = grid_run(current, 22.5)
    voltage = free_run_V(older, run, 0.8) + np.random.default_rng(6).normal(0.0, 1e-3, len(current))
    state, out = update.replay(update.initial(0.8), current, voltage, run.temperature_degC)
    learned = update.updated(state)
    first = np.sqrt(np.mean((free_run_V(before, run, 0.8) - voltage) ** 2))
    assert np.sqrt(np.mean((free_run_V(learned, run, 0.8) - voltage) ** 2)) < 0.3 * first
    assert np.sqrt(np.mean(out[-2000:, 1] ** 2)) < 0.3 * first


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_curve_goes_on_rising_and_resistances_positive_whatever_is_measured(seed: int) -> None:
    update = RecursiveUpdate(hats(), SETTINGS)
    start = rest_V(update.network)
    assert (np.diff(start) > 0.0).all()
    state, _ = update.replay(update.initial(0.5), *adversarial(20_000, seed=seed))
    assert np.isfinite(state.theta).all()
    run, _ = spread_run(3000, seed=seed)
    wrong_V = 3.7 + 0.3 * np.random.default_rng(seed).standard_normal(3000)
    state, _ = update.replay(update.resumed(state, 0.5), run.current_A, wrong_V, run.temperature_degC)
    learned = update.updated(state)
    assert np.abs(rest_V(learned) - start).max() > 1e-3
    assert (np.diff(rest_V(learned)) >= -1e-12).all()
    assert (learned.theta[:, :5] >= 0.0).all()
