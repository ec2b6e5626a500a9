"""What every kind of signal owes, one function for each promise; a signal is given by its name."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.design.information.experiment import Evaluator, Experiment
from models.network.compiled_network import FlatNetwork, flat_network, step_signals
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import Held, RunSignals, Step, parse_signal
from models.network.signals.direction import REST_C_RATE
from models.network.signals.loop_form import LOOP
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer.filter import running_inputs
from tests.unit.models import hand_network

# Seen through Any: the type checker takes the compiled functions' arguments for what they are without compilation.
_MOVE_ON: Any = running_inputs.move_on
_STEP_SIGNALS: Any = step_signals
DT_S, CAPACITY_AH = hand_network.DT_S, hand_network.CAPACITY_AH
_LONG = 12_000


def has_form(name: str) -> bool:
    return parse_signal(name).definition.loop is not None


def values_are_finite(name: str) -> None:
    values = _run(_excitation(500)).values(name)
    assert values.shape == (500,) and values.dtype == np.float64
    assert np.isfinite(values).all()


def settled_is_the_end_of_a_long_held_run(name: str) -> None:
    signal = parse_signal(name)
    for current_A in (3.0, -4.0):
        run = _held_run(np.full(_LONG, current_A))
        held = Held(np.array([current_A]), np.array([18.0]), np.array([0.4]), np.sign([current_A]), CAPACITY_AH)
        _near(run.values(name)[-1:], signal.definition.settled(signal, held), 1e-6, name)


def a_step_is_that_of_a_run(name: str) -> None:
    """The samples around a step are the last ones of a run that was held before it for long."""
    signal, n = parse_signal(name), 300
    for from_A, to_A in ((2.0, -3.0), (-1.0, -4.0), (3.0, 1.0)):
        run = _held_run(np.concatenate([np.full(_LONG, from_A), np.full(n, to_A)]))
        part = slice(_LONG - 2, None)
        current, since = run.current_A[part], np.maximum(np.arange(n + 2) - 1, 0)
        degC, soc = run.temperature_degC[part], run.soc[part]
        step = Step(current, degC, soc, np.sign(current), since, DT_S, CAPACITY_AH)
        _near(signal.definition.after_step(signal, step), run.values(name)[part], 1e-6, name)


def the_compiled_step_makes_the_arrays(name: str) -> None:
    run, net = _run(_excitation(600)), flat_network(_network(name))
    made, at = _stepped(net, run), _network(name).structure.signals.index(name)
    low, span = net.low[at], net.span[at]
    np.testing.assert_allclose(made[:, at], (run.values(name) - low) / span, rtol=0, atol=1e-12, err_msg=name)


def the_observer_makes_what_the_compiled_step_makes(name: str) -> None:
    net, more_A = flat_network(_network(name)), 0.02
    n, per_span = len(net.form), 1.0 / net.span
    filters, history = np.zeros((2, n, 3)), np.zeros((2, 2, n))
    plain, plain_more, now, now_more = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros(n), np.zeros(n)
    run, follows = _run(_excitation(200)), net.form != LOOP
    for k, (current, change, soc, direction, degC) in enumerate(_samples(run)):
        rest = (change, soc, direction, degC)
        _MOVE_ON(net, per_span, more_A, filters, history, current, current, change, soc, *rest[1:], k == 0)
        _STEP_SIGNALS(net, plain, now, current, *rest)
        _STEP_SIGNALS(net, plain_more, now_more, current + more_A, *rest)
        np.testing.assert_allclose(history[0, 0], now, rtol=0, atol=1e-12, err_msg=name)
        # A little more current is not said to turn a loop.
        np.testing.assert_allclose(history[1, 0][follows], now_more[follows], rtol=0, atol=1e-12, err_msg=name)
        np.testing.assert_array_equal(history[1, 0][~follows], history[0, 0][~follows])


def the_gradient_is_that_of_differences(name: str) -> None:
    experiment = Experiment(_network(name), 0.5, 5e-3, 20.0, prior_std=0.05)
    n, step = 25, 1e-4
    current, evaluator = _excitation(n), Evaluator(experiment, n)
    _, gradient = evaluator.value_and_gradient(current)
    moved = [evaluator.value(current + step * e) - evaluator.value(current - step * e) for e in np.eye(n)]
    _near(gradient, np.array(moved) / (2.0 * step), 1e-5, name)


def _excitation(n: int) -> np.ndarray:
    # No sample within reach of 0: there a sign has no derivative.
    rng = np.random.default_rng(3)
    return rng.choice([-1.0, 1.0], n) * rng.uniform(0.5, 4.0, n)


def _run(current_A: np.ndarray) -> RunSignals:
    counted = np.concatenate([[0.0], np.cumsum(current_A[1:])]) * DT_S / (3600.0 * CAPACITY_AH)
    degC = 20.0 + 12.0 * np.sin(np.arange(len(current_A)) / 40.0)
    return RunSignals(current_A, degC, 0.5 + counted, DT_S, CAPACITY_AH)


def _held_run(current_A: np.ndarray) -> RunSignals:
    n = len(current_A)
    return RunSignals(current_A, np.full(n, 18.0), np.full(n, 0.4), DT_S, CAPACITY_AH)


def _network(name: str) -> LocalModelNetwork:
    """Two local models on the state of charge, the current and a signal, which is normalised by a run's range."""
    signal, values = parse_signal(name), _run(_excitation(600)).values(name)
    inputs = [InputChannel("soc", delay=1), InputChannel("current", order=1)]
    if name not in ("soc", "current"):
        inputs.append(InputChannel(name, delay=int(signal.definition.soc)))
    structure = Structure(1, tuple(inputs), (PartitionAxis("soc", initial=2, k_sigma=0.5),), DT_S)
    bounds = {name: (float(values.min()) - 0.3, float(values.max()) + 0.4)}
    gains = np.random.default_rng(5).uniform(0.003, 0.006, (2, structure.n_regressors))
    gains[:, 0], gains[:, -1] = 0.8, 0.6
    return hand_network.network(structure, gains, scaling=bounds | hand_network.SCALING)


def _samples(run: RunSignals) -> list[tuple[float, ...]]:
    """Current, its change, state of charge, held direction and temperature, sample by sample."""
    direction, last, found = -1.0, float(run.current_A[0]), []
    for current, soc, degC in zip(run.current_A.tolist(), run.soc.tolist(), run.temperature_degC.tolist(), strict=True):
        direction = float(np.sign(current)) if abs(current) > REST_C_RATE * CAPACITY_AH else direction
        found.append((current, current - last, soc, direction, degC))
        last = current
    return found


def _stepped(net: FlatNetwork, run: RunSignals) -> np.ndarray:
    filters, now, made = np.zeros((len(net.form), 3)), np.zeros(len(net.form)), []
    for current, change, soc, direction, degC in _samples(run):
        _STEP_SIGNALS(net, filters, now, current, change, soc, direction, degC)
        made.append(now.copy())
    return np.array(made)


def _near(found: np.ndarray, wanted: np.ndarray, share: float, name: str) -> None:
    largest = max(float(np.abs(wanted).max()), 1e-3)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=share * largest, err_msg=name)
