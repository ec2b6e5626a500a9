"""Where a log begins: cut in a pulse, in a relaxation, on either branch of the loop; at rest; at a wrong SoC."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.comparison.start import Start, dies_out, free_run_from_V
from models.comparison.start_fit import start_from_head, start_from_run
from models.comparison.start_noise import ErrorModel, seen_error_model, whitener
from models.data.history import StartHistory, going_on
from models.data.resampling import GridRun
from models.network.free_run import free_run_V, memory_s
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.uncertainty.correlation import ResidualCorrelation
from tests.unit.models.hand_network import CAPACITY_AH, SCALING, grid_run, network

NOISE_V = 1e-3
LENGTH = 6000


def cell(order: int) -> LocalModelNetwork:
    """Open-circuit voltage over three local models, two slow branches, a loop of +-30 mV."""
    inputs = ("low_pass:30", "low_pass:900", "hysteresis_state:20")
    channels = (
        InputChannel("soc", delay=1),
        InputChannel("current", order=1),
        *(InputChannel(each) for each in inputs),
    )
    structure = Structure(order, channels, (PartitionAxis("soc", initial=3, k_sigma=0.5),), 1.0)
    past = [[], [0.96], [1.6, -0.62]][order]
    gain = 1.0 - sum(past)
    lines = ((0.9, 3.1), (0.4, 3.25), (0.8, 3.1))
    rows = [
        [*past, *(gain * np.array([slope, 0.01, 0.004, 0.01, 0.02, 0.03, offset])).tolist()] for slope, offset in lines
    ]
    return network(
        structure, np.array(rows), scaling={**SCALING, "low_pass:900": (-3, 3), "hysteresis_state:20": (-1, 1)}
    )


def pulses_A(before_A: np.ndarray, seed: int) -> np.ndarray:
    """A current that is known, then random pulses between SoC 0.25 and 0.8."""
    rng = np.random.default_rng(seed)
    current, soc = before_A.tolist(), 0.5 + float(before_A.sum()) / 3600.0 / CAPACITY_AH
    while len(current) < len(before_A) + LENGTH:
        length, drawn = int(rng.integers(20, 400)), float(rng.choice([0.0, *rng.uniform(-2.0, 2.0, 3)]))
        if not 0.25 < soc + drawn * length / 3600.0 / CAPACITY_AH < 0.8:
            drawn = -drawn
        current += [drawn] * length
        soc += drawn * length / 3600.0 / CAPACITY_AH
    return np.array(current[: len(before_A) + LENGTH])


def cut(model: LocalModelNetwork, before_A: np.ndarray, seed: int) -> tuple[GridRun, float]:
    """What is measured after `before_A`, and the state of charge where that begins."""
    whole = grid_run(pulses_A(before_A, seed), 25.0)
    noise_V = NOISE_V * np.random.default_rng(seed + 1).standard_normal(len(whole))
    voltage_V, n = free_run_V(model, whole, 0.5) + noise_V, len(before_A)
    log = grid_run(whole.current_A[n:], 25.0)
    soc = 0.5 + float(whole.charge_Ah[n]) / CAPACITY_AH
    return replace(log, voltage_V=voltage_V[n:], measured=np.ones(len(log), dtype=bool)), soc


def rms_V(model: LocalModelNetwork, run: GridRun, start: Start) -> float:
    return float(np.sqrt(np.mean((run.voltage_V - free_run_from_V(model, run, start)) ** 2)))


def after(*steps: tuple[float, int]) -> np.ndarray:
    """Current of so many A for so many s each."""
    return np.concatenate([np.full(length, current_A) for current_A, length in steps])


BEFORE = {
    "in a pulse": after((0.0, 600), (1.0, 700), (-1.5, 45)),
    "in a relaxation": after((-1.0, 1500), (0.0, 200)),
    "on the upper branch": after((0.5, 2500), (0.0, 3600)),
    "on the lower branch": after((-0.5, 2500), (0.0, 3600)),
}


@pytest.mark.parametrize("where", BEFORE)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_log_that_begins_anywhere_is_simulated_at_the_noise(order: int, where: str) -> None:
    model = cell(order)
    run, soc = cut(model, BEFORE[where], seed=3)
    found = start_from_run(model, run, Start(soc))
    assert rms_V(model, run, Start(soc)) > 1.5 * NOISE_V
    assert rms_V(model, run, found) < 1.05 * NOISE_V
    assert found.initial_soc == soc and found.soc_std is None


@pytest.mark.parametrize("order", [0, pytest.param(2, marks=pytest.mark.proof)])
def test_a_wrong_soc_is_found_with_a_deviation_that_holds(order: int) -> None:
    model, off = cell(order), []
    for seed, where in enumerate([*BEFORE, *BEFORE]):
        run, soc = cut(model, BEFORE[where], seed)
        found = start_from_run(model, run, Start(soc + 0.05 * (-1) ** seed, 0.05))
        assert found.soc_std is not None and found.soc_std < 0.01
        assert abs(found.initial_soc - soc) < 0.01
        off.append((found.initial_soc - soc) / found.soc_std)
    assert np.mean(np.abs(off) < 1.96) >= 0.85
    assert np.sqrt(np.mean(np.square(off))) < 1.6


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_log_that_begins_at_rest_keeps_its_start(seed: int) -> None:
    model = cell(1)
    run, soc = cut(model, np.zeros(1), seed)
    assert start_from_run(model, run, Start(soc)) == Start(soc)
    assert start_from_head(model, run, Start(soc)) == Start(soc)
    confirmed = start_from_run(model, run, Start(soc, 0.05))
    assert confirmed.initial_soc == soc and confirmed.history is None
    assert confirmed.soc_std is not None and confirmed.soc_std < 0.01


def test_a_flat_open_circuit_curve_leaves_the_soc_where_it_was() -> None:
    model = network(Structure(0, (InputChannel("current"),), (PartitionAxis("soc"),), 1.0), np.array([[0.02, 3.3]]))
    run, soc = cut(model, np.zeros(1), 1)
    assert start_from_run(model, run, Start(soc + 0.05, 0.05)).soc_std == pytest.approx(0.05, rel=0.01)


def test_slow_errors_of_a_model_do_not_pass_for_a_start() -> None:
    model = cell(0)
    run, soc = cut(model, np.zeros(1), 1)
    rng, slow = np.random.default_rng(2), np.zeros(len(run))
    for k in range(1, len(run)):
        slow[k] = 0.998 * slow[k - 1] + 5e-4 * rng.standard_normal()
    assert start_from_run(model, replace(run, voltage_V=run.voltage_V + slow), Start(soc)).history is None


def test_the_first_minute_shows_a_start_that_is_far_from_rest() -> None:
    model = cell(0)
    run, soc = cut(model, after((-3.0, 1500), (0.0, 20)), seed=5)
    placed = start_from_head(model, run, Start(soc))
    assert placed.history is not None
    assert rms_V(model, run, placed) < 0.7 * rms_V(model, run, Start(soc))
    later = run.voltage_V + np.where(run.time_s > 60.0, 0.1, 0.0)
    assert start_from_head(model, replace(run, voltage_V=later), Start(soc)) == placed


def passed_soc(start: Start) -> list[float]:
    """State of charge at each edge of the windows before a start, the newest first."""
    assert start.history is not None
    moved = np.array(start.history.currents_A) * np.diff(start.history.edges_s) / 3600.0 / CAPACITY_AH
    return (start.initial_soc - np.cumsum(moved)).tolist()


@pytest.mark.parametrize(("soc", "is_possible"), [(0.6, True), (0.99, False)])
def test_nothing_flowed_before_that_the_charge_of_the_cell_does_not_allow(soc: float, is_possible: bool) -> None:
    model = cell(0)
    run = grid_run(after((0.0, 5), (-0.5, 1500)), 25.0)
    edges_s = (0.0, 20.0, 120.0, 600.0, 3600.0)
    hard = Start(soc, history=StartHistory(edges_s, (-3.0, -3.0, -3.0, -0.2)))
    noise_V = NOISE_V * np.random.default_rng(5).standard_normal(len(run))
    voltage_V = free_run_from_V(model, run, hard) + noise_V
    run = replace(run, voltage_V=voltage_V, measured=np.ones(len(run), dtype=bool))
    found = start_from_run(model, run, Start(soc))
    if is_possible:
        assert found.history is not None and min(found.history.currents_A) < -1.0
    assert found.history is None or -0.021 < min(passed_soc(found)) <= max(passed_soc(found)) < 1.021


def test_a_start_that_grows_after_the_minute_that_it_was_found_by_is_none() -> None:
    inputs = ("low_pass:3600", "low_pass:2400")
    structure = Structure(0, tuple(InputChannel(each) for each in inputs), (PartitionAxis("soc"),), 1.0)
    gains = 5.0, -4.77  # They cancel after hours of the same current, for as long as neither has forgotten it.
    model = network(structure, np.array([[*gains, 3.3]]), scaling={**SCALING, **dict.fromkeys(inputs, (0.0, 1.0))})
    run = grid_run(np.zeros(9000), 25.0)
    slow, quick = (StartHistory((0.0, age_s), (-0.3,)) for age_s in (10_800.0, 20.0))
    rest = Start(0.5)
    assert not dies_out(model, run, (rest, Start(0.5, history=slow)), 60.0)
    assert dies_out(model, run, (rest, Start(0.5, history=quick)), 60.0)
    assert dies_out(model, run, (rest, rest), 60.0)


def test_a_log_that_begins_in_the_middle_goes_on_as_it_went() -> None:
    model, rng = cell(0), np.random.default_rng(7)
    whole = grid_run(-0.4 + rng.choice([-0.6, 0.6], 600).repeat(5), 25.0)
    # By a minute beside such an error of the model no start can be fitted; which of two is likelier can be told.
    error_V = 0.012 * np.sin(np.arange(3000) / 500.0) + NOISE_V * rng.standard_normal(3000)
    log, half = grid_run(whole.current_A[1500:], 25.0), slice(1500, None)
    log = replace(log, voltage_V=(free_run_V(model, whole, 0.9) + error_V)[half], measured=np.ones(1500, dtype=bool))
    soc = 0.9 + float(whole.charge_Ah[1500]) / CAPACITY_AH
    found = start_from_head(model, log, Start(soc))
    assert found.history is not None
    assert found.history.currents_A[:3] == going_on(log, found.history.edges_s).currents_A[:3]
    assert rms_V(model, log, found) < 0.5 * rms_V(model, log, Start(soc))
    assert -0.021 < min(passed_soc(found)) <= max(passed_soc(found)) < 1.021
    rested = replace(log, voltage_V=free_run_V(model, log, soc) + error_V[half])
    assert start_from_head(model, rested, Start(soc)) == Start(soc)


def test_a_model_without_memory_has_little_to_remember() -> None:
    structure = Structure(0, (InputChannel("soc", delay=1), InputChannel("low_pass:30")), (PartitionAxis("soc"),), 1.0)
    assert memory_s(network(structure, np.array([[0.7, 0.01, 3.4]]))) == pytest.approx(120.0)
    assert memory_s(cell(0)) == 10_800.0


def test_whitened_means_are_white() -> None:
    rng, keep, level_V = np.random.default_rng(4), 0.98, 2e-3
    expected = ErrorModel(level_V, ResidualCorrelation(0.3, np.array([0.7]), np.array([keep])))
    white = whitener(np.ones(400, dtype=bool), expected)
    drawn = []
    for _ in range(400):
        fading = np.empty(400)
        fading[0] = rng.standard_normal()
        for k in range(1, 400):
            fading[k] = keep * fading[k - 1] + np.sqrt(1.0 - keep**2) * rng.standard_normal()
        drawn.append(white.white(level_V * (np.sqrt(0.7) * fading + np.sqrt(0.3) * rng.standard_normal(400))))
    covariance = np.cov(np.array(drawn).T)
    assert np.diag(covariance) == pytest.approx(1.0, abs=0.35)
    assert np.mean(np.diag(covariance)) == pytest.approx(1.0, abs=0.03)
    assert np.abs(covariance - np.diag(np.diag(covariance))).mean() < 0.06


def test_the_level_of_an_error_is_its_own() -> None:
    error_V = 3e-3 * np.random.default_rng(1).standard_normal(5000)
    error_V[100:200] = np.nan
    found = seen_error_model([error_V])
    assert found.level_V == pytest.approx(3e-3, rel=0.05) and found.correlation.white > 0.95
