"""Sizes of effects beside a network that is poor in more than one way."""

import numpy as np
import pytest

from models.diagnosis.evidence.candidates import Comparison, try_effect
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.evidence.ranking import rank
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.reference.samples import all_samples
from models.effects import effect
from models.network.signals.direction import hysteresis_state
from models.network.signals.filters import low_pass
from tests.unit.models.diagnosis.hand_reference import SOC, reference, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

CURRENT_A = steps_A(4000, largest_A=4.0, length=100)
LOOP_V = 0.010 * hysteresis_state(CURRENT_A, 45.0, 1.0, CAPACITY_AH)
SLOW_V = 0.015 * low_pass(CURRENT_A, 300.0, 1.0)


def network_comparison(added_V: np.ndarray, left_V: np.ndarray, name: str) -> Comparison:
    """A network that leaves `left_V` of a cell with `added_V`, and has nothing to take it in with."""
    run = true_run(CURRENT_A, added_V=added_V, noise_V=2e-4)
    samples = all_samples(reference(penalty=1e-9), [run], [SOC], 10_000)
    evidence = Evidence(left_V, np.ones((len(run), 1)), np.eye(1), samples.blocks)
    columns = {name: samples.regressors(effect(name))}
    return Comparison(samples, (effect(name),), columns, evidence, 4e-8, 4e-8)


def sizes(comparison: Comparison, name: str) -> tuple[dict[str, Value], dict[str, Value]]:
    """As the network alone shows an effect, and as it is read."""
    candidate = try_effect(comparison, effect(name))
    named = Named(comparison, rank(comparison, [candidate]))
    return parameters(comparison, candidate), Readings((named,)).parameters(named, candidate)


def test_a_loop_is_not_bent_to_serve_a_relaxation_that_is_missing_too() -> None:
    both_V = LOOP_V + SLOW_V
    bent, read = sizes(network_comparison(both_V, both_V, "hysteresis"), "hysteresis")
    assert abs(bent["amplitude_V"].value - 0.010) > 0.003
    assert read["amplitude_V"].value == pytest.approx(0.010, rel=0.1)
    assert read["rate"].value == pytest.approx(45.0, rel=0.2)


def test_a_network_that_lacks_nothing_else_is_believed() -> None:
    noise_V = 2e-4 * np.random.default_rng(0).standard_normal(len(CURRENT_A))
    own, read = sizes(network_comparison(LOOP_V, LOOP_V + noise_V, "hysteresis"), "hysteresis")
    assert read == own
    assert own["amplitude_V"].value == pytest.approx(0.010, rel=0.02)


def test_a_curve_is_always_the_networks() -> None:
    both_V = SLOW_V + 0.004 * CURRENT_A
    own, read = sizes(network_comparison(both_V, both_V, "soc_dependence"), "soc_dependence")
    assert read == own
