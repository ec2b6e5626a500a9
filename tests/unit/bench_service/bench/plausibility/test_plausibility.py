"""Simulated cells seen through noisy sensors: normal running says nothing, each way to be wrong is seen in its time."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bench_service.bench.plausibility import Finding, Sample, Watch, band_of, observe
from bench_service.bench.plausibility.warmth import STUCK_REPEATS
from simulators.catalogue import cell_type
from simulators.cell import Cell
from simulators.sensors import SensorParameters, Sensors

DT_S, LEAST_A = 0.1, 0.15
BEGIN_S = 14.5  # of what goes wrong in the middle of a pulse
Spoil = Callable[[Sample, Sample], Sample]  # first sample, this one


def pulses(high_A: float, low_A: float) -> np.ndarray:
    """Rest, then pulses of 5 s both ways with rests between."""
    return np.concatenate([np.zeros(20), np.tile(np.repeat([high_A, 0.0, low_A, 0.0], 50), 4)])


def samples(cell: str, current_A: np.ndarray, short_Ohm: float | None = None) -> Iterator[Sample]:
    kind = cell_type(cell)
    truth, sensors = Cell(kind.parameters), Sensors(SensorParameters(), np.random.default_rng(3))
    voltage_V = truth.step(0.0, 0.0).voltage_V
    for k, value in enumerate(current_A):
        leak_A = voltage_V / short_Ohm if short_Ohm is not None and k * DT_S >= BEGIN_S else 0.0
        out = truth.step(float(value) - leak_A, DT_S)
        voltage_V = out.voltage_V
        seen = sensors.measure(out, float(value), 25.0)
        yield Sample(k * DT_S, seen.voltage_V, seen.current_A, seen.temperature_degC)


def play(
    cell: str, current_A: np.ndarray, spoil: Spoil, short_Ohm: float | None = None
) -> tuple[float, Finding] | None:
    """Return when the rules trip, and why."""
    kind = cell_type(cell)
    band, watch = band_of(kind.parameters.capacity_Ah, kind.limits.voltage_V), Watch()
    first = None
    for sample in samples(cell, current_A, short_Ohm):
        first = sample if first is None else first
        watch, finding = observe(watch, band, spoil(first, sample), LEAST_A)
        if finding is not None and finding.stage == "trip":
            return sample.time_s, finding
    return None


def currents(cell: str, share: float = 0.8) -> np.ndarray:
    low_A, high_A = cell_type(cell).limits.current_A
    return pulses(share * high_A, share * low_A)


def later(change: Callable[[Sample], Sample]) -> Spoil:
    return lambda _, sample: change(sample) if sample.time_s >= BEGIN_S else sample


@pytest.mark.parametrize("cell", ["nmc", "lfp", "nimh"])
def test_normal_running_says_nothing(cell: str) -> None:
    assert play(cell, currents(cell), lambda _, sample: sample) is None


HIGH = {"resistance_high", "voltage_jump"}
STUCK_S = STUCK_REPEATS * DT_S + 0.2


@pytest.mark.parametrize("cell", ["nmc", "lfp", "nimh"])
@pytest.mark.parametrize(
    ("spoil", "codes", "from_s", "within_s"),
    [
        # From the first pulse on, at 2 s.
        (lambda first, s: replace(s, voltage_V=first.voltage_V), {"voltage_stuck", "resistance_low"}, 2.0, 1.0),
        (lambda first, s: replace(s, voltage_V=2 * first.voltage_V - s.voltage_V), {"reversed_current"}, 2.0, 1.0),
        (lambda first, s: replace(s, voltage_V=s.voltage_V + 30 * round(s.current_A)), HIGH, 2.0, 1.0),
        (later(lambda s: replace(s, voltage_V=s.voltage_V + 0.2)), {"voltage_jump"}, BEGIN_S, 0.3),
        (later(lambda s: replace(s, voltage_V=s.voltage_V - 0.8)), {"voltage_jump"}, BEGIN_S, 0.3),
        (later(lambda s: replace(s, temperature_degC=25.5)), {"temperature_stuck"}, BEGIN_S, STUCK_S),
    ],
)
def test_what_is_wrong_is_seen(cell: str, spoil: Spoil, codes: set[str], from_s: float, within_s: float) -> None:
    found = play(cell, currents(cell), spoil)
    assert found is not None
    time_s, finding = found
    assert finding.code in codes, finding.text
    assert from_s <= time_s <= from_s + within_s


def test_a_reversed_map_shows_at_the_first_ampere() -> None:
    found = play("nmc", pulses(1.0, -1.0), lambda first, s: replace(s, voltage_V=2 * first.voltage_V - s.voltage_V))
    assert found is not None and found[1].code == "reversed_current" and found[0] < 3.0


@pytest.mark.parametrize("current_A", [0.0, 1.0])
def test_a_short_inside(current_A: float) -> None:
    """0.1 Ohm: 3.70 V to 2.87 V, and 6 K in 12 s."""
    found = play("nmc", np.full(400, current_A), lambda _, s: s, short_Ohm=0.1)
    assert found is not None and found[1].code == "voltage_jump" and found[0] < BEGIN_S + 0.3


@pytest.mark.parametrize("after", range(5))
def test_a_short_that_comes_with_a_step_of_the_current(after: int) -> None:
    """What is known of the resistance is from before the jump, whichever sample after a step it comes with."""
    step_s = np.array([2.0, 4.0, -3.0, 1.0])
    current_A = np.concatenate([np.zeros(20), np.repeat(np.tile(step_s, 8), 5)])
    short_at_s = BEGIN_S - 0.2 + after * DT_S
    times_s = np.arange(len(current_A)) * DT_S

    def short(_: Sample, s: Sample) -> Sample:
        return replace(s, voltage_V=s.voltage_V - 0.74) if s.time_s >= short_at_s - 1e-6 else s

    assert times_s[-1] > short_at_s + 0.3
    found = play("nmc", current_A, short)
    assert found is not None and found[1].code == "voltage_jump" and found[0] < short_at_s + 0.3


def test_a_voltage_that_is_held_to_the_last_bit_is_not_stuck() -> None:
    """Constant voltage on a cycler of 1 mV: the current fades, the voltage stays."""
    band, watch = band_of(60.0, (2.5, 4.2)), Watch()
    for k in range(600):
        now = Sample(float(k), 4.2, 15.0 * float(np.exp(-k / 150.0)), 25.0 + 0.1 * (k % 3))
        watch, finding = observe(watch, band, now, LEAST_A)
        assert finding is None, (k, finding)
    for k in range(6):
        watch, finding = observe(watch, band, Sample(600.0 + k, 4.2, 40.0 + k, 25.0 + 0.1 * (k % 3)), LEAST_A)
    assert finding is not None and finding.code == "voltage_stuck"


def test_a_voltage_that_stands_still_while_the_cell_is_charged() -> None:
    """Constant current has no steps that would tell: a noisy reading that repeats itself for minutes does."""
    found = play("nmc", np.full(3000, 1.0), later(lambda s: replace(s, voltage_V=3.8)))
    assert found is not None and found[1].code == "voltage_stuck" and found[0] < BEGIN_S + 125.0


def test_a_coarse_voltage_on_a_flat_curve_does_not_stand_still() -> None:
    """1 mV of resolution, no noise: the voltage of a slow discharge is the same for minutes, and always was."""
    band, watch = band_of(2.5, (2.0, 3.6)), Watch()
    for k in range(20_000):
        now = Sample(float(k), round(3.3 - 4e-6 * k, 3), -0.25, 25.0 + 0.1 * (k % 3))
        watch, finding = observe(watch, band, now, LEAST_A)
        assert finding is None, (k, finding)


def test_a_record_that_begins_under_load_is_not_reversed() -> None:
    """A drive cycle's log at -10 degC, by the second: what still relaxes is no answer to small steps."""
    current_A = [-1.67, -1.5218, -1.5058, -1.7406, -1.7645, -1.7669, -1.7684, -1.7699, -1.5285, -1.758, -2.0212]
    voltage_V = [3.9162, 3.8034, 3.7908, 3.7571, 3.7443, 3.7396, 3.7363, 3.7335, 3.7591, 3.7363, 3.6999]
    band, watch = band_of(2.9, (2.5, 4.2)), Watch()
    for k, (each_A, each_V) in enumerate(zip(current_A, voltage_V, strict=True)):
        watch, finding = observe(watch, band, Sample(float(k), each_V, each_A, -10.0 + 0.1 * (k % 3)), LEAST_A)
        assert finding is None, (k, finding)


def test_days_between_two_samples_are_no_jump() -> None:
    band, watch = band_of(2.0, (2.0, 3.6)), Watch()
    for time_s, voltage_V in ((0.0, 2.0663), (1.0, 2.0707), (154_153.0, 2.6798), (154_213.0, 2.6799)):
        watch, finding = observe(watch, band, Sample(time_s, voltage_V, 0.0, 25.0), LEAST_A)
        assert finding is None


def test_a_temperature_that_rises_by_itself() -> None:
    found = play("nmc", np.zeros(400), lambda _, s: replace(s, temperature_degC=25 + 0.5 * s.time_s))
    assert found is not None and found[1].code == "temperature_rate" and found[0] < 10.0


def test_a_temperature_that_was_stuck_from_the_start_shows_by_the_heat() -> None:
    steady = np.concatenate([np.zeros(20), np.tile(np.repeat([5.0, -10.0], [200, 100]), 30)])
    found = play("nmc", steady, lambda _, s: replace(s, temperature_degC=25.0))
    assert found is not None and found[1].code == "temperature_stuck" and found[0] < 400.0


def test_more_charge_than_the_cell_holds() -> None:
    band, watch, codes = band_of(2.5, (2.5, 4.2)), Watch(), list[str]()
    for k in range(150):
        watch, finding = observe(watch, band, Sample(60.0 * k, 3.7 + 0.01 * (k % 2), -2.5, 25.0 + k % 2), LEAST_A)
        codes += [] if finding is None else [f"{finding.stage} {finding.code}"]
    assert codes[0] == "warn charge_moved" and "trip charge_moved" in codes
    assert 6 <= codes.index("trip charge_moved") <= 20


def test_a_missing_value_is_passed_over() -> None:
    watch = Watch(last=Sample(0.0, 3.7, 0.0, 25.0))
    assert observe(watch, band_of(2.5, (2.5, 4.2)), Sample(0.1, float("nan"), 0.0, 25.0), LEAST_A) == (watch, None)


def test_cells_in_series_have_wider_bands() -> None:
    one, four = band_of(2.5, (2.5, 4.2)), band_of(2.5, (10.0, 16.8))
    assert (one.cells_in_series, four.cells_in_series) == (1, 4)
    assert four.possible_Ohm == tuple(4 * value for value in one.possible_Ohm)
