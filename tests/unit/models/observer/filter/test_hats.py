"""The observer on networks by hats: no state of charge among the inputs, only the curve over the knots."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.module.models import ModuleModel
from models.network.compiled_network import flat_network
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import hat_partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver, ObserverSettings
from models.observer.certificate.observability import observability
from models.observer.certificate.stability import stability
from models.observer.filter import places
from models.observer.filter.blending import blend_hats
from models.observer.filter.gains import hat_slopes, state_matrices
from models.observer.health import MODEL, watch
from models.observer.module.module_errors import CellSpread, slow_error_V
from models.observer.tuning.tuning import tune_on_grid
from models.readouts.ocv import ocv_table
from tests.unit.models import hand_network
from tests.unit.models.hand_network import KNOTS, SCALING, grid_run, hats

AXES = ["soc", "surface_soc:0.05/400/3500", "surface_soc:0.05/400/3500/30"]
SETTINGS = ObserverSettings(
    voltage_std_V=2e-3, quick_error_std_V=1e-3, slow_error_std_V=2e-3, current_offset_std_C=0.0, capacity_std=0.0
)
_BLEND_HATS: Any = blend_hats


def cycled(n: int = 6000, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Current and temperature of a load that takes the cell from 0.75 down by some 40 points."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-3.0, 2.0, n // 60 + 1), 60)[:n]
    current[::240] = 0.0
    return current, 20.0 + 5.0 * np.sin(np.arange(n) / 900.0)


def simulated_V(network: LocalModelNetwork, current: np.ndarray, degC: np.ndarray, soc: float) -> np.ndarray:
    return free_run_V(network, grid_run(current, degC), soc)


@pytest.mark.parametrize("soc", [-0.04, 0.12, 0.3, 0.5, 0.7, 0.99])
@pytest.mark.parametrize("axis", AXES)
def test_the_blend_is_that_of_the_partition_with_its_slope(axis: str, soc: float) -> None:
    model = hats(axis)
    net, scratch = flat_network(model), np.zeros((places.AXIS_ROWS + 2, 40))
    per_span, s = 1.0 / net.span, net.axis_signal[0]
    history = np.zeros((2, 2, len(net.form)))
    # Ahead of the mean state of charge by what has diffused.
    ahead = 0.013
    history[0, 1, s] = (ahead - net.low[s]) * per_span[s]
    below = _BLEND_HATS(net, per_span, history, scratch, soc)

    def at(value: float) -> np.ndarray:
        return model.partition.validity(np.array([[(value + ahead - net.low[s]) * per_span[s]]]))[0]

    weights = np.zeros(model.n_models)
    weights[below : below + 2] = scratch[places.VALIDITY_ROW, below : below + 2]
    np.testing.assert_allclose(weights, at(soc), atol=1e-14)
    p = model.theta.shape[1]
    np.testing.assert_allclose(scratch[places.BLENDED_ROW, :p], at(soc) @ model.theta, atol=1e-13)
    # Beyond the outermost knots the slope is that of the last interval.
    low, high = net.low[s] + KNOTS[[0, -1]] * net.span[s] - ahead
    inside = float(np.clip(soc, low + 2e-6, high - 2e-6))
    slope = (at(inside + 1e-6) - at(inside - 1e-6)) @ model.theta / 2e-6
    np.testing.assert_allclose(scratch[places.TILTED_ROW, :p], slope, atol=1e-6)


@pytest.mark.parametrize("axis", AXES)
def test_without_voltage_it_is_the_free_run(axis: str) -> None:
    model = hats(axis)
    current, degC = cycled(1500)
    observer = FuzzyObserver(model, SETTINGS)
    _, rows = observer.replay(observer.initial(0.75, 0.01), current, np.full(len(current), np.nan), degC)
    np.testing.assert_allclose(rows[:, 2], simulated_V(model, current, degC, 0.75), atol=1e-10)


@pytest.mark.parametrize("soc", [0.15, 0.4, 0.62, 0.85])
@pytest.mark.parametrize("axis", AXES)
def test_the_outputs_spread_is_the_slope_of_the_curve_under_load(axis: str, soc: float) -> None:
    nothing_else = replace(
        SETTINGS,
        quick_error_std_V=0.0,
        slow_error_std_V=0.0,
        resistance_std=0.0,
        loop_std=0.0,
        soc_std_per_sqrt_s=1e-12,
    )
    observer, (current, degC) = FuzzyObserver(hats(axis), nothing_else), cycled(60)
    std, step = 1e-3, 1e-6
    nothing = np.full(len(current), np.nan)
    _, rows = observer.replay(observer.initial(soc, std), current, nothing, degC)
    up, down = (observer.replay(observer.initial(soc + s, std), current, nothing, degC)[1][:, 2] for s in (step, -step))
    slope_V = (up - down) / (2.0 * step)
    assert np.ptp(slope_V) > 0.0
    # That diffusion slows down with the state of charge itself is no part of the filter's slope.
    rtol = 1e-3 if axis.endswith("/30") else 1e-5
    np.testing.assert_allclose(rows[:, 4] ** 2, SETTINGS.voltage_std_V**2 + (std * slope_V) ** 2, rtol=rtol)


@pytest.mark.parametrize("gain", ["kalman", "steady"])
@pytest.mark.parametrize("off", [-0.2, 0.2])
@pytest.mark.parametrize("axis", AXES)
def test_it_finds_the_state_of_charge_from_twenty_points_off(axis: str, off: float, gain: str) -> None:
    model = hats(axis)
    current, degC = cycled()
    run = grid_run(current, degC)
    voltage = simulated_V(model, current, degC, 0.75) + 2e-3 * np.random.default_rng(7).standard_normal(len(current))
    soc = 0.75 + run.charge_Ah / hand_network.CAPACITY_AH
    observer = FuzzyObserver(model, replace(SETTINGS, gain=gain))
    _, rows = observer.replay(observer.initial(0.75 + off, 0.2), current, voltage, degC)
    assert abs(rows[0, 0] - soc[0]) < 0.25
    late = slice(2000, None)
    assert np.abs(rows[late, 0] - soc[late]).max() < 0.02
    assert np.mean(np.abs(rows[late, 0] - soc[late]) <= 2.6 * rows[late, 1]) > 0.95
    assert not (watch(rows, voltage)[late, 2].astype(int) & MODEL).any()


@pytest.mark.parametrize("start", [1.0, 1.01])
def test_it_comes_back_from_beyond_the_last_knot(start: float) -> None:
    model = hats()
    current, degC = np.full(3000, -0.2), np.full(3000, 25.0)
    voltage = simulated_V(model, current, degC, 0.85)
    observer = FuzzyObserver(model, SETTINGS)
    _, rows = observer.replay(observer.initial(start, 0.02), current, voltage, degC)
    assert rows[-1, 0] == pytest.approx(0.85 - 0.2 * 3000.0 / 3600.0 / 2.0, abs=0.03)


def test_step_by_step_equals_replay_to_the_bit() -> None:
    current, degC = cycled(300)
    observer = FuzzyObserver(hats(AXES[1]))
    voltage = simulated_V(observer.network, current, degC, 0.6)
    start = observer.initial(0.5, 0.2)
    _, rows = observer.replay(start, current, voltage, degC)
    state = start
    for k in range(len(current)):
        state, out = observer.step(state, current[k], voltage[k], degC[k])
        np.testing.assert_array_equal(out.row, rows[k])


def test_state_matrices_hold_the_slope_of_the_open_circuit_voltage() -> None:
    model = hats()
    low, high = SCALING["soc"]
    v_low, v_high = SCALING["voltage"]
    knots = low + (high - low) * KNOTS
    # Without any direction, between the branches of the loop.
    rest_V = ocv_table(model, knots, np.array([25.0])).mean_V[0]
    np.testing.assert_allclose(hat_slopes(model), np.diff(rest_V) / np.diff(knots) / (v_high - v_low), rtol=1e-9)
    matrices = state_matrices(model)
    assert matrices.shape == (len(KNOTS), 2, 2)
    np.testing.assert_allclose(matrices[1:-1, 0, 1], 0.5 * (hat_slopes(model)[1:] + hat_slopes(model)[:-1]))
    np.testing.assert_allclose(matrices[:, 1], [[0.0, 1.0]] * len(KNOTS))


def test_a_state_of_charge_among_the_inputs_adds_its_own_slope() -> None:
    inputs = (InputChannel("soc", delay=1), InputChannel("current"))
    structure = Structure(0, inputs, (PartitionAxis("soc"),), 1.0, "hat")
    rows = np.column_stack([np.full(3, 0.4), np.full(3, 0.02), [3.0, 3.1, 3.4]])
    model = hand_network.network(structure, rows, hat_partition(np.array([0.0, 0.5, 1.0])))
    half = 0.5 * (SCALING["soc"][1] - SCALING["soc"][0])
    per_V = 1.0 / (SCALING["voltage"][1] - SCALING["voltage"][0])
    expected = per_V * (0.4 + np.array([0.1, 0.2, 0.3]) / half)
    np.testing.assert_allclose(state_matrices(model)[:, 0, 1], expected, rtol=1e-9)
    current, degC = cycled(800)
    observer = FuzzyObserver(model, SETTINGS)
    _, seen = observer.replay(observer.initial(0.6, 0.01), current, np.full(800, np.nan), degC)
    np.testing.assert_allclose(seen[:, 2], simulated_V(model, current, degC, 0.6), atol=1e-10)


def test_the_certificate_speaks_of_hats() -> None:
    model = hats()
    found = stability(model, replace(SETTINGS, soc_std_per_sqrt_s=1e-4))
    assert found.pairs == 3 * (len(KNOTS) - 1)
    assert found.spectral_radius < 1.0
    seen = observability(model, np.array([0.1, 0.5, 0.9]), settings=SETTINGS)
    assert (seen.rank == 2).all()
    assert not seen.blind.any()


def test_it_is_tuned_and_observes_modules() -> None:
    model = hats()
    current, degC = cycled(4000)
    noise = 3e-3 * np.random.default_rng(8).standard_normal(len(current))
    run = replace(
        grid_run(current, degC),
        voltage_V=simulated_V(model, current, degC, 0.75) + noise,
        measured=np.ones(len(current), bool),
    )
    found = tune_on_grid(model, [run], [0.75])
    # The noise is chosen for the SoC within the factors that are tried.
    assert 1e-3 < found.judged_noise_V < 1e-2
    assert (slow_error_V(model, ModuleModel("S1", 4, 1), CellSpread()) > 0.0).all()
