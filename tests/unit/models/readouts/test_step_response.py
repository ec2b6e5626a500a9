import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.network.free_run import free_run_V
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.readouts.resistance import resistance_table
from models.readouts.step_response import CurrentStep, step_response
from models.uncertainty.spread import LocalFactor
from tests.unit.models import hand_network

AXES = (PartitionAxis("soc"),)


def test_resistance_and_one_pair_in_closed_form() -> None:
    structure = Structure(0, (InputChannel("current"), InputChannel("low_pass:30")), AXES, hand_network.DT_S)
    network = hand_network.network(structure, np.array([[0.02, 0.015, 3.5]]))
    response = step_response(network, CurrentStep(soc=0.4, to_A=-3.0), duration_s=100.0)
    np.testing.assert_allclose(response.time_s, np.arange(1, 101))
    expected = 0.02 + 0.015 * (1.0 - np.exp(-response.time_s / 30.0))
    np.testing.assert_allclose(response.resistance_Ohm, expected, atol=1e-12)
    assert response.at(10.5) == pytest.approx(0.02 + 0.015 * (1.0 - np.exp(-10.5 / 30.0)), abs=3e-6)
    assert response.reservations == ()
    assert json.loads(json.dumps(response.to_json()))["resistance_Ohm"][4] == response.resistance_Ohm[4]


def test_output_recursion_in_closed_form() -> None:
    structure = Structure(1, (InputChannel("current", order=1),), AXES, hand_network.DT_S)
    network = hand_network.network(structure, np.array([[0.9, 0.010, -0.006, 0.35]]))
    response = step_response(network, CurrentStep(soc=0.4, from_A=1.0, to_A=-3.0), duration_s=50.0)
    k = np.arange(1, 51)
    # b_0 (1 + a + ... + a^(k-1)) + b_1 (1 + ... + a^(k-2))
    expected = 0.010 * (1 - 0.9**k) / 0.1 - 0.006 * (1 - 0.9 ** (k - 1)) / 0.1
    np.testing.assert_allclose(response.resistance_Ohm, expected, atol=1e-12)


@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize(("from_A", "to_A", "soc_moves"), [(0.0, -4.0, False), (0.0, -4.0, True), (-2.0, 3.0, False)])
def test_response_is_the_free_run_after_a_long_rest(order: int, from_A: float, to_A: float, soc_moves: bool) -> None:
    network = hand_network.everything(order)
    settle, n = 8000, 60
    # Discharge first, so that direction and hysteresis are those before the step.
    current = np.concatenate([np.full(settle, -2.0), np.full(settle, from_A), np.full(n, to_A)])
    run = hand_network.grid_run(current, 20.0, counted=False)
    if soc_moves:
        charge = np.where(np.arange(len(current)) >= 2 * settle, to_A, 0.0).cumsum() / 3600.0
        run = replace(run, charge_Ah=charge)
    voltage = free_run_V(network, run, 0.45)
    expected = (voltage[2 * settle :] - voltage[2 * settle - 1]) / (to_A - from_A)
    response = step_response(
        network,
        CurrentStep(
            soc=0.45, from_A=from_A, to_A=to_A, temperature_degC=20.0, direction_before=-1.0, soc_moves=soc_moves
        ),
        duration_s=n,
    )
    np.testing.assert_allclose(response.resistance_Ohm, expected, atol=1e-7)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_response_settles_to_the_table(order: int) -> None:
    network = hand_network.everything(order)
    table = resistance_table(network, soc=[0.45], current_A=[-4.0, 3.0], temperature_degC=[20.0])
    for c, to_A in enumerate((-4.0, 3.0)):
        response = step_response(network, CurrentStep(soc=0.45, to_A=to_A, temperature_degC=20.0), duration_s=8000.0)
        assert response.direction_before == np.sign(to_A)
        assert response.resistance_Ohm[-1] == pytest.approx(table.resistance_Ohm[c, 0, 0], abs=1e-7)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_band_is_the_spread_over_drawn_parameters(order: int) -> None:
    network = hand_network.everything(order)
    rng = np.random.default_rng(5)
    root = 2e-6 * rng.standard_normal((network.theta.size, network.theta.size))

    def response(theta: np.ndarray, local: LocalFactor | None = None):
        changed = replace(network, theta=theta)
        return step_response(
            changed,
            CurrentStep(soc=0.45, from_A=1.0, to_A=4.0, temperature_degC=20.0),
            duration_s=30.0,
            local=local,
        )

    band = response(network.theta, LocalFactor(root)).std_Ohm
    assert band is not None
    draws = [
        response(network.theta + (root @ rng.standard_normal(len(root))).reshape(network.theta.shape)).resistance_Ohm
        for _ in range(400)
    ]
    np.testing.assert_allclose(band, np.std(draws, axis=0), rtol=0.2)


def test_turning_the_current_shows_hysteresis_as_resistance() -> None:
    structure = Structure(
        0, (InputChannel("current"),), (PartitionAxis("hysteresis", initial=2),), hand_network.DT_S, "uniform"
    )
    network = hand_network.network(structure, np.array([[0.02, 3.5], [0.02, 3.54]]))
    ahead = step_response(network, CurrentStep(soc=0.5, to_A=2.0), duration_s=5.0)
    against = step_response(network, CurrentStep(soc=0.5, to_A=2.0, direction_before=-1.0), duration_s=5.0)
    np.testing.assert_allclose(ahead.resistance_Ohm, 0.02, atol=1e-12)
    np.testing.assert_allclose(against.resistance_Ohm, 0.04, atol=1e-12)


def test_a_negative_response_is_a_reservation() -> None:
    structure = Structure(0, (InputChannel("current"),), AXES, hand_network.DT_S)
    network = hand_network.network(structure, np.array([[-0.02, 3.5]]))
    assert "not positive" in step_response(network, CurrentStep(soc=0.4, to_A=1.0), duration_s=3.0).reservations[0]


def test_what_the_model_cannot_show_is_refused() -> None:
    structure = Structure(1, (InputChannel("current"),), AXES, hand_network.DT_S)
    network = hand_network.network(structure, np.array([[0.9, 0.02, 0.35]]))
    response = step_response(network, CurrentStep(soc=0.4, to_A=1.0), duration_s=10.0)
    for time_s in (0.5, 10.5):
        with pytest.raises(ModelError, match=r"outside 1\.\.10 s"):
            response.at(time_s)
    with pytest.raises(ModelError, match="no step"):
        step_response(network, CurrentStep(soc=0.4, from_A=1.0, to_A=1.0), duration_s=10.0)
    growing = hand_network.network(structure, np.array([[1.1, 0.02, 0.35]]))
    with pytest.raises(ModelError, match="does not settle"):
        step_response(growing, CurrentStep(soc=0.4, to_A=1.0), duration_s=10.0)
