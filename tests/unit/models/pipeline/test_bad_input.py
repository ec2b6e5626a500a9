"""Runs that determine no model, or only in part: refused in physical words, or fitted with what they leave open."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError, NotIdentifiableError, TimeSeriesError
from models.data.resampling import to_grid
from models.data.start_soc import start_soc
from models.data.timeseries import TimeSeries
from models.identification.excitation import check_excitation, check_series, fit_reservations
from models.network.regression import CellContext
from models.network.structure import minimal_structure
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic

CAPACITY_AH = synthetic.CAPACITY_AH
CELL = CellContext(CAPACITY_AH)
STRUCTURES = ("full", "minimal", "auto", minimal_structure(1.0))


def series(current: np.ndarray, step_s: np.ndarray | float = 1.0, start_soc: float = 0.5) -> TimeSeries:
    n = len(current)
    time_s = np.concatenate([[0.0], np.cumsum(np.broadcast_to(step_s, n - 1))])
    counted = start_soc + np.cumsum(current) / (3600.0 * CAPACITY_AH)
    voltage = synthetic.ocv_V(counted) + 0.02 * current
    return TimeSeries(time_s, current, voltage, np.full(n, 25.0), None, np.where(time_s == 0.0, start_soc, np.nan))


def one_level(n: int = 1200) -> TimeSeries:
    """Charge and discharge pulses of one second that leave the state of charge where it is."""
    rng = np.random.default_rng(1)
    return series(np.repeat(rng.uniform(0.5, 4.0, n // 2), 2) * np.tile([1.0, -1.0], n // 2))


def reservations(run: TimeSeries) -> str:
    grid = [to_grid(run, 1.0)]
    return " ".join([*check_series([run], 1.0, CAPACITY_AH), *check_excitation(grid, [0.5], CELL)])


@pytest.mark.parametrize("structure", STRUCTURES, ids=["full", "minimal", "auto", "given"])
@pytest.mark.parametrize(
    ("run", "says"),
    [
        (series(np.full(1500, -1.0)), "resistance cannot be told from the open-circuit curve at constant current"),
        (series(np.random.default_rng(0).normal(-1.0, 0.02, 1500)), "constant current"),
        (series(np.zeros(1500)), "neither resistance nor open-circuit curve"),
        (series(np.array([0.0, 1.0, -1.0])), "3 usable samples"),
        (series(np.array([0.0, 1.0, -1.0]), 1e5), "time stamps jump|usable samples"),
    ],
    ids=["constant", "constant with noise", "rest", "three samples", "three samples far apart"],
)
def test_every_structure_refuses_what_determines_nothing(run: TimeSeries, says: str, structure: object) -> None:
    with pytest.raises(NotIdentifiableError, match=says):
        fit_network([run], capacity_Ah=CAPACITY_AH, structure=structure, dt_s=1.0)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("structure", STRUCTURES[:2], ids=["full", "minimal"])
def test_one_level_of_charge_gives_a_model_with_its_reservation(structure: str) -> None:
    fitted = fit_network([one_level()], capacity_Ah=CAPACITY_AH, structure=structure)
    assert np.isfinite(fitted.network.theta).all()
    said = " ".join(fitted.network.record.reservations)
    assert "known at this level only" in said
    assert "temperature stays within" in said
    low, high = fitted.network.record.domain["soc"]
    assert high - low < 0.05


@pytest.mark.parametrize("factor", [0.2, 0.45])
def test_a_capacity_far_too_small_is_refused(factor: float) -> None:
    run = synthetic.run(3000, seed=1, drift_A=-0.9, initial_soc=0.75)
    with pytest.raises(NotIdentifiableError, match="capacity"):
        fit_network([run], capacity_Ah=factor * CAPACITY_AH, structure="minimal")


def test_a_capacity_that_disagrees_with_the_reference_is_said_with_the_one_that_agrees() -> None:
    run = synthetic.run(2000, seed=1, drift_A=-0.5)
    fitted = fit_network([run], capacity_Ah=1.3 * CAPACITY_AH, structure="minimal")
    assert "reference SoC moves 1.30 times" in " ".join(fitted.network.record.reservations)
    assert "capacity would be 2 Ah" in " ".join(fitted.network.record.reservations)
    assert "reference SoC" not in " ".join(check_excitation([to_grid(run, 1.0)], [0.6], CELL))


def test_a_wrong_sign_of_the_current_is_refused() -> None:
    run = synthetic.run(2000, seed=1)
    bare = replace(run, current_A=-run.current_A, soc_ref=np.where(run.time_s == 0.0, 0.6, np.nan))
    with pytest.raises(NotIdentifiableError, match="sign of the current is wrong"):
        fit_network([bare], capacity_Ah=CAPACITY_AH, structure="minimal")
    # A reference SoC tells the same thing.
    with pytest.raises(NotIdentifiableError, match="sign"):
        fit_network([replace(run, current_A=-run.current_A)], capacity_Ah=CAPACITY_AH, structure="minimal")


def test_a_voltage_that_is_stuck_is_refused_and_one_that_does_not_answer_is_said() -> None:
    run = synthetic.run(2000, seed=1)
    with pytest.raises(NotIdentifiableError, match="stays at 3.7"):
        reservations(replace(run, voltage_V=np.full(2000, 3.7)))
    noise = 3.7 + 0.001 * np.random.default_rng(2).standard_normal(2000)
    assert "hardly answers" in reservations(replace(run, voltage_V=noise))


def test_duplicate_and_backward_time_stamps_are_refused_where_they_are() -> None:
    run = synthetic.run(1000, seed=1)
    for bad_s in (run.time_s[499], run.time_s[499] - 30.0, np.nan):
        time_s = run.time_s.copy()
        time_s[500] = bad_s
        with pytest.raises(TimeSeriesError, match="sample 500"):
            replace(run, time_s=time_s)


@pytest.mark.parametrize(("jump_s", "refused"), [(120.0, False), (7200.0, True), (1e9, True)])
def test_a_clock_that_jumps_forward_leaves_the_charge_open(jump_s: float, refused: bool) -> None:
    whole = synthetic.run(2000, seed=1)
    run = replace(whole, soc_ref=np.where(whole.time_s == 0.0, 0.6, np.nan))
    k = int(np.argmax(np.abs(np.diff(run.current_A)) > 1.0))
    jumped = replace(run, time_s=run.time_s + jump_s * (np.arange(2000) > k))
    if refused:
        with pytest.raises(NotIdentifiableError, match="flowed unseen|time stamps jump"):
            fit_network([jumped], capacity_Ah=CAPACITY_AH, structure="minimal", dt_s=1.0)
        return
    assert "flowed unseen" in reservations(jumped)
    assert "flowed unseen" not in reservations(run)


def test_missing_values_are_counted_or_refused() -> None:
    run = synthetic.run(2000, seed=1, noise_V=1e-3)
    rng = np.random.default_rng(5)
    few, many = rng.random(2000) < 0.05, rng.random(2000) < 0.4

    def without(name: str, lost: np.ndarray) -> TimeSeries:
        return replace(run, **{name: np.where(lost, np.nan, getattr(run, name))})

    fitted = fit_network([without("voltage_V", few)], capacity_Ah=CAPACITY_AH, structure="minimal")
    assert "voltage is missing at" in " ".join(fitted.network.record.reservations)
    assert fitted.train["rmse_mV"] < 2.0
    assert f"current is missing at {few.sum()} samples" in reservations(without("current_A", few))
    with pytest.raises(NotIdentifiableError, match="charge that flowed is not known"):
        reservations(without("current_A", many))
    assert "no temperature" in reservations(without("temperature_degC", np.ones(2000, bool)))
    assert "temperature is missing for up to 1998 s" in reservations(without("temperature_degC", run.time_s > 1.0))
    with pytest.raises(NotIdentifiableError, match="usable samples"):
        reservations(without("voltage_V", np.ones(2000, bool)))


def test_the_weak_direction_is_named() -> None:
    n = 2000
    wave = np.sin(2.0 * np.pi * np.arange(n) / 500.0)
    run = series(wave * 2.0)
    # A current that follows the state of charge itself, as a tapering charge does.
    level = np.exp(-np.arange(n) / 600.0)
    taper = series(-4.0 * level - 0.02 * np.sign(wave), start_soc=0.5)
    with pytest.raises(NotIdentifiableError, match="current and state of charge rise and fall together"):
        reservations(taper)
    warm = replace(run, temperature_degC=25.0 + 40.0 * np.cumsum(wave) / n)
    assert "state of charge and temperature rise and fall together" in reservations(warm)
    assert "rise and fall together" not in reservations(run)


def test_one_direction_only_is_said() -> None:
    current = np.repeat(np.random.default_rng(1).uniform(0.0, 2.0, 100), 20)
    assert "never discharged" in reservations(series(current, start_soc=0.2))
    assert "never charged" in reservations(series(-current, start_soc=0.9))


def test_a_fit_that_misses_its_own_runs_says_so() -> None:
    assert fit_reservations({"nrmse": 0.01, "rmse_mV": 5.0}, 0, 100) == []
    assert "misses its own training runs by 90 mV" in fit_reservations({"nrmse": 0.09, "rmse_mV": 90.0}, 0, 100)[0]


@pytest.mark.parametrize("capacity_Ah", [0.0, -2.0, float("nan"), float("inf")])
def test_a_capacity_that_is_none_is_refused(capacity_Ah: float) -> None:
    with pytest.raises(ModelError, match="capacity"):
        fit_network([synthetic.run(1000, seed=1)], capacity_Ah=capacity_Ah, structure="minimal")


def test_a_reference_that_begins_after_charge_has_flowed_is_not_taken_for_the_start() -> None:
    run = synthetic.run(2000, seed=1)
    assert start_soc(run) == 0.6
    late = np.where(run.time_s < 900.0, np.nan, run.soc_ref)
    with pytest.raises(ModelError, match="known only from 900 s on"):
        start_soc(replace(run, soc_ref=late))
    rested = replace(run, current_A=np.where(run.time_s <= 900.0, 0.0, run.current_A), soc_ref=late)
    assert start_soc(rested) == run.soc_ref[900]
