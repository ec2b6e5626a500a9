"""A voltage that is held by the current: how far beyond it comes, how near it stays, how smooth the current is."""

from __future__ import annotations

import numpy as np
import pytest

from tests.unit.bench_service.protocol.protocol_rig import play, program_of

TOP = {"nmc": 4.18, "lfp": 3.63, "nimh": 1.5}


@pytest.mark.parametrize(
    ("cell", "dt_s", "rate", "cut_off"),
    [("nmc", 0.1, 1.0, 0.2), ("nmc", 1.0, 1.0, 0.02), ("nmc", 10.0, 1.0, 0.02), ("nmc", 1.0, 2.0, 0.05),
     ("lfp", 0.1, 1.0, 0.05), ("lfp", 1.0, 1.0, 0.02), ("lfp", 1.0, 3.0, 0.02)],
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
