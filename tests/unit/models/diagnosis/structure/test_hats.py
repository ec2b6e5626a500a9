"""What a network by hats lacks, and what it may be wrong by."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError, StructureError
from models.data.timeseries import TimeSeries
from models.diagnosis.diagnosis import diagnose
from models.diagnosis.structure.sensitivities import directions_V, sensitivities_V
from models.effects import effect
from models.identification.lolimot import grow_partitions
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.addition import add_effect
from models.pipeline.refitting import refit
from tests.unit.models.hand_network import SCALING, grid_run, hats

LACKING = "hysteresis_state:40"


def without(network: LocalModelNetwork, signal: str) -> LocalModelNetwork:
    """The same network with one input held at 0."""
    taps = [name for name, _ in network.structure.taps()]
    inputs = tuple(channel for channel in network.structure.inputs if channel.signal != signal)
    at, (low, high) = taps.index(signal), SCALING[signal]
    theta = np.delete(network.theta, at, axis=1)
    theta[:, -1] -= network.theta[:, at] * low / (high - low)
    scaling = {name: bounds for name, bounds in network.scaling.items() if name != signal}
    return replace(network, structure=replace(network.structure, inputs=inputs), theta=theta, scaling=scaling)


def measured(network: LocalModelNetwork, seed: int, n: int = 6000) -> TimeSeries:
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(-5.0, 4.0, n // 60), 60)
    current[::600] = 0.0
    current -= current.mean() + 0.3
    run = grid_run(current, 20.0 + 8.0 * np.sin(np.arange(n) / 1200.0 + seed))
    voltage = free_run_V(network, run, 0.6) + 1e-3 * rng.standard_normal(n)
    return TimeSeries(run.time_s, current, voltage, run.temperature_degC, name=f"run {seed}")


def test_an_effect_that_it_lacks_is_named() -> None:
    whole = hats()
    train, run = [measured(whole, 1), measured(whole, 2)], measured(whole, 3)
    found = diagnose(without(whole, LACKING), [run], [0.6], train=train, train_soc=[0.6, 0.6], mode="structure")
    assert found.verdict == "missing"
    assert [each.effect for each in found.findings] == ["hysteresis"]
    assert found.unexplained_mV < 2.0
    known = diagnose(whole, [run], [0.6], train=train, train_soc=[0.6, 0.6], mode="structure")
    assert known.verdict == "nothing_missing"


def test_many_hats_may_be_wrong_in_straight_lines_between_some_of_their_knots() -> None:
    network = hats("soc", np.linspace(0.01, 0.99, 100))
    run, index = grid_run(np.repeat([4.0, -5.0, 3.0], 700), 20.0), np.arange(3, 2100, 7)
    directions = directions_V(network, run, 0.5, index)
    n_inputs = len(network.structure.inputs)
    assert directions.shape == (len(index), 10 * n_inputs + 100)
    # All of them are changes that the parameters can make.
    exact = sensitivities_V(network, run, 0.5, index)
    fitted, *_ = np.linalg.lstsq(exact, directions, rcond=None)
    np.testing.assert_allclose(exact @ fitted, directions, atol=1e-9 * np.abs(directions).max())
    # And they hold what changes all local models alike.
    alike = exact.reshape(len(index), 100, -1).sum(axis=1)
    fitted, *_ = np.linalg.lstsq(directions, alike, rcond=None)
    np.testing.assert_allclose(directions @ fitted, alike, atol=1e-9 * np.abs(alike).max())
    few = hats()
    np.testing.assert_array_equal(directions_V(few, run, 0.5, index), sensitivities_V(few, run, 0.5, index))


def test_what_would_break_their_bounds_is_refused_with_a_way_out() -> None:
    network = hats()
    run = measured(network, 4, 600)
    with pytest.raises(ModelError, match="fit the structure anew"):
        refit(network, [run], initial_soc=[0.6])
    with pytest.raises(ModelError, match="fit it anew to its runs"):
        add_effect(network, "relaxation", [run], [0.6], [run], [0.6])
    data = network.dataset([grid_run(run.current_A, 20.0)], [0.6])
    with pytest.raises(StructureError, match="not grown by splitting"):
        list(grow_partitions(network.structure, data.u, np.zeros(len(data)), data.z, 4))


def test_hats_depend_on_the_state_of_charge_already() -> None:
    structure = hats().structure
    extend = effect("soc_dependence").extend
    assert extend is not None
    assert extend(structure, {}, 2.0) == structure
