"""The check of the current's sign against the voltage's response."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench_service.exchange import RunFileError, read_run, read_run_file, write_run
from bench_service.exchange.sign import judge_sign

Arrays = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def measured(current_A: NDArray[np.float64], rng: np.random.Generator) -> Arrays:
    """A cell of 30 mOhm and 3 Ah whose voltage has 1 mV of noise."""
    time_s = np.arange(len(current_A), dtype=float)
    charge_Ah = np.cumsum(current_A) / 3600
    voltage_V = 3.7 + 0.2 * charge_Ah + 0.03 * current_A + 1e-3 * rng.standard_normal(len(current_A))
    return current_A, voltage_V, time_s


def drive(rng: np.random.Generator) -> Arrays:
    """Steps of random height."""
    return measured(np.repeat(rng.normal(-1.0, 2.0, 120), 10), rng)


def slow_discharge(rng: np.random.Generator) -> Arrays:
    """Constant current alone, no step to look at."""
    return measured(np.full(5000, -1.0), rng)


@pytest.mark.parametrize("case", [drive, slow_discharge])
@pytest.mark.parametrize("seed", range(5))
def test_both_signs_are_told_apart(case: Callable[[np.random.Generator], Arrays], seed: int) -> None:
    current_A, voltage_V, time_s = case(np.random.default_rng(seed))
    assert judge_sign(current_A, voltage_V, time_s).verdict == "charge-positive"
    assert judge_sign(-current_A, voltage_V, time_s).verdict == "discharge-positive"


def test_missing_values_and_a_spike_do_not_hide_the_steps() -> None:
    rng = np.random.default_rng(0)
    current_A, voltage_V, time_s = drive(rng)
    voltage_V[rng.random(len(voltage_V)) < 0.2] = np.nan
    current_A[500] = 80.0  # a spike of the sensor, which the voltage knows nothing of
    assert judge_sign(-current_A, voltage_V, time_s).verdict == "discharge-positive"


def test_rest_alone_is_unclear() -> None:
    rng = np.random.default_rng(0)
    assert judge_sign(*measured(np.zeros(100), rng)).verdict == "unclear"


def test_a_current_that_the_voltage_does_not_follow_is_unclear() -> None:
    rng = np.random.default_rng(0)
    current_A, _, time_s = drive(rng)
    assert judge_sign(current_A, 3.7 + 1e-3 * rng.standard_normal(len(time_s)), time_s).verdict == "unclear"


def cc_cv(dt_s: float, rng: np.random.Generator) -> Arrays:
    """A charge that begins in mid-log and ends in a held voltage, logged every `dt_s`."""
    time_s = np.arange(0.0, 9000.0, dt_s)
    current_A = np.where(time_s < 3000.0, 3.0, 3.0 * np.exp(-(time_s - 3000.0) / 900.0))
    voltage_V = np.where(time_s < 3000.0, 4.0 + 0.2 * time_s / 3000.0, 4.2) + 2e-4 * rng.standard_normal(len(time_s))
    return current_A, voltage_V, time_s


def falling_stages(rng: np.random.Generator) -> Arrays:
    """A flat curve charged in two stages, the second with less current: the voltage falls while charge goes in."""
    return measured(np.repeat([3.0, 1.0], 600), rng)


def late(rng: np.random.Generator) -> Arrays:
    """A current that is another one at each sample, and a voltage that is logged one sample later."""
    current_A, voltage_V, time_s = measured(rng.normal(0.0, 2.0, 400), rng)
    return current_A, np.roll(voltage_V, 1), time_s


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("case", ["cv", "cv, 60 s", "stages", "late"])
def test_a_right_sign_is_never_refused(case: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = {
        "cv": lambda: cc_cv(1.0, rng),
        "cv, 60 s": lambda: cc_cv(60.0, rng),
        "stages": lambda: falling_stages(rng),
        "late": lambda: late(rng),
    }[case]()
    assert judge_sign(*columns).verdict != "discharge-positive"


def test_few_steps_at_a_wrong_distance_do_not_outweigh_those_of_the_same_moment() -> None:
    """A charger ends a voltage that it held: at three of ten steps the voltage had fallen two samples before."""
    step_A, step_V = np.zeros(700), np.zeros(700)
    step_A[[100, 200, 300, 400, 500, 600]] = [-0.29, 0.145, 0.21, 0.245, 0.057, 0.29]
    step_V[[100, 200, 400, 600]] = [-0.011, -0.024, 0.067, 0.178]
    step_V[[198, 298, 498]] = [-0.043, -0.043, -0.024]
    current_A, voltage_V = np.cumsum(step_A), 2.8 + np.cumsum(step_V)
    assert judge_sign(current_A, voltage_V, np.arange(700.0)).verdict == "charge-positive"
    assert judge_sign(-current_A, voltage_V, np.arange(700.0)).verdict == "discharge-positive"


def test_steps_and_charge_that_contradict_each_other_are_unclear() -> None:
    rng = np.random.default_rng(2)
    current_A, voltage_V, time_s = measured(np.repeat(rng.normal(-1.0, 2.0, 120), 40), rng)
    drifting = voltage_V - 2.0 * (voltage_V[-1] - voltage_V[0]) * time_s / time_s[-1]
    assert judge_sign(current_A, drifting, time_s).verdict == "unclear"


def test_what_a_logger_writes_for_no_value_is_missing(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    current_A, voltage_V, time_s = drive(rng)
    current_A[0] = 3.4e38
    columns = {"time_s": time_s, "current_A": current_A, "voltage_V": voltage_V}
    write_run(tmp_path / "a.csv", columns | {"temperature_degC": np.full(len(time_s), 25.0)}, "csv")
    read = read_run_file(tmp_path / "a.csv")
    assert np.isnan(read.series.current_A[0]) and not np.isnan(read.series.current_A[1:]).any()
    assert any("current_A is 3.4e+38 in 1 row(s), first at row 2: taken as missing" in each for each in read.warnings)


def save(path: Path, sign: float = 1.0, rest: bool = False) -> Path:
    rng = np.random.default_rng(1)
    current_A, voltage_V, time_s = measured(np.zeros(100), rng) if rest else drive(rng)
    columns = {"time_s": time_s, "current_A": sign * current_A, "voltage_V": voltage_V}
    write_run(path, columns | {"temperature_degC": np.full(len(time_s), 25.0)}, "csv")
    return path


def test_wrong_sign_stops_and_names_evidence_and_remedy(tmp_path: Path) -> None:
    with pytest.raises(RunFileError) as caught:
        read_run(save(tmp_path / "a.csv", sign=-1.0))
    message = str(caught.value)
    assert "the current has the wrong sign (positive must charge)" in message
    assert "mV/A" in message
    assert "--current-sign discharge-positive" in message
    assert "\n" not in message


def test_current_sign_settles_it(tmp_path: Path) -> None:
    right = read_run(save(tmp_path / "right.csv"))
    wrong = save(tmp_path / "wrong.csv", sign=-1.0)
    np.testing.assert_array_equal(read_run(wrong, "discharge-positive").current_A, right.current_A)
    np.testing.assert_array_equal(read_run(wrong, "charge-positive").current_A, -right.current_A)


def test_unclear_sign_is_a_warning(tmp_path: Path) -> None:
    read = read_run_file(save(tmp_path / "a.csv", rest=True))
    assert any("sign of the current cannot be checked (no current flows)" in each for each in read.warnings)
