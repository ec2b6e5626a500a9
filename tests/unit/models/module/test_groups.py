"""What differs from group to group, told by runs that begin anywhere."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from models.module.groups import Group, judge_groups, left_out, weak_group
from models.module.log import ModuleLog
from models.network.local_model_network import LocalModelNetwork
from models.network.partition import hat_partition
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models import hand_network, synthetic
from tests.unit.models.module import synthetic_module as truth

STARTS = (0.75, 0.35)
LOGS = [truth.log(2000, seed, initial_soc=soc, offset_at_soc=1.0) for seed, soc in enumerate(STARTS, start=5)]


@pytest.fixture(scope="module")
def network() -> LocalModelNetwork:
    """Of one cell, its equations written down."""
    low, high = hand_network.SCALING["soc"]
    knots = np.linspace(-0.1, 1.1, 50)
    ocv_V = synthetic.ocv_V(low + (high - low) * knots)
    inputs = (InputChannel("current"), InputChannel(f"low_pass:{synthetic.TAU_S:g}"))
    structure = Structure(0, inputs, (PartitionAxis("soc"),), hand_network.DT_S, "hat")
    scaling = {**hand_network.SCALING, f"low_pass:{synthetic.TAU_S:g}": (-6.0, 4.0)}
    gains = np.tile([synthetic.R0_OHM, synthetic.R1_OHM], (len(knots), 1))
    return hand_network.network(structure, np.column_stack([gains, ocv_V]), hat_partition(knots), scaling)


def judged(network: LocalModelNetwork, logs: Sequence[ModuleLog], initial_soc: Sequence[float]) -> list[Group]:
    return judge_groups(network, truth.PARALLEL, logs, initial_soc)


@pytest.mark.parametrize("places", [(0,), (1,), (0, 1)])
def test_a_group_is_the_same_wherever_the_run_began(network: LocalModelNetwork, places: tuple[int, ...]) -> None:
    groups = judged(network, [LOGS[k] for k in places], [STARTS[k] for k in places])
    # The mean of all groups is lower, and holds less, than a sound group.
    share = [each.capacity_Ah[0] for each in groups]
    assert share[1] / np.mean([share[0], share[2]]) == pytest.approx(truth.CAPACITY_SHARE, abs=0.01)
    apart = groups[1].soc_offset[0] - np.mean([groups[0].soc_offset[0], groups[2].soc_offset[0]])
    assert apart == pytest.approx(truth.SOC_OFFSET, abs=0.006)
    until = [each.until_empty_Ah[0] for each in groups]
    expected = truth.CAPACITY_SHARE * (1.0 + truth.SOC_OFFSET)
    assert until[1] / np.mean([until[0], until[2]]) == pytest.approx(expected, abs=0.01)
    assert max(each.rmse_mV for each in groups) < 3.0
    weak = weak_group(groups)
    assert weak is not None and weak["group"] == 2


def broken(log: ModuleLog, number: int, known: int = 0) -> ModuleLog:
    """The lead of a group gives so many samples only."""
    assert log.groups_V is not None
    groups_V = log.groups_V.copy()
    groups_V[known:, number] = np.nan
    return replace(log, groups_V=groups_V)


@pytest.mark.parametrize("known", [0, 5])
def test_a_group_without_a_lead_is_left_out_and_named(network: LocalModelNetwork, known: int) -> None:
    logs = [broken(log, 2, known) for log in LOGS]
    groups = judged(network, logs, STARTS)
    assert [each.number for each in groups] == [1, 2]
    share = groups[1].capacity_Ah[0] / groups[0].capacity_Ah[0]
    assert share == pytest.approx(truth.CAPACITY_SHARE, abs=0.02)
    (text,) = left_out(groups, logs)
    assert "group 3" in text and "sense lead" in text


def test_a_lead_that_is_gone_in_one_run_is_judged_by_the_other(network: LocalModelNetwork) -> None:
    logs = [broken(LOGS[0], 2), LOGS[1]]
    groups = judged(network, logs, STARTS)
    assert [each.number for each in groups] == [1, 2, 3] and left_out(groups, logs) == []
    assert groups[2].capacity_Ah[0] == pytest.approx(groups[0].capacity_Ah[0], rel=0.01)
    assert np.isfinite([each.lowest_V for each in groups]).all()


def test_a_group_that_is_only_seen_at_rest_is_left_out(network: LocalModelNetwork) -> None:
    run = LOGS[0].run
    resting = replace(run, current_A=np.zeros(len(run)))
    logs = [replace(LOGS[0], run=resting)]
    assert judged(network, logs, STARTS[:1]) == [] and len(left_out([], logs)) == truth.SERIES


def test_the_mean_cell_of_a_run_with_a_broken_lead_is_of_the_whole_module() -> None:
    whole_V = LOGS[0].run.voltage_V / truth.SERIES
    for known in (0, 5):
        mean = broken(LOGS[0], 2, known).mean_cell(truth.SERIES, truth.PARALLEL)
        np.testing.assert_array_equal(mean.voltage_V, whole_V)
    # Gone in part of the run, the others have no mean there, and the rest is as it was.
    mean_V = broken(LOGS[0], 2, 300).mean_cell(truth.SERIES, truth.PARALLEL).voltage_V
    np.testing.assert_array_equal(mean_V[:300], LOGS[0].mean_cell(truth.SERIES, truth.PARALLEL).voltage_V[:300])
    assert np.isnan(mean_V[300:]).all()
