import numpy as np
import pytest

from models.design.constraints.limits import Limits
from models.design.design import design
from models.design.information.experiment import Evaluator
from models.design.information.parameters import parameter_std
from models.design.optimise.block_design import DesignRequest
from models.design.overview import coverage, family_std, mean_std, mean_std_over_time
from tests.unit.models.design.networks import experiment

LIMITS = Limits((-6.0, 4.0), (0.1, 0.9))


def test_what_is_known_over_time_begins_with_the_prior_and_ends_with_the_test() -> None:
    where, current = experiment(), np.random.default_rng(0).uniform(-4.0, 4.0, 300)
    time_s, std = mean_std_over_time(where, current)
    assert time_s[0] == 0.0 and time_s[-1] == 300 * where.network.structure.dt_s
    assert std[0] == pytest.approx(float(np.exp(np.log(parameter_std(where.prior_information())).mean())))
    assert std[-1] == pytest.approx(mean_std(Evaluator(where, 300).information(current)), rel=1e-6)
    assert (np.diff(std) <= 1e-12).all()


def test_all_families_are_judged_and_one_that_cannot_be_had_is_none() -> None:
    request = DesignRequest(LIMITS, 6000.0, n_starts=1)
    found = family_std(experiment(), request)
    assert found["drive_cycle"] is None and {"aprbs", "prbs", "hppc"} <= set(found)
    assert found["aprbs"] == pytest.approx(
        mean_std(design(experiment(), DesignRequest(LIMITS, 6000.0, signal="aprbs")).information)
    )


def test_coverage_adds_up_and_finds_its_place() -> None:
    soc, current = np.full(10, 0.5), np.concatenate([np.full(4, -6.0), np.full(6, 4.0)])
    share, soc_edges, current_edges = coverage(soc, current, LIMITS.soc, LIMITS.current_A)
    assert share.sum() == pytest.approx(1.0) and share.shape == (len(soc_edges) - 1, len(current_edges) - 1)
    assert share[:, 0].sum() == pytest.approx(0.4) and share[:, -1].sum() == pytest.approx(0.6)
