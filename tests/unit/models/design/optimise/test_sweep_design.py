"""Of sweeps that go through the window alike the criterion chooses; where blocks are asked for there is none."""

import numpy as np
import pytest

from models.design.constraints.limits import Limits
from models.design.design import design
from models.design.information.experiment import Evaluator
from models.design.optimise.block_design import DesignRequest, plan_of
from models.design.optimise.sweep_design import swept
from models.design.sequence.mixed_sweep import mixed_sweep
from tests.unit.models.design.networks import experiment

LIMITS = Limits((-6.0, 4.0), (0.1, 0.92), voltage_V=(2.9, 4.2))


def request(**changes: object) -> DesignRequest:
    fields: dict[str, object] = {"limits": LIMITS, "duration_s": 14_000.0, "soc_levels": (0.3, 0.5, 0.7), "seed": 5}
    return DesignRequest(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
def test_the_draw_that_tells_most_is_taken(criterion: str) -> None:
    where, asked = experiment(), request(criterion=criterion, n_starts=4)
    plan = plan_of(where, asked)
    draws = [mixed_sweep(plan, asked.active_s, asked.seed + 1000 * number) for number in range(4)]
    found = swept(where, asked, plan)
    assert found is not None
    values = [
        Evaluator(where, len(each.current_A), criterion).value(each.current_A) for each in draws if each is not None
    ]
    assert len(values) == 4 and np.ptp(values) > 0.0
    best = draws[int(np.argmax(values))]
    assert best is not None
    np.testing.assert_array_equal(found.current_A, best.current_A)


@pytest.mark.parametrize(
    "changes",
    [
        {"soc_levels": (0.3, 0.7)},
        {"target_std": 0.1},
        {"cycle_A": np.tile([-1.0, 1.0, 0.0, 0.5], 50)},
        {"duration_s": 6500.0},
    ],
)
def test_blocks_stay_where_they_are_asked_for(changes: dict) -> None:
    where, asked = experiment(), request(**changes)
    assert swept(where, asked, plan_of(where, asked)) is None


@pytest.mark.parametrize(
    "limits",
    [
        Limits((-6.0, 4.0), (0.1, 0.92), voltage_V=(3.1, 3.9)),
        Limits((-6.0, 4.0), (0.1, 0.92), ramp_A_per_s=(-0.3, 0.2)),
        Limits((-6.0, 4.0), (0.1, 0.92), net_charge_Ah=(-0.02, 0.02)),
    ],
)
def test_a_sweep_keeps_the_limits_and_says_where_it_goes(limits: Limits) -> None:
    found = design(experiment(), request(limits=limits, n_starts=2))
    soc = 0.5 + np.cumsum(found.current_A) * found.dt_s / 7200.0
    assert 0.1 - 1e-9 <= soc.min() <= 0.12 and 0.9 <= soc.max() <= 0.92 + 1e-9
    np.testing.assert_allclose(found.coverage.soc, (soc.min(), soc.max()), atol=1e-9)
    assert -6.0 - 1e-9 <= found.current_A.min() and found.current_A.max() <= 4.0 + 1e-9
    if limits.voltage_V is not None:
        assert found.band_low_V.min() >= 3.1 and found.band_high_V.max() <= 3.9
    if limits.ramp_A_per_s is not None:
        steps = np.diff(found.current_A, prepend=0.0, append=0.0) / found.dt_s
        assert steps.min() >= -0.3 - 1e-9 and steps.max() <= 0.2 + 1e-9
    if limits.net_charge_Ah is not None:
        assert abs(found.current_A.sum()) * found.dt_s / 3600.0 <= 0.02 + 1e-9
