from dataclasses import replace

import numpy as np
import pytest

from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver, ObserverSettings
from models.observer.filter.places import N_EXTRA
from tests.unit.models import hand_network

# A curve of 0.1 V over the whole range, a loop of 20 mV: a wrong place in it is worth 20 points.
CURVE_V, LOOP_V, RATE, NOISE_V = 0.1, 0.02, 10.0, 1e-3
SETTINGS = ObserverSettings(
    voltage_std_V=NOISE_V,
    quick_error_std_V=1e-4,
    slow_error_std_V=1e-4,
    soc_std_per_sqrt_s=1e-7,
    resistance_std=0.0,
    current_offset_std_C=0.0,
    capacity_std=0.0,
)


def network(order: int = 0) -> LocalModelNetwork:
    inputs = (InputChannel("soc", delay=1), InputChannel("current"), InputChannel(f"hysteresis_state:{RATE:g}"))
    structure = Structure(order, inputs, (PartitionAxis("soc"),), hand_network.DT_S)
    past = [0.4] * order
    left = 1.0 - sum(past)
    row = [*past, left * CURVE_V, left * 0.02, left * LOOP_V, left * 3.6]
    scaling = hand_network.SCALING | {f"hysteresis_state:{RATE:g}": (-0.97, 0.99)}
    return hand_network.network(structure, np.array([row]), scaling=scaling)


def run(order: int, place: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Current, voltage and state of charge of the network itself, from a place in the loop."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.normal(-0.15, 1.0, 120), 60)
    current[0] = 0.0
    counted = np.concatenate([[0.0], np.cumsum(current[1:])]) / 3600.0 / hand_network.CAPACITY_AH
    soc = 0.5 + counted
    throughput = np.concatenate([[0.0], np.cumsum(np.abs(current[1:]))]) / 3600.0 / hand_network.CAPACITY_AH
    loop, state = np.empty(len(current)), place
    for k in range(len(current)):
        keep = np.exp(-RATE * (throughput[k] - throughput[max(k - 1, 0)]))
        state = keep * state + (1.0 - keep) * np.sign(current[k])
        loop[k] = state
    settled = 3.6 + CURVE_V * np.concatenate([soc[:1], soc[:-1]]) + 0.02 * current + LOOP_V * loop
    volts = settled.copy()
    for k in range(1, len(volts)) if order else ():
        volts[k] = 0.4 * volts[k - 1] + 0.6 * settled[k]
    return current, volts + NOISE_V * rng.standard_normal(len(volts)), soc


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize("place", [-0.9, -0.5, 0.5, 0.9])
def test_a_start_anywhere_in_the_loop_is_not_taken_for_another_state_of_charge(order: int, place: float) -> None:
    model = network(order)
    inside, first, blind = [], [], []
    for seed in range(3):
        current, volts, soc = run(order, place, seed)
        warm = np.full(len(current), 25.0)
        for loop_std, errors in ((SETTINGS.loop_std, first), (0.0, blind)):
            observer = FuzzyObserver(model, replace(SETTINGS, loop_std=loop_std))
            _, rows = observer.replay(observer.initial(0.5, 0.02), current, volts, warm)
            errors.append(np.abs(rows[:, 0] - soc)[600:].max())
            if loop_std > 0.0:
                inside.append(np.abs(rows[600:, 0] - soc[600:]) <= 2.5 * rows[600:, 1])
    assert np.mean(inside) > 0.9
    assert np.mean(first) < 0.6 * np.mean(blind)


def test_the_place_fades_with_the_charge_that_moves_and_is_found_meanwhile() -> None:
    current, volts, _ = run(0, 0.9, 1)
    observer = FuzzyObserver(network(), SETTINGS)
    start = observer.initial(0.5, 1e-4)
    state, _ = observer.replay(start, current, volts, np.full(len(current), 25.0))
    n = 1
    at = state.x.shape[1] - 1
    assert start.covariance[0, at, at] == pytest.approx(SETTINGS.loop_std**2)
    assert state.x[0, at] == pytest.approx(0.9, abs=0.1)
    assert state.covariance[0, at, at] < 0.05 * start.covariance[0, at, at]
    assert state.covariance[0, n, n] > 0.0


def test_a_network_without_a_loop_has_no_place_in_it(fitted: FuzzyObserver) -> None:
    structure = fitted.network.structure
    assert not any(name.startswith("hysteresis_state") for name in structure.signals)
    assert fitted.initial(0.5).x.shape[1] == structure.output_order + N_EXTRA
    assert FuzzyObserver(network()).initial(0.5).x.shape[1] == 1 + N_EXTRA + 1
