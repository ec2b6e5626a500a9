"""What is remembered of training runs, and read again."""

import json
from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.diagnosis.evidence.memory import Memory, noise_mse, remember
from models.diagnosis.reference.samples import all_samples, choose_samples
from models.effects import effect
from tests.unit.models.diagnosis.hand_reference import RESISTANCE_OHM, SOC, reference, steps_A, sure_memory, true_run

EFFECTS = [effect(name) for name in ("series_resistance", "voltage_offset", "entropic_voltage", "heat_transfer")]


@pytest.fixture(scope="module")
def run() -> GridRun:
    return true_run(steps_A(2000), noise_V=1e-3)


@pytest.fixture(scope="module")
def memory(run: GridRun) -> Memory:
    return remember(reference(penalty=1.0), [run], [SOC], EFFECTS)


def test_only_effects_that_the_runs_can_show_are_remembered(memory: Memory) -> None:
    assert (memory.names, memory.sizes) == (("series_resistance", "voltage_offset"), (1, 1))
    p = len(memory.reference.coefficients)
    assert memory.information.shape == (p + 2, p + 2) and memory.right.shape == (p + 2,)
    assert memory.balance is None


def test_the_information_is_that_of_the_samples(memory: Memory, run: GridRun) -> None:
    """Sum of squared currents, of ones and of their products; the effects' own prior comes on top of the squares."""
    between = memory.information[-2, -1]
    assert between == pytest.approx(float(run.current_A.sum()), abs=1e-6)
    assert memory.information[-1, -1] > len(run)
    assert memory.information[-2, -2] > float(run.current_A @ run.current_A)


def test_the_own_error_is_the_noise_where_the_model_is_right(memory: Memory) -> None:
    assert memory.own_mse == pytest.approx(1e-6, rel=0.1)
    assert memory.noise_mse == pytest.approx(1e-6, rel=0.1)
    assert memory.noise_mse <= memory.own_mse


def test_a_model_that_is_off_has_an_error_of_its_own_and_lets_effects_be_at_work() -> None:
    rest = steps_A(2000)
    wrong = true_run(rest, added_V=0.004 * np.sin(np.arange(2000) / 30.0), noise_V=2e-4)
    model = reference(penalty=1.0)
    found = remember(model, [wrong], [SOC], EFFECTS)
    assert found.own_mse == pytest.approx(0.5 * 0.004**2, rel=0.2)
    assert found.noise_mse < 0.02 * found.own_mse
    right = remember(model, [true_run(rest, noise_V=2e-4)], [SOC], EFFECTS)
    # The better the model, the surer it is that no effect was at work.
    prior = [each.information[-1, -1] - 2000.0 for each in (right, found)]
    assert prior[0] > 5.0 * prior[1] > 0.0


def test_what_a_model_missed_of_its_own_runs_is_known_to_it() -> None:
    """The training runs had 3 mOhm that the coefficients, held where they are, do not have."""
    current = steps_A(2000)
    samples = choose_samples(reference(), [true_run(current, added_V=0.003 * current)], [SOC], 10_000)
    memory = remember(reference(penalty=1e3), [samples.views[0].run], [SOC], EFFECTS[:1])
    assert memory.moved(memory.part(EFFECTS[:1]))[-1] == pytest.approx(0.003, rel=0.1)


def test_places_follow_the_order_of_the_names(memory: Memory) -> None:
    p = len(memory.reference.coefficients)
    assert memory.part([]).tolist() == list(range(p))
    assert memory.part([effect("voltage_offset")]).tolist() == [*range(p), p + 1]
    assert memory.part([effect("voltage_offset"), effect("series_resistance")]).tolist() == list(range(p + 2))


def test_moved_coefficients_solve_the_normal_equations_of_their_part() -> None:
    samples = choose_samples(reference(), [true_run(steps_A(50))], [SOC], 100)
    plain = sure_memory(["series_resistance", "voltage_offset"], samples)
    p = len(plain.reference.coefficients)
    information, right = np.eye(p + 2), np.zeros(p + 2)
    information[-2:, -2:] = [[4.0, 1.0], [1.0, 9.0]]
    right[-2:] = [8.0, 37.0]
    memory = replace(plain, information=information, right=right)
    np.testing.assert_allclose(memory.moved(np.arange(p + 2))[-2:], [1.0, 4.0], rtol=1e-12)
    # Alone, the second is 37 / 9.
    assert memory.moved(memory.part([effect("voltage_offset")]))[-1] == pytest.approx(37.0 / 9.0)


def test_it_survives_as_json_to_nine_digits(memory: Memory) -> None:
    again = Memory.from_json(json.loads(json.dumps(memory.to_json(), allow_nan=False)))
    np.testing.assert_allclose(again.information, memory.information, rtol=1e-8, atol=1e-300)
    np.testing.assert_array_equal(again.right, memory.right)
    np.testing.assert_array_equal(again.reference.coefficients, memory.reference.coefficients)
    assert again.reference.layout == memory.reference.layout
    assert again.reference.domain == memory.reference.domain
    assert (again.names, again.sizes, again.balance) == (memory.names, memory.sizes, None)
    assert (again.own_mse, again.noise_mse) == (memory.own_mse, memory.noise_mse)


@pytest.mark.parametrize(
    "broken",
    [{"schema_version": 2}, {"right": [0.0]}, {"information": [1.0, 2.0]}, {"domain": {"soc": [0.1]}}, {"names": []}],
)
def test_another_version_or_a_damaged_one_is_refused(memory: Memory, broken: dict) -> None:
    with pytest.raises(ModelError, match="fit the model again"):
        Memory.from_json(memory.to_json() | broken)


def test_the_noise_is_the_middle_one_of_the_runs_and_a_tenth_more() -> None:
    runs = [true_run(np.zeros(40_000), noise_V=each, seed=k) for k, each in enumerate((1e-3, 2e-3, 8e-3))]
    assert noise_mse(all_samples(reference(), runs, [SOC] * 3, 100)) == pytest.approx(1.1 * 4e-6, rel=0.05)
    short = all_samples(reference(), [true_run(np.zeros(12))], [SOC], 100)
    assert noise_mse(short) == 0.0


def test_the_resistance_of_the_hand_made_model_is_in_no_effect(memory: Memory) -> None:
    assert abs(memory.moved(memory.part(EFFECTS[:1]))[-1]) < 0.05 * RESISTANCE_OHM
