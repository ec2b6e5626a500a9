"""Coarse copies of networks by hats, that experiments ask about instead of all their parameters."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from models.design.constraints.limits import Limits
from models.design.design import design
from models.design.information.coarse_network import coarse_copy
from models.design.information.experiment import Evaluator
from models.design.optimise.block_design import DesignRequest
from models.design.optimise.reference_model import experiment_with
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.partition import hat_partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.uncertainty.correlation import ResidualCorrelation
from models.uncertainty.covariance import ParameterCovariance
from models.uncertainty.expansion import Expansion
from models.uncertainty.model_uncertainty import Uncertainty
from tests.unit.models.hand_network import SCALING, hats, network

KNOTS = np.concatenate([[-0.5], np.linspace(0.0, 1.0, 41), [1.5]])
GAINS = (1, 11, 21, 31, 41)
SIGNALS = ("current", "low_pass:30", "scaled_current:2500", "hysteresis_state:40")


def bounded() -> LocalModelNetwork:
    """43 knots, gains free at 5 of them; the third does nothing, the voltage rises from 3.4 to 4.0 V."""
    structure = Structure(
        0, tuple(InputChannel(name) for name in SIGNALS), (PartitionAxis("soc"),), 1.0, kernel="hat", name="bounded"
    )
    scaling = SCALING | {"soc": (0.0, 1.0)}
    rows = np.column_stack([np.tile([0.02, 0.01, 0.0, 0.004], (43, 1)), 3.4 + 0.6 * KNOTS])
    made = network(structure, rows, hat_partition(KNOTS), scaling)
    expansion = Expansion(KNOTS, (GAINS, GAINS, GAINS, GAINS, tuple(range(1, 42))))
    factor = np.diag(np.linspace(1e-3, 3e-3, expansion.size))
    uncertainty = Uncertainty(
        ParameterCovariance(factor, 0, 43, 0, np.ones(43), expansion),
        np.full(43, 1e-3),
        np.full(43, 100.0),
        np.full(43, 50.0),
        np.zeros(43, dtype=bool),
        1.0,
        ResidualCorrelation(1.0, np.zeros(0), np.zeros(0)),
    )
    figures: Any = {"rmse_mV": 1.0, "max_mV": 4.0, "p95_mV": 2.0, "n_samples": 5000}
    return replace(made, record=ModelRecord(train=figures, uncertainty=uncertainty.to_json()))


def test_it_has_the_knots_of_the_gains_and_the_terms_that_do_something() -> None:
    whole = bounded()
    coarse, covariance = coarse_copy(whole)
    assert [channel.signal for channel in coarse.structure.inputs] == [SIGNALS[0], SIGNALS[1], SIGNALS[3]]
    np.testing.assert_allclose(coarse.partition.centres[:, 0], KNOTS[[0, *GAINS, 42]])
    np.testing.assert_allclose(coarse.theta[:, -1], whole.theta[[0, *GAINS, 42], -1])
    assert covariance is not None and covariance.shape == (coarse.theta.size, coarse.theta.size)
    # Of the first gain at its second knot, which nothing else has a part in.
    assert np.sqrt(covariance[8, 8]) == pytest.approx(1e-3 + 2e-3 / 60.0, rel=1e-6)


def test_small_networks_stay_as_they_are() -> None:
    small = hats()
    assert coarse_copy(small) == (small, None)
    assert experiment_with(small, 0.5).predictor is None


def test_without_a_record_every_fourth_knot_is_taken() -> None:
    whole = replace(bounded(), record=ModelRecord())
    coarse, covariance = coarse_copy(whole)
    assert covariance is None
    np.testing.assert_allclose(coarse.partition.centres[1:-1, 0], np.linspace(0.0, 1.0, 11))


def test_the_network_itself_predicts_the_voltage() -> None:
    whole, request = bounded(), DesignRequest(Limits((-4.0, 4.0), (0.3, 0.7), voltage_V=(3.4, 3.9)), 300.0, n_starts=3)
    experiment = experiment_with(whole, 0.5)
    assert experiment.predictor is whole and experiment.predicted.network is whole
    found = design(experiment, request)
    assert found.information.shape == experiment.prior_information().shape
    assert list(found.parameter_std)[4:6] == ["SoC 0.000: current(k-0)", "SoC 0.000: low_pass:30(k-0)"]
    alone = Evaluator(experiment_with(whole, 0.5, coarse=False), 300).predict(found.current_A)
    np.testing.assert_allclose(found.voltage_V, alone.voltage_V)
    assert found.band_low_V.min() >= 3.4 - 1e-9 and found.band_high_V.max() <= 3.9 + 1e-9
