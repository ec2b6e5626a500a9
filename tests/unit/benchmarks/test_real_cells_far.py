"""Errors far too large inside the trained ranges come as spells, each with the slip of charge that would explain it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.real_cells_far import FAR_V, far_inside
from benchmarks.real_cells_summary import far_line
from models.comparison.simulated_runs import simulate_runs
from models.data.timeseries import TimeSeries
from models.network.structure import InputChannel, PartitionAxis, Structure
from tests.unit.models.hand_network import network

N, SOC = 2000, 0.6
# 14 V from empty to full: a slip of 2 % is 0.28 V.
STRUCTURE = Structure(0, (InputChannel("soc"), InputChannel("current")), (PartitionAxis("soc"),), 1.0)


def test_a_spell_is_told_with_what_explains_it() -> None:
    model = network(STRUCTURE, np.array([[0.7, 0.02, 3.4]]))
    current_A = np.where(np.arange(N) % 40 < 20, -1.0, 0.5)
    run = TimeSeries(np.arange(float(N)), current_A, np.full(N, 3.7), np.full(N, 25.0), name="log")
    (plain,) = simulate_runs(model, [run], [SOC])
    (slipped,) = simulate_runs(model, [run], [SOC + 0.02])
    slip_V = float(np.median(slipped.simulated_V - plain.simulated_V))
    scale = 2.0 * FAR_V / slip_V
    off_V = np.zeros(N)
    off_V[500:600] = scale * slip_V
    measured = replace(run, voltage_V=plain.simulated_V + off_V)
    (compared,) = simulate_runs(model, [measured], [SOC])
    compared = replace(compared, inside=np.ones(N, dtype=bool))
    (spell,) = far_inside(model, [measured], [SOC], [compared])
    assert (spell["run"], spell["from_s"], spell["to_s"], spell["samples"]) == ("log", 500.0, 599.0, 100)
    assert spell["share"] == pytest.approx(100 / N)
    assert spell["error_mV"] == pytest.approx(2e3 * FAR_V)
    assert spell["slip_percent"] == pytest.approx(2.0 * scale, rel=1e-3)
    assert "log 500..599 s: 100 samples (5.00%)" in far_line(spell)


def test_nothing_is_said_of_small_errors_and_of_what_was_not_trained() -> None:
    model = network(STRUCTURE, np.array([[0.7, 0.02, 3.4]]))
    run = TimeSeries(np.arange(float(N)), np.full(N, -0.1), np.full(N, 3.0), np.full(N, 25.0), name="log")
    (compared,) = simulate_runs(model, [run], [SOC])
    small = replace(compared, simulated_V=compared.run.voltage_V + 0.9 * FAR_V, inside=np.ones(N, dtype=bool))
    outside = replace(compared, simulated_V=compared.run.voltage_V + 2.0 * FAR_V, inside=np.zeros(N, dtype=bool))
    assert far_inside(model, [run], [SOC], [small]) == far_inside(model, [run], [SOC], [outside]) == []
