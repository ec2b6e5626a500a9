"""A voltage that is held by the current: how far beyond it comes, how near it stays, how smooth the current is."""

from __future__ import annotations

import numpy as np
import pytest

from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.bench_service.protocol.protocol_rig import play, program_of

TOP = {"nmc": 4.18, "lfp": 3.63, "nimh": 1.5}


@pytest.mark.parametrize(
    ("cell", "dt_s", "rate", "cut_off"),
    [("nmc", 0.1, 1.0, 0.2), ("nmc", 1.0, 1.0, 0.02), ("nmc", 10.0, 1.0, 0.02), ("nmc", 1.0, 2.0, 0.05),
     ("nmc", 5.0, 2.0, 0.05), ("nmc", 10.0, 2.0, 0.02),
     ("lfp", 0.1, 1.0, 0.05), ("lfp", 1.0, 1.0, 0.02), ("lfp", 1.0, 3.0, 0.02), ("lfp", 5.0, 1.0, 0.02),
     ("lfp", 10.0, 2.0, 0.02), ("nimh", 1.0, 1.0, 0.05), ("nimh", 10.0, 1.0, 0.05)],
)  # fmt: skip
def test_the_hold_of_a_charge(cell: str, dt_s: float, rate: float, cut_off: float) -> None:
    step = {"step": "cc_cv", "rate_C": rate, "voltage_V": TOP[cell], "until": {"rate_C": cut_off}}
    played = play(program_of([step], cell), cell, dt_s=dt_s, soc=0.85)
    off_V = played.true_V - TOP[cell]
    held = int(np.argmax(off_V > -0.003))
    assert off_V.max() < 0.010
    settled = off_V[held + int(max(60.0, 6 * dt_s) / dt_s) :]
    assert abs(settled.mean()) < 0.002 and np.sqrt(np.mean(settled**2)) < 0.002
    assert (played.current_A >= -0.01).all() and played.current_A.max() <= rate * 2.5 + 0.01


@pytest.mark.parametrize("dt_s", [1.0, 10.0])
@pytest.mark.parametrize(("cell", "soc"), [("nmc", 0.93), ("nmc", 0.97), ("lfp", 0.97), ("lfp", 0.99)])
def test_a_charge_that_begins_near_its_voltage_does_not_run_beyond_it(cell: str, soc: float, dt_s: float) -> None:
    step = {"step": "cc_cv", "rate_C": 1, "voltage_V": TOP[cell], "until": {"rate_C": 0.05}}
    played = play(program_of([step], cell), cell, dt_s=dt_s, soc=soc)
    assert played.true_V.max() < TOP[cell] + 0.010 and played.ended and played.engine.stopped is None


@pytest.mark.parametrize("target_V", [3.5, 3.9])
def test_a_hold_from_rest_reaches_its_voltage_from_either_side(target_V: float) -> None:
    step = {"step": "constant_voltage", "voltage_V": target_V, "rate_C": 1, "until": {"rate_C": 0.05, "time_s": 9000}}
    played = play(program_of([step]), dt_s=1.0)
    off_V = (played.true_V - target_V) * np.sign(target_V - 3.7)
    assert off_V.max() < 0.010 and abs(off_V[-60:].mean()) < 0.002
    assert np.abs(played.current_A).max() <= 2.5 + 0.01


@pytest.mark.parametrize("dt_s", [1.0, 10.0])
@pytest.mark.parametrize(
    ("cell", "rate", "soc", "target_V"),
    [("nmc", 2, 0.5, 4.15), ("lfp", 1, 0.5, 3.45), ("lfp", 2, 0.9, 3.6), ("nimh", 0.5, 0.5, 1.4)],
)
def test_a_hold_that_begins_far_away_does_not_run_beyond(
    cell: str, rate: float, soc: float, target_V: float, dt_s: float
) -> None:
    until = {"rate_C": 0.05, "time_s": 2400}
    step = {"step": "constant_voltage", "voltage_V": target_V, "rate_C": rate, "until": until}
    off_V = play(program_of([step], cell), cell, dt_s=dt_s, soc=soc).true_V - target_V
    assert -0.003 < off_V.max() < 0.010


@pytest.mark.parametrize(("dt_s", "ramp_A_per_s"), [(1.0, None), (10.0, None), (1.0, 0.1)])
def test_a_hold_goes_on_after_a_pause_and_with_a_slow_ramp(dt_s: float, ramp_A_per_s: float | None) -> None:
    """In a pause the voltage falls by what the resistance held: that is no error to be made up for."""
    step = {"step": "cc_cv", "rate_C": 1, "voltage_V": 4.18, "until": {"time_s": 2400}}
    engine = Engine(program_of([step], ramp_A_per_s=ramp_A_per_s), dt_s)
    cell, set_A, interval_s = Cell(CELLS["nmc"].parameters, 0.85), 0.0, 0.0
    highest_V = seen_V = 0.0
    for k in range(int(2400 / dt_s)):
        seen_V = cell.step(set_A, interval_s).voltage_V
        highest_V = max(highest_V, seen_V)
        if k == int(600 / dt_s):
            engine.pause()
            seen_V = cell.step(0.0, 60.0).voltage_V
            set_A = 0.0
        told_A = engine.advance(Seen(seen_V, set_A, 25.0, None, interval_s))
        assert told_A is not None
        set_A, interval_s = told_A, dt_s
    assert highest_V < 4.183 and abs(seen_V - 4.18) < 0.002
