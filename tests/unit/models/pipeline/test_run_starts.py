"""Training runs that begin anywhere, at states of charge that somebody only believes."""

from __future__ import annotations

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.diagnosis import memory_of, own_variant
from models.diagnosis.known.record import known_in
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import FitResult, fit_network
from models.pipeline.joint_soc import joint_soc, within
from models.pipeline.run_starts import likely_starts
from models.pipeline.training import training
from tests.unit.models.hand_network import CAPACITY_AH, SCALING, grid_run, network

NOISE_MV = 1.0
LENGTH = 6000


def cell() -> LocalModelNetwork:
    """Open-circuit voltage over three local models, two slow branches, a loop of +-30 mV."""
    names = ("current", "low_pass:30", "low_pass:900", "hysteresis_state:20")
    inputs = (InputChannel("soc", delay=1), *(InputChannel(name) for name in names))
    structure = Structure(0, inputs, (PartitionAxis("soc", initial=3, k_sigma=0.5),), 1.0)
    rows = [[slope, 0.014, 0.01, 0.02, 0.03, offset] for slope, offset in ((0.9, 3.1), (0.4, 3.25), (0.8, 3.1))]
    scaling = {**SCALING, "low_pass:900": (-3, 3), "hysteresis_state:20": (-1, 1)}
    return network(structure, np.array(rows), scaling=scaling)


def log(before_A: np.ndarray, seed: int, off: float = 0.0) -> tuple[TimeSeries, float]:
    """What is logged after `before_A`, its reference off by so much; and where it really begins."""
    rng, n = np.random.default_rng(seed), len(before_A)
    current, soc = before_A.tolist(), 0.5 + float(before_A.sum()) / 3600.0 / CAPACITY_AH
    while len(current) < n + LENGTH:
        length, drawn = int(rng.integers(20, 300)), float(rng.choice([0.0, *rng.uniform(-2.0, 2.0, 3)]))
        if not 0.3 < soc + drawn * length / 3600.0 / CAPACITY_AH < 0.75:
            drawn = -drawn
        current += [drawn] * length
        soc += drawn * length / 3600.0 / CAPACITY_AH
    whole = grid_run(np.array(current[: n + LENGTH]), 25.0)
    voltage_V = free_run_V(cell(), whole, 0.5) + 1e-3 * NOISE_MV * rng.standard_normal(len(whole))
    true = 0.5 + whole.charge_Ah[n:] / CAPACITY_AH
    columns = np.arange(float(LENGTH)), whole.current_A[n:], voltage_V[n:], np.full(LENGTH, 25.0)
    return TimeSeries(*columns, None, true + off, f"run{seed}"), float(true[0])


def fitted(runs: list[TimeSeries], **options: float) -> FitResult:
    judged, _ = log(np.zeros(1), 99)
    return fit_network(
        runs,
        capacity_Ah=CAPACITY_AH,
        structure=cell().structure,
        validate=[judged],
        **options,  # pyright: ignore[reportArgumentType]
    )


def after(*steps: tuple[float, int]) -> np.ndarray:
    """Current of so many A for so many s each."""
    return np.concatenate([np.full(length, current_A) for current_A, length in steps])


def test_logs_that_begin_anywhere_do_not_bend_the_model() -> None:
    logs = [log(after((-1.0, 1300), (0.0, 200)), 1), log(after((0.5, 2500), (0.0, 3600)), 2), log(np.zeros(1), 3)]
    # The judged run passes SoC 0.38 to 0.52, where none of these was.
    logs.append(log(np.zeros(1), 5))
    result = fitted([run for run, _ in logs])
    assert result.train["rmse_mV"] < 1.1 * NOISE_MV
    assert result.validation is not None and result.validation["rmse_mV"] < 1.1 * NOISE_MV
    # Nobody doubted the states of charge.
    assert [run["initial_soc"]["std"] for run in result.train_runs] == [None] * 4
    assert result.n_samples == 4 * LENGTH


def test_one_log_that_begins_anywhere_does_not_bend_a_bounded_network() -> None:
    # A single run may explain itself by a wrong start with a wrong curve and gains, as well as by the right ones.
    cut, true = log(after((1.0, 900), (-1.5, 600)), 22)
    judged = [log(np.zeros(1), seed)[0] for seed in (7, 8)]
    result = fit_network([cut], capacity_Ah=CAPACITY_AH, structure="bounded", initial_soc=[true], validate=judged)
    assert result.initial_soc == pytest.approx([true])
    # From rest the same currents leave 2.1 mV, and taken for a log that begins at rest 3.3.
    assert result.validation is not None and result.validation["rmse_mV"] < 2.6
    # What flowed before is supposed: a diagnosis remembers of the log what it would learn of it now.
    grid, kept = to_grid(cut, result.network.structure.dt_s), known_in(result.network)
    again = memory_of([grid], [true], CAPACITY_AH, own_variant(result.network, [grid]))
    assert kept is not None
    np.testing.assert_allclose(kept.elsewhere.unseen_V, again.elsewhere.unseen_V, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(kept.cell.coefficients, again.cell.coefficients, rtol=1e-6)


def test_logs_that_begin_at_rest_keep_their_starts() -> None:
    logs = [log(np.zeros(1), seed) for seed in (4, 5)]
    result = fitted([run for run, _ in logs])
    assert [run["initial_soc"] for run in result.train_runs] == [{"value": true, "std": None} for _, true in logs]
    assert result.train["rmse_mV"] < 1.05 * NOISE_MV


@pytest.mark.proof
def test_wrong_states_of_charge_are_found_as_far_as_the_runs_contradict_each_other() -> None:
    off = (0.05, -0.03, 0.01, -0.03)
    logs = [log(np.zeros(1), seed, wrong) for seed, wrong in enumerate(off, start=11)]
    believed = fitted([run for run, _ in logs])
    doubted = fitted([run for run, _ in logs], initial_soc_std=0.05)
    assert doubted.train["rmse_mV"] < 0.3 * believed.train["rmse_mV"]
    assert doubted.train["rmse_mV"] < 1.2 * NOISE_MV
    assert [run["initial_soc"]["value"] for run in doubted.train_runs] == doubted.initial_soc
    assert doubted.initial_soc == pytest.approx([true for _, true in logs], abs=0.01)
    # What all runs share shows nowhere.
    assert [run["initial_soc"]["std"] for run in doubted.train_runs] == pytest.approx([0.025] * 4, rel=0.1)


def test_contradicting_starts_are_told_from_what_flowed_before() -> None:
    off = np.array([0.012, -0.008, -0.004])
    before = (after((-1.0, 1300), (0.0, 200)), after((0.5, 2500), (0.0, 3600)), after((1.5, 900)))
    left = []
    # Over several draws: where runs hardly overlap, a single one says little of them.
    for first in (51, 71, 91, 111):
        drawn = enumerate(zip(before, off, strict=True), first)
        logs = [log(flowed, seed, float(wrong)) for seed, (flowed, wrong) in drawn]
        data = training([run for run, _ in logs], CAPACITY_AH, dt_s=1.0)
        found = likely_starts(data, cell(), 0.01)
        assert found is not None
        left.append(np.array(found.soc) - np.array([true for _, true in logs]))
        # What all three share stays as it was said.
        assert np.mean(found.soc) == pytest.approx(np.mean(data.soc))
    assert np.sqrt(np.mean(np.square(left))) < 0.6 * np.sqrt(np.mean(off**2))


def test_runs_that_cannot_tell_keep_what_was_said() -> None:
    run, _ = log(np.zeros(1), 61)
    assert likely_starts(training([run], CAPACITY_AH, dt_s=1.0), cell(), 0.005) is None


def test_no_run_begins_more_than_full() -> None:
    said = np.array([0.998, 0.002, 1.003])
    assert within(said + np.array([0.01, -0.01, 0.01]), said) == pytest.approx([1.0, 0.0, 1.003])


def test_a_single_run_cannot_contradict_its_state_of_charge() -> None:
    run, true = log(np.zeros(1), 21, 0.05)
    (said,) = fitted([run], initial_soc_std=0.05).train_runs
    assert said["initial_soc"] == {"value": pytest.approx(true + 0.05), "std": pytest.approx(0.05)}


def test_runs_that_never_meet_do_not_contradict_each_other() -> None:
    logs = [
        log(after((rate, 1500), (0.0, 4000)), seed, off) for rate, seed, off in ((-1.0, 41, -0.05), (1.0, 42, 0.05))
    ]
    # The first 600 s of each: near SoC 0.29 and near 0.71.
    runs = [_first(run, 600) for run, _ in logs]
    data = training(runs, CAPACITY_AH, dt_s=1.0)
    soc, std = joint_soc(cell(), data, data.soc, 0.05)
    assert soc == pytest.approx(data.soc) and std == pytest.approx(0.05)


def _first(run: TimeSeries, n: int) -> TimeSeries:
    assert run.soc_ref is not None
    columns = (run.time_s, run.current_A, run.voltage_V, run.temperature_degC)
    return TimeSeries(*(each[:n] for each in columns), None, run.soc_ref[:n], run.name)


def test_efficiency_reaches_the_model() -> None:
    run, _ = log(np.zeros(1), 31)
    assert fitted([run], coulombic_efficiency=0.98).network.cell.efficiency == 0.98
    with pytest.raises(ModelError, match="coulombic efficiency is 1.2"):
        fitted([run], coulombic_efficiency=1.2)
