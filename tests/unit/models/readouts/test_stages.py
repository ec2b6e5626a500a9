"""dQ/dV and dV/dQ of some runs of a life, measured beside the model."""

import numpy as np
import pytest

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.readouts.stages import stages_of

CAPACITY_AH, ERROR_V = 2.0, 0.03


def record(number: int, sign: float = -1.0, c_rate: float = 0.5) -> tuple[GridRun, FloatArray]:
    """A charge or discharge along a curve with one step, which the model has 30 mV higher."""
    n = int(3600 / c_rate * 0.9)
    soc = 0.5 + sign * (np.arange(n) / n - 0.5) * 0.9
    voltage_V = 3.3 + 0.5 * soc + 0.1 * np.tanh((soc - 0.6) / 0.03)
    current_A = np.full(n, sign * c_rate * CAPACITY_AH)
    run = to_grid(TimeSeries(np.arange(n) * 1.0, current_A, voltage_V, np.full(n, 25.0), name=f"run {number}"), 1.0)
    return run, np.full(len(run), -ERROR_V)


def test_measured_and_model_are_told_on_the_same_axes() -> None:
    (found,) = stages_of([record(0)], np.array([7.0]), CAPACITY_AH)
    told = found.to_json()
    assert (told["run"], told["at"], told["way"]) == ("run 0", 7.0, "discharge")
    assert told["rate_1_per_h"] == pytest.approx(0.5, rel=0.02)
    for name in ("measured", "model"):
        assert len(told[name]["dQ_dV_Ah_per_V"]) == len(told["voltage_V"])
        assert len(told[name]["dV_dQ_V_per_Ah"]) == len(told["charge_Ah"])
        # The step is where least charge lies between two voltages.
        slopes = np.array(told[name]["dV_dQ_V_per_Ah"], dtype=float)
        step_Ah = np.array(told["charge_Ah"])[np.nanargmax(slopes)]
        assert step_Ah == pytest.approx(-(0.95 - 0.6) * CAPACITY_AH, abs=0.03)
    # The model's curve lies higher; where one of the two never came there is none.
    assert told["measured"]["dQ_dV_Ah_per_V"][-1] is None
    assert told["model"]["dQ_dV_Ah_per_V"][0] is None


def test_of_a_long_life_some_runs_of_either_direction_are_told_with_the_first_and_the_last() -> None:
    every = [record(k, -1.0 if k % 2 else 1.0) for k in range(12)]
    found = stages_of(every, np.arange(12.0), CAPACITY_AH)
    for way, first, last in (("charge", 0.0, 10.0), ("discharge", 1.0, 11.0)):
        at = [each.at for each in found if each.curves.way == way]
        assert len(at) == 4 and (at[0], at[-1]) == (first, last)


def test_what_is_too_fast_to_show_stages_is_left_out() -> None:
    assert stages_of([record(0, c_rate=3.0)], np.array([1.0]), CAPACITY_AH) == ()
