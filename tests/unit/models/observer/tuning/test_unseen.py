from dataclasses import replace

import numpy as np

from models.data.resampling import to_grid
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.observer import FuzzyObserver
from models.observer.tuning.innovations import tuning_data
from models.observer.tuning.unseen import as_they_are, as_unseen
from models.readouts.ocv import ocv_table
from models.readouts.resistance import resistance_table
from models.uncertainty.bands import prediction_band
from models.uncertainty.correlation import ResidualCorrelation
from models.uncertainty.covariance import ParameterCovariance
from models.uncertainty.model_uncertainty import Uncertainty, uncertainty_of
from tests.unit.models import hand_network, synthetic


def test_models_are_drawn_as_wide_as_their_parameters_are_uncertain(fitted: FuzzyObserver) -> None:
    network, uncertainty = fitted.network, uncertainty_of(fitted.network)
    assert uncertainty is not None
    run = to_grid(synthetic.run(2000, seed=7, noise_V=1e-3), 1.0)
    band = prediction_band(network, run, 0.6, uncertainty)
    judged = as_unseen(network, [run] * 40, [0.6] * 40)
    away = np.array([free_run_V(each.network, run, 0.6) - band.voltage_V for each in judged])
    ratio = np.sqrt(np.mean(away**2) / np.mean(band.parameter_std_V**2))
    assert 0.7 < ratio < 1.4
    assert abs(np.mean(away)) < 0.4 * np.sqrt(np.mean(band.parameter_std_V**2))


def test_few_runs_are_seen_more_than_once_and_the_same_way_each_time(fitted: FuzzyObserver) -> None:
    run = to_grid(synthetic.run(500, seed=7, noise_V=1e-3), 1.0)
    first, again = (as_unseen(fitted.network, [run], [0.6]) for _ in range(2))
    assert len(first) == 8
    assert not np.array_equal(first[0].network.theta, first[1].network.theta)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.network.theta, other.network.theta)


def test_errors_of_unseen_runs_are_not_smaller_than_of_runs_that_were_fitted(fitted: FuzzyObserver) -> None:
    run = to_grid(synthetic.run(5000, seed=2, noise_V=1e-3), 1.0)
    seen = tuning_data(as_they_are(fitted.network, [run], [0.6]))
    unseen = tuning_data(as_unseen(fitted.network, [run], [0.6]))
    assert len(unseen.starts) == 8
    assert np.nanstd(unseen.error_V) > np.nanstd(seen.error_V)


def test_models_that_are_drawn_are_cells_that_can_be() -> None:
    structure = Structure(
        0, (InputChannel("soc", delay=1), InputChannel("current")), (PartitionAxis("soc", initial=3, k_sigma=0.4),), 1.0
    )
    known = hand_network.network(structure, np.array([[0.3, 0.02, 3.4]] * 3))
    away = 0.1 * np.random.default_rng(1).standard_normal((8, *known.theta.shape))
    assert not all(is_possible(replace(known, theta=known.theta + one)) for one in away)
    network = uncertain(known, 0.1 * np.eye(9))
    judged = as_unseen(network, [to_grid(synthetic.run(100, seed=7), 1.0)], [0.6])
    assert all(is_possible(each.network) for each in judged)
    assert not any(np.array_equal(each.network.theta, network.theta) for each in judged)


def test_models_that_are_drawn_keep_the_poles_that_they_share() -> None:
    axes = (PartitionAxis("soc", initial=3, k_sigma=0.4),)
    structure = Structure(2, (InputChannel("soc", delay=1), InputChannel("current")), axes, 1.0)
    known = hand_network.network(structure, np.array([[1.54, -0.56, 0.01, 0.002, 0.06]] * 3))
    # What is open of the static gain is open of the poles as well, as a fit would say it.
    factor = 0.02 * np.eye(15) + 0.01
    network = uncertain(known, factor)
    run = to_grid(synthetic.run(500, seed=7), 1.0)
    judged = as_unseen(network, [run], [0.6])
    for each in judged:
        np.testing.assert_allclose(each.network.theta[:, :2], known.theta[:, :2], rtol=0.0, atol=1e-12)
        assert not np.allclose(each.network.theta[:, 2:], known.theta[:, 2:])
    assert np.nanmax(np.abs(tuning_data(judged).error_V)) < 1e3


def uncertain(network: LocalModelNetwork, factor: np.ndarray) -> LocalModelNetwork:
    """The network with a factor of its parameters' covariance in its record."""
    n_models = network.n_models
    uncertainty = Uncertainty(
        parameters=ParameterCovariance(factor, 0, n_models, network.structure.output_order, np.ones(n_models)),
        level_V=np.full(n_models, 1e-3),
        samples=np.full(n_models, 100.0),
        effective_samples=np.full(n_models, 100.0),
        thin=np.zeros(n_models, bool),
        band_factor=1.0,
        correlation=ResidualCorrelation(1.0, np.zeros(0), np.zeros(0)),
    )
    return replace(network, record=replace(network.record, uncertainty=uncertainty.to_json()))


def is_possible(network: LocalModelNetwork) -> bool:
    rises = bool((np.diff(ocv_table(network).voltage_V, axis=-1) >= 0.0).all())
    return rises and bool((resistance_table(network).resistance_Ohm > 0.0).all())


def test_without_a_covariance_the_model_stays_as_it_is(fitted: FuzzyObserver) -> None:
    run = to_grid(synthetic.run(500, seed=7, noise_V=1e-3), 1.0)
    bare = replace(fitted.network, record=ModelRecord())
    assert [each.network for each in as_unseen(bare, [run], [0.6])] == [bare]
