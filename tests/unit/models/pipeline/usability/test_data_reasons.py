"""What runs leave open is said in a laboratory's words; a good record has nothing said of it."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.timeseries import TimeSeries
from models.pipeline.training import Training
from models.pipeline.usability.coverage import not_covered
from models.pipeline.usability.direction import one_direction
from models.pipeline.usability.judge import judged_data
from models.pipeline.usability.offset import suspected_offset
from models.pipeline.usability.reason import Reason, Verdict, limited, unusable, usability
from models.pipeline.usability.resolution import coarse_values, rounding
from models.pipeline.usability.rests import no_rest
from models.pipeline.usability.sampling import logged_too_slowly, samples_a_level
from models.pipeline.usability.start import soc_on_trust
from models.pipeline.usability.steps import no_steps
from models.pipeline.usability.temperature import interrupted_temperature, no_temperature
from tests.unit.models.pipeline.usability.hand_data import pulses, run, taken

GOOD = run(pulses(), 0.6)


def texts(reasons: list[Reason]) -> str:
    assert all(reason.verdict == Verdict.LIMITED for reason in reasons)
    return " ".join(reason.text for reason in reasons)


def cc_cv(cycles: int = 2) -> TimeSeries:
    """Charge at 1C with a taper, a rest, a discharge at 1C, a rest."""
    taper = 2.0 * np.exp(-np.arange(180) / 60.0)
    one = np.concatenate([np.zeros(60), np.full(270, 2.0), taper, np.zeros(60), np.full(320, -2.0)])
    return run(np.tile(one, cycles), 0.05)


def test_a_good_record_has_nothing_said_of_it() -> None:
    assert judged_data(taken(GOOD)) == []


def test_the_verdict_is_that_of_the_worst_reason_which_comes_first() -> None:
    assert usability([]) == {"verdict": "usable", "reasons": []}
    assert usability([limited("a"), unusable("b"), limited("a")]) == {"verdict": "unusable", "reasons": ["b", "a"]}


def test_one_direction_only() -> None:
    charge = run(pulses(least=0.0, most=0.6), 0.3)
    assert texts(one_direction(taken(charge))).startswith("charge only")
    assert texts(one_direction(taken(run(-charge.current_A, 0.7)))).startswith("discharge only")
    assert one_direction(taken(charge, GOOD)) == []


def test_constant_current_only() -> None:
    assert texts(no_steps(taken(cc_cv()))).startswith("constant current only (CC-CV)")
    assert no_steps(taken(cc_cv(), GOOD)) == [] or "not known at" in texts(no_steps(taken(cc_cv(), GOOD)))


def test_other_rates_in_the_same_direction_tell_the_resistance() -> None:
    slow = run(np.concatenate([np.zeros(60), np.full(1300, -0.5)]), 0.95, name="slow")
    fast = run(np.concatenate([np.zeros(60), np.full(330, -2.0)]), 0.95, name="fast")
    pulsed = run(np.concatenate([pulses(240), np.full(200, 0.4)]), 0.4, name="pulsed")
    assert "constant current" in texts(no_steps(taken(slow, replace(slow, name="again"), pulsed)))
    assert no_steps(taken(slow, fast, pulsed)) == []


def test_a_part_without_steps_is_named() -> None:
    stepped = run(np.concatenate([pulses(720), np.full(720, 0.8)]), 0.5)
    assert "not known at a state of charge of 0." in texts(no_steps(taken(stepped)))


def test_start_on_trust() -> None:
    moving = run(pulses(rest=0)[12:], 0.6)
    assert "on trust" in texts(soc_on_trust(taken(moving)))
    assert soc_on_trust(taken(moving, GOOD)) == []
    full = replace(moving, soc_ref=np.where(moving.time_s == 0.0, 1.0, np.nan))
    assert soc_on_trust(taken(full)) == []
    data = taken(moving)
    stated = replace(data, starts=[replace(start, soc_std=0.01) for start in data.starts])
    assert soc_on_trust(stated) == []
    # A rest whose voltage is still on its way anchors nothing.
    drifting = replace(GOOD, voltage_V=GOOD.voltage_V + 0.1 * np.exp(-GOOD.time_s / 600.0))
    assert "on trust" in texts(soc_on_trust(taken(drifting)))


def test_slow_logging() -> None:
    assert logged_too_slowly(taken(GOOD)) == []
    slow = run(pulses(240), 0.6, dt_s=60.0)
    assert texts(logged_too_slowly(taken(slow, dt_s=60.0))).startswith("logged slowly: one sample every 60 s")
    drawn = np.random.default_rng(1).uniform(-1.0, 1.0, 300)
    drawn[:3] = 0.0
    erratic = run(drawn - drawn.mean(), 0.5, dt_s=60.0)
    assert texts(logged_too_slowly(taken(erratic, dt_s=60.0))).startswith("logged too slowly")
    assert samples_a_level([run(np.zeros(50), 0.5)]) == np.inf


def test_coarse_values() -> None:
    assert coarse_values(taken(GOOD)) == []
    volts = replace(GOOD, voltage_V=0.02 * np.round(GOOD.voltage_V / 0.02))
    assert "steps of 20 mV" in texts(coarse_values(taken(volts)))
    amperes = replace(GOOD, current_A=0.15 * np.round(GOOD.current_A / 0.15))
    assert "steps of 0.15 A" in texts(coarse_values(taken(amperes)))


@pytest.mark.parametrize("step", [1e-3, 0.02])
def test_rounding_is_found_in_spite_of_a_few_odd_values(step: float) -> None:
    values = step * np.round(np.random.default_rng(0).normal(3.5, 0.1, 5000) / step)
    values[::500] += 0.3 * step
    assert rounding(values) == pytest.approx(step)
    assert rounding(np.random.default_rng(0).normal(3.5, 0.1, 5000)) < 1e-5


def test_a_gap_that_all_runs_share() -> None:
    def at(soc: float) -> TimeSeries:
        return run(pulses(480, least=-0.5, most=0.5), soc, name=f"{soc}")

    assert not_covered(taken(GOOD)) == []
    assert "no run measured anything at a state of charge of" in texts(not_covered(taken(at(0.2), at(0.8))))
    level = run(np.tile([0.0, 0.4, 0.4, -0.4, -0.4], 100), 0.5)
    assert "the runs stay at" in texts(not_covered(taken(level)))


def test_an_offset_is_suspected_where_the_sensor_reads_something_at_rest() -> None:
    rng = np.random.default_rng(5)
    noisy = replace(GOOD, current_A=GOOD.current_A + 2e-3 * rng.standard_normal(len(GOOD)))
    assert suspected_offset(taken(noisy)) == []
    off = replace(noisy, current_A=noisy.current_A + 0.02)
    assert "reads +20 mA with the output off" in texts(suspected_offset(taken(off)))


def test_small_currents_are_no_offset_where_a_long_rest_reads_nothing() -> None:
    rng = np.random.default_rng(5)
    loads = pulses(1440, rest=60)
    small = np.where((loads == 0.0) & (np.arange(1440) >= 60), 0.02, loads)
    night = np.concatenate([np.zeros(4000), small]) + 2e-3 * rng.standard_normal(5440)
    assert suspected_offset(taken(run(night, 0.6))) == []
    assert "offset" in texts(suspected_offset(taken(run(night + 0.02, 0.6))))


def test_an_offset_is_suspected_where_the_count_drifts_from_a_reference() -> None:
    never_at_rest = run(np.where(pulses() == 0.0, -0.3, pulses()), 0.9)
    true = 0.9 + np.concatenate([[0.0], np.cumsum(never_at_rest.current_A[1:])]) * 10.0 / 3600.0 / 2.0
    with_reference = replace(never_at_rest, soc_ref=true)
    assert suspected_offset(taken(with_reference)) == []
    off = replace(with_reference, current_A=with_reference.current_A + 0.02)
    assert "drifts from the runs' reference by +20 mA" in texts(suspected_offset(taken(off)))


def runs_of_a_tester(counter_Ah: float, offset_A: float = 0.0, pauses: int = 0) -> list[TimeSeries]:
    """Constant currents after a short rest, and a counter that runs along, half a sample apart at a step."""
    runs = []
    for name, current_A, n in (("slow", -0.6, 9000), ("middle", -2.0, 3000), ("fast", -5.5, 1060)):
        drawn = np.full(n, current_A)
        drawn[:20] = 0.0
        for part in np.array_split(np.arange(20, n), pauses + 1)[1:]:
            drawn[part[: len(part) // 3]] = -0.3
        charge_As = np.concatenate([[0.0], np.cumsum(0.5 * (drawn[1:] + drawn[:-1]))])
        counter = np.round(1.0 + charge_As / 3600.0 / counter_Ah, 5)
        runs.append(replace(run(drawn + offset_A, 1.0, dt_s=1.0, name=name), soc_ref=counter))
    return runs


@pytest.mark.parametrize("counter_Ah", [2.0, 2.018, 1.98, 1.94])
def test_a_capacity_that_is_off_is_no_offset_where_charge_moves_as_time_does(counter_Ah: float) -> None:
    assert suspected_offset(taken(*runs_of_a_tester(counter_Ah), dt_s=1.0)) == []


@pytest.mark.parametrize("counter_Ah", [2.0, 2.018, 1.94])
def test_an_offset_is_told_beside_a_capacity_that_is_off(counter_Ah: float) -> None:
    # The current hardly ever stands at zero: the reference alone tells.
    told = texts(suspected_offset(taken(*runs_of_a_tester(counter_Ah, offset_A=-0.04, pauses=3), dt_s=1.0)))
    assert "drifts from the runs' reference by -40 mA" in told


def test_loads_without_a_rest() -> None:
    never = np.where(np.abs(pulses()) < 0.1, -0.3, pulses())
    assert texts(no_rest(taken(run(never, 0.9)))).startswith("no rest between loads")
    assert no_rest(taken(run(never, 0.9), GOOD)) == []


def test_a_missing_temperature() -> None:
    cold = replace(GOOD, temperature_degC=np.full(len(GOOD), np.nan), name="cold")
    assert texts(no_temperature(taken(cold))).startswith("no run has a temperature")
    assert texts(no_temperature(taken(cold, GOOD))).startswith("no temperature in cold")
    assert no_temperature(taken(GOOD)) == []


def test_a_temperature_that_is_lost() -> None:
    lost = replace(GOOD, temperature_degC=np.where(GOOD.time_s < 3.0, GOOD.temperature_degC, np.nan), name="lost")
    assert f"missing in lost ({GOOD.duration_s:.0f} s at a time)" in texts(interrupted_temperature(taken(lost, GOOD)))
    for now_and_then in (GOOD, replace(lost, temperature_degC=np.where(GOOD.time_s % 60.0 == 0.0, 25.0, np.nan))):
        assert interrupted_temperature(taken(now_and_then)) == []
    nowhere = replace(GOOD, temperature_degC=np.full(len(GOOD), np.nan))
    assert interrupted_temperature(taken(nowhere)) == []  # said in other words


def test_every_kind_is_asked() -> None:
    data: Training = taken(cc_cv())
    found = texts(judged_data(data))
    assert "CC-CV" in found
