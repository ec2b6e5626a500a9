"""The adjoint gradient against references that share no code with it."""

import time

import numpy as np
import pytest

from models.design.information.criteria import CRITERIA
from models.design.information.experiment import SENSITIVITIES, Evaluator, Experiment
from models.network.free_run import free_run_V
from models.network.partition import initial_partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.design import reference
from tests.unit.models.hand_network import CELL, everything, grid_run, hats, network

NOISE_V = 5e-3
# Strong enough that some dozen samples leave no direction without information, weak enough that they still count.
PRIOR_STD = 0.05


def small(order: int, kernel: str = "gaussian"):
    """Two inputs beside the SoC, three local models along the SoC, through which a minute's current moves the cell."""
    inputs = (InputChannel("soc", delay=1), InputChannel("current", order=1), InputChannel("relaxation:300"))
    axes = (PartitionAxis("soc", initial=3, k_sigma=0.5),)
    poles = {0: [], 1: [0.8], 2: [1.1, -0.3]}[order]
    rows = []
    for i in range(3):
        stationary = 1.0 - sum(poles)
        gains = np.array([0.4 + 0.1 * i, 0.02, 0.01 + 0.002 * i, 0.008, 3.3 + 0.02 * i])
        rows.append([*poles, *(stationary * gains)])
    return network(Structure(order, inputs, axes, 60.0, kernel), np.array(rows))


def excitation(n: int, seed: int = 3) -> np.ndarray:
    # No sample within reach of 0: there the sign, and with it the hysteresis, has no derivative.
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], n) * rng.uniform(0.5, 4.0, n)


def relative(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.abs(found - wanted).max() / np.abs(wanted).max())


@pytest.mark.parametrize("sensitivity", SENSITIVITIES)
@pytest.mark.parametrize("criterion", sorted(CRITERIA))
@pytest.mark.parametrize("order", [0, 1, 2])
def test_against_the_complex_step(order: int, criterion: str, sensitivity: str) -> None:
    net = small(order)
    # Uneven, so that the smallest eigenvalue is a simple one that the data move.
    prior = np.diag(np.linspace(1.0, 10.0, net.theta.size)) / PRIOR_STD**2
    experiment = Experiment(net, 0.5, NOISE_V, 25.0, sensitivity, prior)
    current = excitation(40)
    value, gradient = Evaluator(experiment, 40, criterion).value_and_gradient(current)
    plain = reference.information(experiment, current)
    assert value == pytest.approx(float(np.real(reference.criterion(criterion, plain))), rel=1e-9)
    assert relative(gradient, reference.complex_step_gradient(experiment, criterion, current)) < 1e-8


@pytest.mark.parametrize("kernel", ["gaussian", "triangular"])
@pytest.mark.parametrize("order", [0, 1, 2])
def test_every_signal_against_the_complex_step(order: int, kernel: str) -> None:
    experiment = Experiment(everything(order, kernel), 0.5, 0.05, 24.0, prior_std=PRIOR_STD)
    current = excitation(20)
    _, gradient = Evaluator(experiment, 20).value_and_gradient(current)
    assert relative(gradient, reference.complex_step_gradient(experiment, "D", current)) < 1e-8


@pytest.mark.parametrize("sensitivity", SENSITIVITIES)
@pytest.mark.parametrize("order", [1, 2])
def test_against_central_differences(order: int, sensitivity: str) -> None:
    experiment = Experiment(small(order), 0.5, NOISE_V, 25.0, sensitivity, prior_std=PRIOR_STD)
    current, step = excitation(50), 1e-4
    evaluator = Evaluator(experiment, 50)
    _, gradient = evaluator.value_and_gradient(current)
    moved = [evaluator.value(current + step * e) - evaluator.value(current - step * e) for e in np.eye(50)]
    assert relative(gradient, np.array(moved) / (2.0 * step)) < 1e-5


def methods_recursion(experiment: Experiment, current: np.ndarray) -> np.ndarray:
    """Gradient of log det as the method writes it (eq. 2.17 to 2.22): each input's effect carried forward.

    Only the direct current terms are kept, as in eq. 2.19, with the validity functions as they are.
    """
    net, lead = experiment.network, experiment.lead
    order, taps = net.structure.output_order, net.structure.taps()
    psi, y = reference.sensitivities(experiment, current)
    n, p, n_models = len(y), net.structure.n_regressors, net.n_models
    run = grid_run(np.concatenate([np.zeros(lead), current]), experiment.temperature_degC)
    validity = net.partition.validity(net.dataset([run], [experiment.initial_soc]).z)
    blended = validity @ net.theta
    span = net.scaling["current"][1] - net.scaling["current"][0]
    variance = (experiment.noise_V / net.voltage_span_V) ** 2
    by_psi = 2.0 * psi @ np.linalg.inv(reference.information(experiment, current)) / variance
    gradient = np.empty(len(current))
    for r in range(lead, n):
        by_y = np.zeros(n)
        total = 0.0
        for k in range(max(r, order), n):
            by_phi = np.zeros(p)
            by_phi[:order] = [by_y[k - 1 - j] for j in range(order)]
            for t, (signal, lag) in enumerate(taps):
                by_phi[order + t] = 1.0 / span if signal == "current" and k - lag == r else 0.0
            by_y[k] = blended[k] @ by_phi
            total += by_psi[k] @ np.outer(validity[k], by_phi).reshape(n_models * p)
        gradient[r - lead] = total
    return gradient


@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_methods_recursion_is_the_part_that_the_current_has_directly(order: int) -> None:
    inputs = (InputChannel("current", order=1),)
    axes = (PartitionAxis("soc", initial=2, k_sigma=0.5),)
    poles = {0: [], 1: [0.8], 2: [1.1, -0.3]}[order]
    rows = np.array([[*poles, 0.02, 0.01, 0.7], [*poles, 0.03, 0.01, 0.7]])
    experiment = Experiment(
        network(Structure(order, inputs, axes, 1.0), rows), 0.5, NOISE_V, 25.0, "one_step", prior_std=PRIOR_STD
    )
    current = excitation(40)
    _, full = Evaluator(experiment, 40).value_and_gradient(current)
    exact = reference.complex_step_gradient(experiment, "D", current)
    assert relative(full, exact) < 1e-8
    # What eq. 2.19 leaves out is the way through the SoC in the validity functions.
    direct = methods_recursion(experiment, current)
    huge = Experiment(
        network(Structure(order, inputs, axes, 1.0), rows, initial_partition(axes), None),
        0.5,
        NOISE_V,
        25.0,
        "one_step",
        prior_std=PRIOR_STD,
    )
    object.__setattr__(huge.network, "cell", type(CELL)(1e9))
    _, without = Evaluator(huge, 40).value_and_gradient(current)
    assert relative(without, methods_recursion(huge, current)) < 1e-7
    assert relative(full, direct) > 1e-4


@pytest.mark.parametrize("criterion", sorted(CRITERIA))
@pytest.mark.parametrize("axis", ["soc", "surface_soc:0.05/400/3500", "surface_soc:0.05/400/3500/30"])
def test_hats_against_the_complex_step(axis: str, criterion: str) -> None:
    net = hats(axis)
    rng = np.random.default_rng(4)
    # What is known hangs together over the local models, those too that the current does not reach.
    mixed = rng.standard_normal((net.theta.size, net.theta.size)) / np.sqrt(net.theta.size)
    prior = (np.diag(np.linspace(1.0, 10.0, net.theta.size)) + mixed @ mixed.T) / PRIOR_STD**2
    experiment = Experiment(net, 0.3, NOISE_V, 25.0, "free_run", prior)
    # Large enough to cross knots, and to reach beyond the first one.
    current = np.concatenate([10.0 * excitation(30), np.full(10, -200.0)])
    evaluator = Evaluator(experiment, len(current), criterion)
    value, gradient = evaluator.value_and_gradient(current)
    plain = reference.information(experiment, current)
    assert value == pytest.approx(float(np.real(reference.criterion(criterion, plain))), rel=1e-9)
    assert relative(gradient, reference.complex_step_gradient(experiment, criterion, current)) < 1e-8
    np.testing.assert_allclose(evaluator.information(current), plain, rtol=1e-9, atol=1e-9 * np.abs(plain).max())
    predicted, (psi, _) = evaluator.predict(current), reference.sensitivities(experiment, current)
    np.testing.assert_allclose(predicted.sensitivity_V, net.voltage_span_V * psi[experiment.lead :], atol=1e-12)


def test_hats_know_nothing_beforehand_but_the_size_of_parameters() -> None:
    experiment = Experiment(hats(), 0.3, NOISE_V, 25.0, prior_std=PRIOR_STD)
    current = 10.0 * excitation(40)
    value, gradient = Evaluator(experiment, 40).value_and_gradient(current)
    plain = reference.information(experiment, current)
    assert value == pytest.approx(float(np.real(reference.criterion("D", plain))), rel=1e-9)
    assert relative(gradient, reference.complex_step_gradient(experiment, "D", current)) < 1e-8


def test_hats_give_the_derivative_of_a_function_of_voltage_and_sensitivities() -> None:
    experiment = Experiment(hats(), 0.3, NOISE_V, 25.0)
    current, rng = 10.0 * excitation(30), np.random.default_rng(5)
    by_voltage, by_sensitivity = rng.standard_normal(30), rng.standard_normal((30, experiment.network.theta.size))
    evaluator = Evaluator(experiment, 30)
    gradient = evaluator.voltage_gradient(current, by_voltage, by_sensitivity)
    wanted = np.empty(30)
    for k in range(30):
        moved = current.astype(complex)
        moved[k] += 1e-25j
        psi, y = reference.sensitivities(experiment, moved)
        lead = experiment.lead
        wanted[k] = (by_voltage @ y[lead:].imag + np.sum(by_sensitivity * psi[lead:].imag)) / 1e-25
    assert relative(gradient, wanted * experiment.network.voltage_span_V) < 1e-8


def test_the_prediction_is_the_networks_free_run() -> None:
    for order in (0, 1, 2):
        experiment = Experiment(everything(order), 0.4, NOISE_V, 24.0)
        current = excitation(200)
        run = grid_run(np.concatenate([np.zeros(experiment.lead), current]), 24.0)
        predicted = Evaluator(experiment, 200).predict(current)
        np.testing.assert_allclose(
            predicted.voltage_V, free_run_V(experiment.network, run, 0.4)[experiment.lead :], atol=1e-12
        )


def test_the_voltages_gradient_against_the_complex_step() -> None:
    experiment = Experiment(everything(2), 0.5, NOISE_V, 24.0)
    current, weight = excitation(30), np.random.default_rng(0).standard_normal(30)
    gradient = Evaluator(experiment, 30).voltage_gradient(current, weight)
    wanted = np.empty(30)
    for k in range(30):
        moved = current.astype(complex)
        moved[k] += 1e-25j
        wanted[k] = weight @ reference.sensitivities(experiment, moved)[1][experiment.lead :].imag / 1e-25
    assert relative(gradient, wanted * experiment.network.voltage_span_V) < 1e-9


def test_work_grows_with_the_number_of_samples_only() -> None:
    """Processor time per sample, least of several, with a wide margin: what must not appear is a quadratic term."""
    experiment = Experiment(small(1), 0.5, NOISE_V)
    per_sample = []
    for n in (1000, 10_000, 100_000):
        evaluator, current = Evaluator(experiment, n), 0.2 * excitation(n)
        evaluator.value_and_gradient(current)
        times = []
        for _ in range(3):
            began = time.process_time()
            evaluator.value_and_gradient(current)
            times.append(time.process_time() - began)
        per_sample.append(min(times) / n)
    assert per_sample[2] < 10.0 * per_sample[0]
