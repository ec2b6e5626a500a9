"""Where the printed method contradicts itself, what is used is checked here, each point by itself."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from models.data.errors import ModelError
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver, ObserverSettings
from models.observer.filter.gains import observer_matrices, output_rows, state_matrices, steady_state_gains
from tests.unit.models import hand_network

SETTINGS = ObserverSettings(soc_std_per_sqrt_s=1e-4, quick_error_std_V=2e-3, slow_error_std_V=2e-3)
NARROW = 1e-9


def network(order: int) -> LocalModelNetwork:
    """Two local models over SoC with open-circuit slopes of 0.4 and 1.0 V and a direct resistance."""
    structure = Structure(
        order,
        (InputChannel("soc", delay=1), InputChannel("current")),
        (PartitionAxis("soc", initial=2, k_sigma=0.3),),
        hand_network.DT_S,
    )
    past = [[], [0.6], [0.5, 0.2]][order]
    left = 1.0 - sum(past)
    rows = [[*past, left * slope, left * 0.02, left * offset] for slope, offset in ((0.4, 3.4), (1.0, 3.1))]
    return hand_network.network(structure, np.array(rows))


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_gain_is_that_of_the_filter_not_of_the_predictor(order: int) -> None:
    model = network(order)
    matrices, process = observer_matrices(model, SETTINGS)
    rows = output_rows(model, SETTINGS, np.ones(2))
    measurement = 1e-5
    gains = steady_state_gains(matrices, rows, process, measurement)
    for matrix, row, gain in zip(matrices, rows, gains, strict=True):
        p = solve_discrete_are(matrix.T, row[:, None], process, np.array([[measurement]]))
        filter_gain = p @ row / (row @ p @ row + measurement)
        np.testing.assert_allclose(gain[:-1], filter_gain, rtol=1e-9)
        assert not np.allclose(gain[:-1], matrix @ filter_gain, rtol=1e-3)
        # The error of the filter must die out: eigenvalues of (I - K C) A inside the unit circle.
        closed = (np.eye(len(row)) - np.outer(gain[:-1], row)) @ matrix
        assert np.abs(np.linalg.eigvals(closed)).max() < 1.0


def test_the_state_holds_the_output_of_this_sample() -> None:
    # One sample after a step of the current the output must have moved; with y(k-1) in the state it would not.
    observer = FuzzyObserver(network(1))
    state, first = observer.step(observer.initial(0.3, NARROW), 0.0, 3.52, 25.0)
    _, second = observer.step(state, 4.0, np.nan, 25.0)
    assert second.model_voltage_V - first.model_voltage_V == pytest.approx(0.4 * 0.02 * 4.0, rel=0.05)


def test_the_output_belongs_to_the_state_of_charge_one_sample_before() -> None:
    # With a huge current the state of charge moves within the sample, the output only with the sample after.
    slope_only = network(0)
    observer = FuzzyObserver(slope_only)
    state, _ = observer.step(observer.initial(0.3, NARROW), 0.0, np.nan, 25.0)
    state, moving = observer.step(state, 72.0, np.nan, 25.0)
    _, after = observer.step(state, 0.0, np.nan, 25.0)
    resistive = 0.02 * 72.0
    assert moving.soc == pytest.approx(0.31)
    assert moving.model_voltage_V - resistive < after.model_voltage_V


def test_validity_functions_are_taken_at_the_state_of_charge_one_sample_before() -> None:
    model = network(0)
    observer = FuzzyObserver(model)
    state, _ = observer.step(observer.initial(0.5, NARROW), 0.0, np.nan, 25.0)
    _, out = observer.step(state, 72.0, np.nan, 25.0)
    low, high = model.scaling["soc"]
    z = (0.5 - low) / (high - low)
    phi = model.partition.validity(np.array([[z]]))[0]
    lines = np.array([0.4 * 0.5 + 3.4, 1.0 * 0.5 + 3.1]) + 0.02 * 72.0
    assert out.model_voltage_V == pytest.approx(float(phi @ lines), abs=1e-9)


def test_blended_error_map_is_that_of_pairs_of_local_models() -> None:
    matrices, process = observer_matrices(network(1), SETTINGS)
    rows = output_rows(network(1), SETTINGS, np.ones(2))
    gains = steady_state_gains(matrices, rows, process, 1e-5)[:, :-1]
    phi, eye = np.array([0.3, 0.7]), np.eye(matrices.shape[1])
    blended = (eye - np.outer(phi @ gains, rows[0])) @ np.tensordot(phi, matrices, axes=1)
    pairs = sum(phi[i] * phi[j] * (eye - np.outer(gains[j], rows[0])) @ matrices[i] for i in range(2) for j in range(2))
    diagonal = sum(phi[i] * (eye - np.outer(gains[i], rows[0])) @ matrices[i] for i in range(2))
    np.testing.assert_allclose(blended, pairs, atol=1e-12)
    assert np.abs(blended - diagonal).max() > 1e-4


def test_the_integrator_is_scaled_with_the_normalisation() -> None:
    matrices = state_matrices(network(1))
    low, high = hand_network.SCALING["soc"]
    v_low, v_high = hand_network.SCALING["voltage"]
    # Normalised volts per fraction of SoC: the printed b_SoC belongs to the normalised SoC.
    assert matrices[0, 0, 1] == pytest.approx(0.4 * 0.4 / (v_high - v_low))
    assert network(1).theta[0, 1] == pytest.approx(matrices[0, 0, 1] * (high - low))


def test_a_network_without_delayed_soc_is_refused() -> None:
    now = Structure(0, (InputChannel("soc"), InputChannel("current")), (PartitionAxis("soc"),), 1.0)
    with pytest.raises(ModelError, match="delay of one sample"):
        FuzzyObserver(hand_network.network(now, np.array([[0.4, 0.02, 3.4]])))
    none = Structure(0, (InputChannel("current"),), (PartitionAxis("current"),), 1.0)
    with pytest.raises(ModelError, match="this model has none"):
        FuzzyObserver(hand_network.network(none, np.array([[0.02, 3.4]])))
