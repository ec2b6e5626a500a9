"""What bad input does to the estimate, and what is said of it."""

import numpy as np
import pytest

from models.data.timeseries import TimeSeries
from models.observer import FuzzyObserver
from models.observer import health as watching
from models.observer.health import MISSING, MODEL, RANGE, STUCK
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic


@pytest.fixture(scope="module")
def run() -> TimeSeries:
    return synthetic.run(2000, seed=11, noise_V=1e-3)


@pytest.fixture(params=["by default", "tuned"])
def observer(request: pytest.FixtureRequest, fitted: FuzzyObserver, tuned: FuzzyObserver) -> FuzzyObserver:
    """What is watched must not depend on where the settings come from."""
    return fitted if request.param == "by default" else tuned


def alarms(observer: FuzzyObserver, run: TimeSeries, voltage: np.ndarray, soc: float = 0.6) -> np.ndarray:
    """(N,) alarm bits over a run."""
    _, rows = observer.replay(observer.initial(soc, 0.05), run.current_A, voltage, run.temperature_degC)
    return watching.watch(rows, voltage)[:, 2].astype(int)


def test_a_model_that_fits_raises_no_alarm(observer: FuzzyObserver, run: TimeSeries) -> None:
    assert not alarms(observer, run, run.voltage_V).any()


def test_a_stuck_sensor_is_named_within_a_minute(observer: FuzzyObserver, run: TimeSeries) -> None:
    voltage = run.voltage_V.copy()
    voltage[1000:] = voltage[999]
    found = alarms(observer, run, voltage)
    assert not found[:1000].any()
    assert (found[1000:1060] & (STUCK | MODEL)).any()
    assert (found[1000:1120] & STUCK).any()


def test_a_reading_that_rests_with_the_cell_is_not_stuck(observer: FuzzyObserver) -> None:
    n = 600
    volts = float(synthetic.ocv_V(np.array([0.6]))[0])
    still = TimeSeries(np.arange(n) * 1.0, np.zeros(n), np.full(n, volts), np.full(n, 25.0))
    assert not (alarms(observer, still, still.voltage_V) & STUCK).any()


def test_a_model_of_another_cell_is_named_within_a_minute(observer: FuzzyObserver, run: TimeSeries) -> None:
    # Another chemistry: lower and flatter; and the same chemistry with three times the resistance.
    other = 3.3 + 0.1 * (run.voltage_V - 3.7) + 0.02 * run.current_A
    worn = run.voltage_V + 0.1 * run.current_A
    for voltage in (other, worn):
        found = alarms(observer, run, voltage)
        assert (found[:60] & MODEL).any()
    row = np.zeros(11)
    row[3], row[4], row[10] = 1.0, 0.01, 50.0
    memory, verdict = watching.step(watching.fresh_memory(), row, 3.0)
    for k in range(20):
        memory, verdict = watching.step(memory, row, 3.0 + 0.001 * k)
    assert "does not fit" in verdict.reasons[0]


def test_missing_voltage_is_coasted_through_and_told(observer: FuzzyObserver, run: TimeSeries) -> None:
    voltage = run.voltage_V.copy()
    voltage[500:900] = np.nan
    found = alarms(observer, run, voltage)
    assert not (found[:550] & MISSING).any()
    assert (found[600:900] & MISSING).all()
    assert not found[960:].any()


def test_a_missing_current_is_bridged_with_a_wider_band(observer: FuzzyObserver, run: TimeSeries) -> None:
    current, voltage = run.current_A.copy(), run.voltage_V.copy()
    current[1000:1030] = voltage[1000:1030] = np.nan
    _, rows = observer.replay(observer.initial(0.6, 0.02), current, voltage, run.temperature_degC)
    assert np.isfinite(rows[:, :3]).all()
    assert rows[1029, 1] > 2.0 * rows[999, 1]
    assert run.soc_ref is not None
    assert abs(rows[-1, 0] - run.soc_ref[-1]) < 0.01


def test_a_state_of_charge_pressed_against_its_limit_is_told(observer: FuzzyObserver) -> None:
    n = 3000
    full = TimeSeries(np.arange(n) * 1.0, np.full(n, 8.0), np.full(n, 5.0), np.full(n, 25.0))
    assert (alarms(observer, full, full.voltage_V) & RANGE)[-1]


def test_live_judges_as_replay_does(observer: FuzzyObserver, run: TimeSeries) -> None:
    _, rows = observer.replay(observer.initial(0.4), run.current_A, run.voltage_V, run.temperature_degC)
    whole = watching.watch(rows, run.voltage_V)
    memory = watching.fresh_memory()
    for k in range(300):
        memory, verdict = watching.step(memory, rows[k], run.voltage_V[k])
        assert (verdict.nis, verdict.correlation, verdict.alarm) == tuple(whole[k])


def test_another_sampling_time_is_put_on_the_models_grid() -> None:
    from models.observer.observation import observe

    runs = [synthetic.run(5000, seed=2, noise_V=1e-3)]
    network = fit_network(runs, capacity_Ah=synthetic.CAPACITY_AH, structure="minimal").network
    quick = synthetic.run(3000, seed=4)
    kept = slice(None, None, 2)
    slower = TimeSeries(
        quick.time_s[kept], quick.current_A[kept], quick.voltage_V[kept], quick.temperature_degC[kept], None, None
    )
    seen = observe(FuzzyObserver(network), slower, 0.6, 0.02)
    assert seen.time_s[1] == pytest.approx(1.0)
    assert np.isnan(seen.innovation_V[1::2]).all() and not np.isnan(seen.innovation_V[2::2]).any()


def test_an_alarm_is_told_once_for_as_long_as_it_lasts(observer: FuzzyObserver, run: TimeSeries) -> None:
    watcher, state, told = watching.Watcher(), observer.initial(0.6, 0.05), []
    for k in range(200):
        voltage = np.nan if 20 <= k < 120 else run.voltage_V[k]
        state, out = observer.step(state, run.current_A[k], voltage, run.temperature_degC[k])
        watcher.step(out, voltage)
        told += [(k, reason) for reason in watcher.new_alarms()]
    assert [(k, reason.partition(":")[0]) for k, reason in told] == [(79, "no voltage for too long")]


def test_innovations_a_little_too_large_for_long_add_up_and_are_forgotten() -> None:
    row, memory = np.zeros(11), watching.fresh_memory()
    row[4] = 0.01
    alarmed = []
    for k in range(600):
        row[3] = (0.018 if 100 <= k < 300 else 0.01) * (-1.0) ** k
        memory, verdict = watching.step(memory, row, 3.0 + 0.001 * k)
        alarmed.append(bool(verdict.alarm & MODEL))
    # 1.8 standard deviations each time: 3.24 on average where 1 is assumed and 2 allowed.
    assert not any(alarmed[:130]) and alarmed[160] and alarmed[299] and not any(alarmed[420:])


def test_white_innovations_of_the_assumed_size_are_no_alarm() -> None:
    rng = np.random.default_rng(8)
    rows = np.zeros((200_000, 11))
    rows[:, 3], rows[:, 4] = 0.01 * rng.standard_normal(len(rows)), 0.01
    assert not watching.watch(rows, 3.0 + 1e-4 * np.arange(len(rows)))[:, 2].any()
