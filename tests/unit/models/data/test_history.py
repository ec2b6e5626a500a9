"""What is put in front of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.data.history import StartHistory, first_part, history_edges_s, placed
from tests.unit.models.hand_network import CAPACITY_AH, grid_run

HISTORY = StartHistory((0.0, 20.0, 120.0), (1.5, -0.5))


def test_windows_are_as_long_as_the_memory() -> None:
    assert history_edges_s(1e9) == (0.0, 20.0, 120.0, 600.0, 3600.0, 10_800.0)
    assert history_edges_s(1000.0) == (0.0, 20.0, 120.0, 600.0, 1000.0)
    assert history_edges_s(700.0) == (0.0, 20.0, 120.0, 700.0)
    assert history_edges_s(5.0) == (0.0, 20.0)


def test_the_newest_current_stands_nearest() -> None:
    run = replace(grid_run(np.full(5, 1.0), 21.0, ambient_degC=19.0), segment_starts=(0, 3))
    found = placed(run, 0.5, HISTORY, capacity_Ah=CAPACITY_AH)
    assert found.n_before == 120 and len(found.run) == 125
    assert (found.run.current_A[:100] == -0.5).all() and (found.run.current_A[100:120] == 1.5).all()
    assert np.isnan(found.run.voltage_V[:120]).all() and not found.run.measured[:120].any()
    assert (found.run.temperature_degC == 21.0).all() and found.run.segment_starts == (0, 123)
    assert found.run.time_s[0] == -120.0 and np.allclose(np.diff(found.run.time_s), 1.0)


@pytest.mark.parametrize("efficiency", [1.0, 0.97])
def test_the_first_measured_sample_has_the_stated_soc(efficiency: float) -> None:
    from models.network.signals import soc_by_counting

    run = grid_run(np.array([0.0, 1.0, -2.0, 1.0]), 25.0)
    found = placed(run, 0.5, HISTORY, capacity_Ah=CAPACITY_AH, efficiency=efficiency)
    soc = soc_by_counting(found.run.charge_Ah, found.initial_soc, CAPACITY_AH, efficiency)
    assert soc[120:] == pytest.approx(soc_by_counting(run.charge_Ah, 0.5, CAPACITY_AH, efficiency))
    assert soc[119] == pytest.approx(0.5) and soc[118] == pytest.approx(0.5 - efficiency * 1.5 / 3600.0 / CAPACITY_AH)


def test_hours_of_current_do_not_leave_the_range() -> None:
    history = StartHistory((0.0, 20.0, 10_800.0), (0.0, 5.0))
    found = placed(grid_run(np.zeros(3), 25.0), 0.5, history, capacity_Ah=CAPACITY_AH, soc_range=(0.1, 0.9))
    assert found.initial_soc == pytest.approx(0.1)
    assert found.initial_soc + found.run.charge_Ah[-1] / CAPACITY_AH == pytest.approx(0.5)


def test_a_first_part_is_a_run_of_its_own() -> None:
    run = replace(grid_run(np.arange(10.0), 25.0), segment_starts=(0, 4, 8))
    assert len(first_part(run, 6)) == 6 and first_part(run, 6).segment_starts == (0, 4)
    assert first_part(run, 10) is run
