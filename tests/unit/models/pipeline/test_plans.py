"""Plans: choices that are built, judged on outer folds, and built again from elsewhere."""

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.identification.bounded.variants import Variant
from models.identification.progress import silent
from models.network.free_run import free_run_V
from models.pipeline.fit import fit_network
from models.pipeline.plans import BoundedPlan, error_of
from models.pipeline.training import Training, training
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import CELL, fitted, run


@pytest.fixture(scope="module")
def data() -> Training:
    return training([run(2), run(4)], CELL.capacity_Ah, [SOC, SOC], 1.0, 1.0)


def test_errors_by_fold_leave_out_what_is_not_known() -> None:
    found = error_of(np.array([1.0, 2.0, np.nan, 4.0, np.nan]), np.array([0, 0, 0, 2, 1]))
    assert found.count.tolist() == [2.0, 0.0, 1.0]
    assert found.mse.tolist() == [2.5, 0.0, 16.0]
    assert found.rmse_V == pytest.approx(np.sqrt(21.0 / 3.0))


def test_a_bounded_plan_states_form_terms_and_what_was_left_out(data: Training) -> None:
    built = BoundedPlan(Variant(), ("hysteresis",)).build(data, silent)
    choices = built.network.record.choices
    assert choices is not None
    assert (choices["family"], choices["axis"], choices["without"]) == ("bounded", "soc", ["hysteresis"])
    terms = choices["terms"]
    assert [term["signal"] for term in terms] == [channel.signal for channel in built.network.structure.inputs]
    assert all(term["largest_V"] > 0.0 and "hysteresis" not in term["effects"] for term in terms)
    assert built.sums() is None


def test_largest_voltages_are_those_of_the_signals(data: Training) -> None:
    """Taking a term's input away changes the free run by no more than it says."""
    network = BoundedPlan(Variant()).build(data, silent).network
    choices, grid = network.record.choices, to_grid(run(2), 1.0)
    assert choices is not None
    whole = free_run_V(network, grid, SOC)
    rows = network.dataset([grid], [SOC])
    theta = network.partition.validity(rows.z) @ network.theta
    for column, term in enumerate(choices["terms"]):
        made_V = network.voltage_span_V * theta[:, column] * rows.u[:, column]
        assert np.abs(made_V).max() <= term["largest_V"] * (1.0 + 1e-6)
    assert np.isfinite(whole).all()


def test_a_fit_does_not_know_in_which_order_its_runs_were_named() -> None:
    options = {"capacity_Ah": CELL.capacity_Ah, "initial_soc": [SOC, SOC], "dt_s": 1.0, "structure": "bounded"}
    there, back = (fit_network([run(a), run(b)], **options) for a, b in ((2, 4), (4, 2)))
    np.testing.assert_array_equal(there.network.theta, back.network.theta)
    assert there.expected_rmse_mV == back.expected_rmse_mV
    assert there.train_runs == back.train_runs[::-1]


def test_outer_folds_see_every_sample_and_tell_a_worse_plan(data: Training) -> None:
    whole, bare = (BoundedPlan(Variant(), out).build(data, silent).held_out() for out in ((), ("hysteresis",)))
    assert whole.count.sum() == bare.count.sum() == 6000
    assert 1e-3 < whole.rmse_V < 1.3e-3 < 2.0 * whole.rmse_V < bare.rmse_V


def test_built_again_it_is_the_same(data: Training) -> None:
    plan = BoundedPlan(Variant())
    first, second = (plan.build(data, silent).network for _ in range(2))
    np.testing.assert_array_equal(first.theta, second.theta)


def test_a_fitted_bounded_network_lists_what_was_tried() -> None:
    record = fitted().network.record
    assert {each["family"] for each in record.candidates} == {"bounded"}
    assert record.choices is not None and record.sums is None
    assert record.choices["expected_rmse_mV"] == pytest.approx(fitted().expected_rmse_mV)
