"""A current that is missing for minutes: the band says so, and no sensor is blamed."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.timeseries import TimeSeries
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver, ObserverSettings
from models.observer.filter import places
from models.observer.observation import observe
from tests.unit.models.hand_network import CAPACITY_AH, grid_run, hats

SETTINGS = ObserverSettings(
    voltage_std_V=2e-3, quick_error_std_V=1e-3, slow_error_std_V=2e-3, current_offset_std_C=0.01, capacity_std=0.01
)
START, LOST, N = 0.85, slice(900, 2100), 4500
# One C.
LOAD_A = CAPACITY_AH


def network() -> LocalModelNetwork:
    """Without a loop, whose place a lost current leaves open for good."""
    model = hats()
    theta = model.theta.copy()
    theta[:, model.structure.signals.index("hysteresis_state:40")] = 0.0
    return replace(model, theta=theta)


def run_of(current_A: np.ndarray) -> TimeSeries:
    """A load on the cell whose model the observer has, with 1 mV of noise."""
    grid = grid_run(current_A, 20.0)
    volts = free_run_V(network(), grid, START) + 1e-3 * np.random.default_rng(3).standard_normal(N)
    return TimeSeries(grid.time_s, current_A, volts, grid.temperature_degC, None, START + grid.charge_Ah / CAPACITY_AH)


def load(lost_A: float) -> np.ndarray:
    """Pulses around a rest, and a steady load while the current is lost."""
    current_A = np.zeros(N)
    current_A[100:800] = 0.5 * LOAD_A * np.sign(np.sin(np.arange(700) / 20.0))
    current_A[LOST] = lost_A
    return current_A


def without(run: TimeSeries, *, voltage: bool) -> TimeSeries:
    current_A, voltage_V = run.current_A.copy(), run.voltage_V.copy()
    current_A[LOST] = np.nan
    if not voltage:
        voltage_V[LOST] = np.nan
    return replace(run, current_A=current_A, voltage_V=voltage_V)


@pytest.fixture(scope="module", params=["kalman", "steady"])
def observer(request: pytest.FixtureRequest) -> FuzzyObserver:
    return FuzzyObserver(network(), replace(SETTINGS, gain=request.param))


@pytest.mark.parametrize("voltage", [True, False])
@pytest.mark.parametrize("lost_A", [-LOAD_A, -0.3 * LOAD_A])
def test_the_band_holds_and_the_sensors_are_not_blamed(observer: FuzzyObserver, lost_A: float, voltage: bool) -> None:
    run = run_of(load(lost_A))
    found = observe(observer, without(run, voltage=voltage), START, 0.01)
    assert run.soc_ref is not None
    for soc, std in ((found.soc, found.soc_std), (found.smoothed.soc, found.smoothed.soc_std)):
        assert (np.abs(soc - run.soc_ref) < 2.5 * std).all()
    assert found.soc_std[LOST.stop - 1] > 0.05
    # It finds back, and what was known before is not forgotten for it.
    assert abs(found.soc[-1] - run.soc_ref[-1]) < 0.03 and found.soc_std[-1] < 0.03
    assert found.smoothed.soc_std[: LOST.start].max() < 0.02
    _, rows = observer.replay(observer.initial(START, 0.01, 20.0), run.current_A, run.voltage_V, run.temperature_degC)
    _, blind = observer.replay(
        observer.initial(START, 0.01, 20.0),
        without(run, voltage=voltage).current_A,
        without(run, voltage=voltage).voltage_V,
        run.temperature_degC,
    )
    before, at_return = blind[LOST.start - 1], blind[LOST.stop]
    for place in (places.OFFSET_OUT, places.CAPACITY_OUT):
        assert at_return[place] == pytest.approx(before[place], abs=1e-9)
        assert at_return[place + 1] >= before[place + 1] - 1e-12
        assert abs(blind[-1, place] - before[place]) < before[place + 1]
    np.testing.assert_array_equal(rows[: LOST.start], blind[: LOST.start])


def test_the_error_of_the_charge_grows_with_the_time_and_not_with_its_root(observer: FuzzyObserver) -> None:
    nothing, degC = np.full(1200, np.nan), np.full(1200, 20.0)
    state, known = observer.replay(observer.initial(0.6, 0.01, 20.0), np.zeros(60), np.full(60, np.nan), degC[:60])
    _, rows = observer.replay(state, nothing, nothing, degC)
    expected = np.hypot(known[-1, 1], np.arange(1, 1201) / 3600.0)
    np.testing.assert_allclose(rows[:, 1], expected, rtol=0.02)


def test_live_says_what_a_replay_of_the_log_says(observer: FuzzyObserver) -> None:
    run = without(run_of(load(-LOAD_A)), voltage=True)
    found = observe(observer, run, START, 0.01)
    state = observer.initial(START, 0.01, 20.0)
    for k in range(LOST.stop + 100):
        state, said = observer.step(state, run.current_A[k], run.voltage_V[k], run.temperature_degC[k])
        assert (said.soc, said.soc_std) == (found.soc[k], found.soc_std[k])


def test_samples_without_a_current_here_and_there_leave_nothing(observer: FuzzyObserver) -> None:
    run = run_of(load(-0.3 * LOAD_A))
    current_A = run.current_A.copy()
    current_A[50::25] = np.nan
    state = observer.initial(START, 0.01, 20.0)
    _, whole = observer.replay(state, run.current_A, run.voltage_V, run.temperature_degC)
    _, rows = observer.replay(state, current_A, run.voltage_V, run.temperature_degC)
    np.testing.assert_allclose(rows[:, 0], whole[:, 0], atol=0.003)
    assert rows[-1, 1] < 1.2 * whole[-1, 1]
    # An offset of the current sensor is learned all the same, by the gain that learns any.
    told = [observer.told_sensors(each[-1])["current_offset_A"] is not None for each in (rows, whole)]
    assert told == [observer.settings.gain == "kalman"] * 2
