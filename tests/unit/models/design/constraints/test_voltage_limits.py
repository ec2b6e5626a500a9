"""Bands, limitation ratios and the reference model that they come from."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from models.design.constraints.limitation import LimitationRatio, default_ratio, limitation_ratio
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.constraints.voltage_band import LearntBand, Tail, VoltageBand, colder_V, planned_run, recorded_band
from models.design.information.experiment import Evaluator
from models.design.optimise.reference_model import (
    experiment_with,
    first_reference,
    known_information,
    pre_test,
    predicted_temperature,
)
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from models.uncertainty.correlation import ResidualCorrelation
from models.uncertainty.model_uncertainty import uncertainty_of
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.models.design.networks import experiment, resistive
from tests.unit.models.hand_network import network
from tests.unit.models.simulated_cells import AMBIENT_DEGC, pulses_A, record


@pytest.fixture(scope="module")
def fitted() -> LocalModelNetwork:
    parameters = CELLS["nmc"].parameters
    current = pulses_A(6000, parameters.capacity_Ah, 1)
    run = record(Cell(parameters, 0.6, AMBIENT_DEGC), current, 1)
    structure = Structure(
        1,
        (InputChannel("soc", delay=1), InputChannel("current", order=1)),
        (PartitionAxis("soc", initial=3, splittable=False),),
        1.0,
    )
    return fit_network([run], capacity_Ah=parameters.capacity_Ah, structure=structure, dt_s=1.0).network


def test_the_band_of_the_parameters_holds_for_all_samples_at_once() -> None:
    """Scheffe: of parameters drawn from their distribution, 99.7 % keep every sample inside."""
    where, rng = experiment(), np.random.default_rng(0)
    current = rng.uniform(-4.0, 4.0, 60)
    information = Evaluator(where, 60).information(current)
    predicted = Evaluator(where, 60).predict(current)
    width = VoltageBand(0.0, information).width_V(where, current, predicted)
    draws = np.linalg.solve(np.linalg.cholesky(information).T, rng.standard_normal((15, 4000)))
    outside = (np.abs(predicted.sensitivity_V @ draws) > width[:, None]).any(axis=0)
    assert outside.mean() < 0.003
    # Not by being far too wide: the formula's own scale, nothing on top.
    spread = np.sqrt(
        np.einsum("kp,pk->k", predicted.sensitivity_V, np.linalg.solve(information, predicted.sensitivity_V.T))
    )
    np.testing.assert_allclose(width, np.sqrt(chi2.ppf(0.997, 15)) * spread, rtol=1e-6)


@pytest.mark.parametrize("seed", [7, 21, 22, 23])
def test_a_fitted_network_says_itself_how_far_off_it_may_be(fitted: LocalModelNetwork, seed: int) -> None:
    band, where = recorded_band(fitted), experiment_with(fitted, 0.6)
    assert isinstance(band, LearntBand)
    current = pulses_A(3000, fitted.cell.capacity_Ah, seed)
    evaluator = Evaluator(where, 3000)
    width = band.width_V(where, current, evaluator.predict(current))
    played = np.concatenate([[0.0], current])
    truth = Cell(CELLS["nmc"].parameters, 0.6, AMBIENT_DEGC)
    voltage = np.array([truth.step(float(i), 1.0).voltage_V for i in played[1:]])
    assert (np.abs(voltage - evaluator.predict(current).voltage_V) <= width).all()
    # Further from the trained data it knows less.
    hard = 3.0 * current
    assert band.width_V(where, hard, evaluator.predict(hard)).max() > 1.5 * width.max()


def test_the_scale_of_a_band_follows_the_number_of_draws(fitted: LocalModelNetwork) -> None:
    uncertainty = uncertainty_of(fitted)
    assert uncertainty is not None
    white = replace(uncertainty, correlation=ResidualCorrelation(1.0, np.zeros(0), np.zeros(0)))
    assert LearntBand(white).scale(4000) == pytest.approx(np.log(4000.0 / 0.003) / np.sqrt(2.0), rel=1e-9)
    draws = np.random.default_rng(0).laplace(scale=np.sqrt(0.5), size=(4000, 1000))
    assert (np.abs(draws) > LearntBand(white).scale(1000)).any(axis=1).mean() < 0.006
    # Slow errors draw less often.
    assert LearntBand(uncertainty).scale(4000) < LearntBand(white).scale(4000)
    # A run that is as Laplace would have it changes nothing; one with a shorter tail does, with room for good luck.
    laplace, bounded = Tail(2.12, 8.0, 4000), Tail(1.9, 2.6, 4000)
    assert LearntBand(white, laplace).scale(4000) == pytest.approx(LearntBand(white).scale(4000), abs=0.01)
    assert 1.2 * 2.6 < LearntBand(white, bounded).scale(4000) < 5.0
    assert LearntBand(white, Tail(2.0, 20.0, 4000)).scale(4000) == 20.0


def test_a_network_without_record_is_taken_at_its_word() -> None:
    band = recorded_band(replace(resistive(), record=ModelRecord(train={"max_mV": 10.0, "rmse_mV": 2.0})))
    assert isinstance(band, VoltageBand) and band.error_V == pytest.approx(0.014)


def test_the_planned_run_is_what_the_design_predicts(fitted: LocalModelNetwork) -> None:
    where = experiment_with(fitted, 0.6)
    current = pulses_A(500, fitted.cell.capacity_Ah, 3)
    voltage = free_run_V(fitted, planned_run(where, current), 0.6)
    np.testing.assert_allclose(voltage[where.lead :], Evaluator(where, 500).predict(current).voltage_V, atol=1e-12)


def test_a_cell_that_may_be_colder_than_the_training_runs_middle_has_room_for_it() -> None:
    signals = (InputChannel("soc"), InputChannel("scaled_current:2500"))
    plain = Structure(0, signals, (PartitionAxis("soc", initial=2, splittable=False),), 1.0)
    made = network(plain, np.tile([0.5, 0.02, 3.3], (2, 1)))
    made = replace(made, record=ModelRecord(domain={"temperature_degC": (25.0, 31.0)}))
    unknown, stated = experiment_with(made, 0.5), experiment_with(made, 0.5, temperature_degC=28.0)
    current = np.array([0.0, 4.0, -4.0])
    expected = Evaluator(unknown, 3).predict(current)
    # Arrhenius between 28 and 25 degC, of 20 mOhm.
    grown = np.exp(2500.0 * (1.0 / 298.15 - 1.0 / 301.15)) - 1.0
    share = (expected.voltage_V[1] - expected.voltage_V[2]) / 8.0
    width = colder_V(unknown, current, expected)
    np.testing.assert_allclose(width, np.abs(current) * grown * share, rtol=0.05, atol=1e-6)
    np.testing.assert_array_equal(colder_V(stated, current, expected), 0.0)


def test_what_the_training_runs_told_is_known_already(fitted: LocalModelNetwork) -> None:
    information = known_information(fitted)
    uncertainty = uncertainty_of(fitted)
    assert information is not None and uncertainty is not None
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    np.testing.assert_allclose(std, np.sqrt(np.diag(uncertainty.parameters.covariance)), rtol=0.05)
    assert known_information(resistive()) is None
    with_prior, without = (experiment_with(fitted, 0.6, use_prior=use) for use in (True, False))
    current = pulses_A(500, fitted.cell.capacity_Ah, 3)
    assert Evaluator(with_prior, 500).value(current) > Evaluator(without, 500).value(current)


def test_the_ratio_falls_where_the_voltage_leaves_no_room() -> None:
    limits = Limits((-6.0, 6.0), (0.1, 0.9), voltage_V=(3.2, 3.8))
    found = limitation_ratio(experiment(), limits, VoltageBand(5e-3), 200.0)
    # 3.3 V + 0.5 V SoC: rest at 3.35..3.75 V; 0.12 Ohm once the current has lasted.
    assert 0.5 < found.charge[0] < 0.6 and 0.0 < found.charge[-1] < 0.1
    assert 0.6 < found.discharge[-1] < 0.75 and 0.0 < found.discharge[0] < 0.25
    for soc, share in zip(found.soc, found.charge, strict=True):
        where = experiment(initial_soc=float(soc))
        end = Evaluator(where, 20).predict(np.full(20, 6.0 * share)).voltage_V.max()
        assert end + 5e-3 <= 3.8 + 1e-3
    open_window = limitation_ratio(experiment(), Limits((-6.0, 6.0)), VoltageBand(5e-3), 200.0)
    assert open_window.least(1.0, 0.0, 1.0) == 1.0


def test_the_least_ratio_on_the_way() -> None:
    ratio = LimitationRatio(np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 1.0]), np.array([1.0, 0.4, 1.0]))
    assert ratio.least(1.0, 0.2, 0.9) == pytest.approx(0.4)
    assert ratio.least(-1.0, 0.9, 0.25) == pytest.approx(0.5)
    edge = default_ratio((0.1, 0.9))
    assert edge.least(-1.0, 0.1, 0.5) == 0.0 and edge.least(1.0, 0.1, 0.5) == 1.0


def test_the_first_reference_is_one_local_model() -> None:
    parameters = CELLS["nmc"].parameters
    run = record(Cell(parameters, 0.6, AMBIENT_DEGC), pulses_A(2000, parameters.capacity_Ah, 1), 1)
    network = first_reference([run], parameters.capacity_Ah, 1.0)
    assert network.n_models == 1 and network.structure.output_order == 1
    assert recorded_band(network) is not None


def test_a_pre_test_names_what_stands_against_it() -> None:
    with pytest.raises(InfeasibleError, match="pre-test: .* do not suffice"):
        pre_test(Limits((-4.0, 2.0), (0.1, 0.9)), 2.0, 0.5, 600.0, 1.0, 0)
    profile = pre_test(Limits((-4.0, 2.0), (0.1, 0.9)), 2.0, 0.5, 14_000.0, 1.0, 0)
    assert profile.current_A.min() >= -4.0 and profile.current_A.max() <= 2.0


def test_temperature_is_predicted_where_a_thermal_model_is_known(fitted: LocalModelNetwork) -> None:
    temperature_of = predicted_temperature(fitted, 0.6, AMBIENT_DEGC)
    assert temperature_of is not None
    mild, hard = (temperature_of(np.tile([a, -a], 300)).max() for a in (1.0, 5.0))
    assert AMBIENT_DEGC < mild < hard < 80.0
    assert predicted_temperature(resistive(), 0.5, 25.0) is None
