"""The observer's own signals and blending against those of the model."""

from typing import Any

import numpy as np
import pytest

from models.network.compiled_network import flat_network, step_signals
from models.network.local_model_network import LocalModelNetwork
from models.network.signals.loop_form import LOOP
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver
from models.observer.filter import packing, places, running_inputs
from models.observer.filter.blending import blend, prepare
from tests.unit.models import hand_network

# Seen through Any: the type checker takes the compiled functions' arguments for what they are without compilation.
_MOVE_ON: Any = running_inputs.move_on
_STEP_SIGNALS: Any = step_signals
_BLEND: Any = blend
SIGNALS = (
    "current",
    "low_pass:30",
    "scaled_current:2500",
    "charge_transfer:3/2500/20",
    "squared_current:60/3000",
    "surface_soc:0.05/400/3500",
    "surface_soc:0.05/400/3500/30",
    "relaxation:300",
    "hysteresis_state:40",
    "temperature:5/30",
    "inverse_temperature",
    "temperature",
)


def network(**axes: int) -> LocalModelNetwork:
    """A network with a signal of each kind, boxes along the given axes."""
    inputs = tuple(InputChannel(name, delay=int("soc" in name)) for name in ("soc", *SIGNALS))
    partition = tuple(PartitionAxis(name, initial=count, k_sigma=0.4) for name, count in axes.items())
    structure = Structure(0, inputs, partition, hand_network.DT_S)
    count = int(np.prod(list(axes.values())))
    return hand_network.network(structure, np.random.default_rng(1).normal(size=(count, len(inputs) + 1)))


def test_signals_are_those_of_the_simulation_for_both_currents() -> None:
    net = flat_network(network(soc=2))
    n, more_A = len(net.form), 0.02
    per_span = 1.0 / net.span
    filters, history = np.zeros((2, n, 3)), np.zeros((2, 2, n))
    plain, plain_more, now, now_more = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    rng, last = np.random.default_rng(2), 0.0
    for k in range(50):
        current, soc, degC = float(rng.normal(0.0, 2.0)), 0.5 + 0.001 * k, float(rng.uniform(0.0, 40.0))
        before = history[:, 0].copy()
        change, direction = current - last, float(np.sign(current))
        rest = (change, soc, direction, degC)
        _MOVE_ON(net, per_span, more_A, filters, history, current, current, change, soc, *rest[1:], k == 0)
        _STEP_SIGNALS(net, plain, now, current, *rest)
        _STEP_SIGNALS(net, plain_more, now_more, current + more_A, *rest)
        np.testing.assert_allclose(history[0, 0], now, atol=1e-12)
        follows = net.form != LOOP
        np.testing.assert_allclose(history[1, 0][follows], now_more[follows], atol=1e-12)
        np.testing.assert_array_equal(history[1, 0][~follows], history[0, 0][~follows])
        if k > 0:
            np.testing.assert_array_equal(history[:, 1], before)
        last = current


@pytest.mark.parametrize("soc", [0.02, 0.4, 0.97])
@pytest.mark.parametrize("degC", [-3.0, 22.0, 400.0])
def test_the_blend_is_that_of_the_partition(soc: float, degC: float) -> None:
    model = network(soc=5, temperature=3)
    net = flat_network(model)
    prepared = prepare(net)
    scratch = np.zeros((places.AXIS_ROWS + 4, 40))
    z = np.array(
        [
            (soc - net.low[net.axis_signal[0]]) / net.span[net.axis_signal[0]],
            (degC - net.low[net.axis_signal[1]]) / net.span[net.axis_signal[1]],
        ]
    )
    history = np.zeros((2, 2, len(net.form)))
    history[0, :, net.axis_signal[1]] = z[1]
    history[0, :, net.axis_signal[0]] = z[0] - soc / net.span[net.axis_signal[0]]
    _BLEND(prepared, net.axis_signal, net.axis_lag, net.form, history, scratch, soc)
    expected = model.partition.validity(z[None])[0]
    np.testing.assert_allclose(scratch[places.VALIDITY_ROW, : model.n_models], expected, atol=1e-13)
    blended = scratch[places.BLENDED_ROW, : model.theta.shape[1]]
    np.testing.assert_allclose(blended, expected @ model.theta, atol=1e-12)
    step = 1e-6
    moved = [
        model.partition.validity((z + np.array([s / net.span[net.axis_signal[0]], 0.0]))[None])[0]
        for s in (step, -step)
    ]
    slope = (moved[0] - moved[1]) @ model.theta / (2.0 * step)
    np.testing.assert_allclose(scratch[places.TILTED_ROW, : model.theta.shape[1]], slope, atol=1e-6)


def test_an_offset_at_rest_does_not_turn_the_hysteresis() -> None:
    model = network(soc=2)
    observer = FuzzyObserver(model)
    n = 400
    assert observer.settings.current_offset_std_C > 0.0
    offset_A = observer.settings.current_offset_std_C * hand_network.CAPACITY_AH
    at = model.structure.signals.index("hysteresis_state:40")

    def hysteresis(offset: float) -> float:
        state, _ = observer.replay(observer.initial(0.5), np.full(n, offset), np.full(n, np.nan), np.full(n, 25.0))
        return float(packing.unpack_memory.py_func(state.memory, observer._whole)[3][0, at, 0])  # noqa: SLF001

    assert hysteresis(offset_A) == hysteresis(0.0) == 0.0
    assert hysteresis(20.0 * offset_A) > 0.01
