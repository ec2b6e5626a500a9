"""Every kind of step and end, on a simulated cell: which sample ends what, what follows, and what has been moved."""

from __future__ import annotations

import numpy as np
import pytest

from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.counters import Ending
from bench_service.protocol.document import read_protocol
from bench_service.protocol.laws import Law, Seen
from bench_service.protocol.program import Play, Window
from bench_service.protocol.response import Response
from bench_service.protocol.tables import cycle_table
from simulators.catalogue import CELLS
from tests.unit.bench_service.protocol.protocol_rig import NOISELESS, document, play, program_of, window_of

REST = {"step": "rest", "until": {"time_s": 60}}


def endings(played) -> list[Ending]:
    return [each.ended_by for each in played.ended]


@pytest.mark.parametrize(
    ("step", "ending", "check"),
    [
        ({"step": "constant_current", "rate_C": 1, "until": {"voltage_V": 4.0}}, Ending.VOLTAGE, ("voltage_V", 4.0, 1)),
        (
            {"step": "constant_current", "rate_C": -1, "until": {"voltage_V": 3.4}},
            Ending.VOLTAGE,
            ("voltage_V", 3.4, -1),
        ),
        ({"step": "power", "power_W": -8, "until": {"voltage_V": 3.4}}, Ending.VOLTAGE, ("voltage_V", 3.4, -1)),
        (
            {"step": "resistance", "resistance_Ohm": 2, "until": {"voltage_V": 3.4}},
            Ending.VOLTAGE,
            ("voltage_V", 3.4, -1),
        ),
        (
            {"step": "power", "power_W": -8, "until": {"current_A": {"above": 2.3}}},
            Ending.CURRENT,
            ("current_A", -2.3, -1),
        ),
    ],
)
def test_a_step_ends_with_the_first_sample_at_its_end(step, ending, check) -> None:
    played = play(program_of([step]), sensors=NOISELESS)
    name, value, sign = check
    beyond = sign * (getattr(played, name) - value)
    assert endings(played) == [ending]
    assert beyond[-1] >= 0 and (beyond[1:-1] < 0).all()


@pytest.mark.parametrize(
    ("until", "ending", "expected_s"),
    [
        ({"time_s": 305}, Ending.TIME, 300.0),
        ({"charge_Ah": 0.25}, Ending.CHARGE, 360.0),
        ({"charge_share": 0.1}, Ending.CHARGE, 360.0),
        ({"soc": 0.4}, Ending.SOC, 360.0),
        ({"temperature_degC": {"above": 25.05}}, Ending.TEMPERATURE, None),
    ],
)
def test_ends_by_time_charge_soc_and_temperature(until, ending, expected_s) -> None:
    played = play(program_of([{"step": "constant_current", "rate_C": -1, "until": until}]), sensors=NOISELESS)
    assert endings(played) == [ending]
    if expected_s is not None:
        assert abs(played.time_s[-1] - expected_s) <= 10.0


def test_a_rest_ends_when_the_voltage_has_come_to_rest() -> None:
    rest = {"step": "rest", "until": {"dV_dt_V_per_s": {"below": 5e-6, "over_s": 1200}, "time_s": 36000}}
    played = play(program_of([{"step": "constant_current", "rate_C": -1, "until": {"time_s": 600}}, rest]))
    assert endings(played) == [Ending.TIME, Ending.SLOPE]
    assert 1500 < played.ended[1].moved.time_s < 7200


def test_power_is_what_was_asked_for() -> None:
    played = play(program_of([{"step": "power", "power_W": -8, "until": {"time_s": 600}}]), sensors=NOISELESS)
    assert np.allclose((played.voltage_V * played.current_A)[4:], -8, rtol=2e-3)


def test_counters_are_those_of_an_independent_integration() -> None:
    steps = [
        {"step": "loop", "count": 2, "steps": [
            {"step": "cc_cv", "rate_C": 1, "voltage_V": 4.1, "until": {"rate_C": 0.2}}, REST,
            {"step": "constant_current", "rate_C": -1, "until": {"voltage_V": 3.3}}, REST]},
    ]  # fmt: skip
    played = play(program_of(steps))
    moved_Ah = played.current_A[1:] * np.diff(played.time_s) / 3600
    cycles = cycle_table(
        [{"cycle_count": e.cycle_count, "ended_by": e.ended_by.name, "duration_s": e.moved.time_s,
          **{n: getattr(e.moved, n) for n in ("charged_Ah", "discharged_Ah", "charged_Wh", "discharged_Wh")}}
         for e in played.ended]
    )  # fmt: skip
    assert [c["cycle_count"] for c in cycles] == [1, 2]
    for cycle in cycles:
        here = played.cycle[1:] == cycle["cycle_count"]
        for sign, name in ((1, "charged"), (-1, "discharged")):
            part = np.where(here, np.clip(sign * moved_Ah, 0, None), 0)
            assert cycle[f"{name}_Ah"] == pytest.approx(part.sum(), abs=1e-12)
            assert cycle[f"{name}_Wh"] == pytest.approx((part * played.voltage_V[1:]).sum(), abs=1e-12)
    assert 0.99 < cycles[1]["coulombic_efficiency"] < 1.02


def test_innermost_loops_count_the_cycles() -> None:
    inner = {"step": "loop", "count": 3, "steps": [REST]}
    played = play(program_of([{"step": "loop", "count": 2, "steps": [inner, REST]}]))
    assert [e.cycle_count for e in played.ended] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert [e.step_index for e in played.ended] == [1, 1, 1, 2] * 2


def test_a_pulse_train_ends_early_by_its_voltage() -> None:
    pulse = {"step": "pulse", "rate_C": -2, "on_s": 30, "off_s": 20, "count": 500, "until": {"voltage_V": 3.0}}
    played = play(program_of([pulse, REST]))
    assert endings(played)[:2] == [Ending.TIME, Ending.TIME]
    assert endings(played)[-2:] == [Ending.VOLTAGE, Ending.TIME]
    assert played.ended[-1].step_index == 2


def test_a_group_is_left_by_its_own_end() -> None:
    group = {"step": "group", "until": {"soc": {"below": 0.45}}, "steps": [
        {"step": "constant_current", "rate_C": -1, "until": {"time_s": 9000}}, REST]}  # fmt: skip
    played = play(program_of([group, REST]))
    assert [(e.step_index, e.ended_by) for e in played.ended] == [(1, Ending.SOC), (3, Ending.TIME)]


def test_goto_on_a_condition_and_a_loop_until_one() -> None:
    discharge = {"step": "constant_current", "label": "again", "rate_C": -1, "until": {"time_s": 180}}
    goto = {"step": "goto", "to": "again", "most": 10, "if": {"soc": {"above": 0.41}}}
    played = play(program_of([discharge, goto, REST]))
    assert [e.step_index for e in played.ended] == [1, 1, 2]
    loop = {"step": "loop", "count": 50, "until": {"soc": {"below": 0.41}}, "steps": [discharge]}
    assert len(play(program_of([loop])).ended) == 2


def test_a_profile_is_played_as_it_is_written_and_clipped_where_that_is_asked_for() -> None:
    profile = {"step": "profile", "time_s": [0, 100, 200, 300], "rate_C": [1, -1, 0.5, 0]}
    played = play(program_of([profile]), sensors=NOISELESS)
    assert np.allclose(played.current_A[1:] / 2.5, [1] * 10 + [-1] * 10 + [0.5] * 10, atol=1e-3)
    steep = {"step": "profile", "time_s": [0, 900], "rate_C": [2, 0], "clip_voltage_V": [2.6, 4.1]}
    clipped = play(program_of([steep]), dt_s=1.0, soc=0.8)
    assert clipped.true_V.max() < 4.1 + 0.01 and endings(clipped) == [Ending.PROFILE]
    assert clipped.current_A[-1] < 0.8 * 5


@pytest.mark.parametrize("dt_s", [0.1, 0.5, 1.0, 60.0])
def test_the_value_that_ends_a_profile_is_never_played(dt_s: float) -> None:
    short = {"step": "profile", "time_s": [0, 0.03], "current_A": [1.0, 1000.0]}
    played = play(program_of([short, REST]), sensors=NOISELESS, dt_s=dt_s)
    assert played.current_A[1] == pytest.approx(1.0) and played.current_A[2:].max() == 0.0
    assert endings(played)[0] == Ending.PROFILE


@pytest.mark.parametrize("current_A", [(-5.0, 2.0), (-5.0, -1.0), (1.0, 2.0)])
@pytest.mark.parametrize(
    "play_of",
    [
        Play("current", (), 1, "s", level=9.0),
        Play("current", (), 1, "s", level=-9.0),
        Play("rest", (), 1, "s"),
        Play("power", (), 1, "s", level=1000.0),
        Play("resistance", (), 1, "s", level=1e-3),
        Play("cc_cv", (), 1, "s", level=9.0, voltage_V=4.1),
        Play("voltage", (), 1, "s", level=9.0, voltage_V=4.1),
        Play("profile", (), 1, "s", times_s=(0.0, 1.0), values=(9.0, 0.0)),
        Play("profile", (), 1, "s", times_s=(0.0, 1.0), values=(-900.0, 0.0), in_watts=True),
    ],
)
def test_no_law_hands_out_a_current_beyond_the_limits(play_of: Play, current_A: tuple[float, float]) -> None:
    cell = Response(2.5)
    cell.see(3.7, 0.0, 1.0)
    law = Law(play_of, Window((2.5, 4.2), current_A), cell, 1.0)
    wanted_A = law.current_A(Seen(3.7, 0.0, 25.0, 0.5, 1.0), 0.0, 0.0)
    assert wanted_A == 0.0 or current_A[0] <= wanted_A <= current_A[1]


def test_a_step_without_an_end_in_that_direction_stops_before_the_limit() -> None:
    charge = {"step": "constant_current", "rate_C": 1, "until": {"time_s": 36000}}
    played = play(program_of([charge, REST]))
    assert "step 1 (constant_current): the voltage would leave" in (played.engine.stopped or "")
    assert endings(played) == [Ending.LIMIT] and played.voltage_V.max() <= 4.2
    soc = play(program_of([charge, REST], soc=(0.2, 0.6)))
    assert "state of charge would leave" in (soc.engine.stopped or "")


def test_limits_of_a_step_stop_the_run() -> None:
    step = {"step": "constant_current", "rate_C": -1, "until": {"time_s": 3600}, "limits": {"voltage_V": [3.5, 4.2]}}
    played = play(program_of([step]))
    assert "outside the step's 3.5 to 4.2 V" in (played.engine.stopped or "") and endings(played) == [Ending.LIMIT]


CHARGE = {"step": "constant_current", "rate_C": 0.5, "until": {"time_s": 1000}}
BACK = {"step": "constant_current", "rate_C": -0.5, "until": {"time_s": 1500}}


def limited(*steps, charge_Ah: float):
    read = read_protocol(document(*steps, limits={"charge_Ah": charge_Ah}))
    return compile_protocol(read, CELLS["nmc"].parameters.capacity_Ah, window_of())


@pytest.mark.parametrize(
    ("steps", "charge_Ah", "extremes_Ah"),
    [
        ([CHARGE], 0.05, (0.0, 0.05)),
        ([BACK], 0.05, (-0.05, 0.0)),
        ([{"step": "loop", "count": 9, "steps": [CHARGE, REST]}], 1.0, (0.0, 1.0)),  # more than any of its steps
        ([CHARGE, BACK, BACK], 0.4, (-0.4, 0.347)),  # net: back and beyond
        ([{"step": "cc_cv", "rate_C": 1, "voltage_V": 4.1, "until": {"rate_C": 0.01}}], 0.5, (0.0, 0.5)),
        ([{"step": "pulse", "rate_C": -1, "on_s": 60, "off_s": 30, "count": 99}], 0.3, (-0.3, 0.0)),
    ],
)
def test_the_charge_of_the_whole_protocol_is_limited(
    steps: list, charge_Ah: float, extremes_Ah: tuple[float, float]
) -> None:
    played = play(limited(*steps, charge_Ah=charge_Ah), sensors=NOISELESS, soc=0.3)
    assert f"would leave {charge_Ah:g} Ah" in (played.engine.stopped or "") and endings(played)[-1] == Ending.LIMIT
    moved_Ah = np.cumsum(played.current_A[1:] * np.diff(played.time_s)) / 3600
    assert min(moved_Ah.min(), 0.0) == pytest.approx(extremes_Ah[0], abs=0.0075)
    assert max(moved_Ah.max(), 0.0) == pytest.approx(extremes_Ah[1], abs=0.0075)
    assert np.abs(moved_Ah).max() <= charge_Ah * (1 + 1e-6)


def test_a_step_that_ends_at_the_limit_of_charge_ends_by_itself() -> None:
    to_limit = CHARGE | {"until": {"charge_Ah": 0.05}}
    played = play(limited(to_limit, BACK | {"until": {"charge_Ah": 0.06}}, charge_Ah=0.05), sensors=NOISELESS)
    assert endings(played) == [Ending.CHARGE, Ending.CHARGE] and played.engine.stopped is None
    # Its own end is far away, that of the protocol is not.
    far = play(limited(to_limit, to_limit, charge_Ah=0.07), sensors=NOISELESS)
    assert endings(far) == [Ending.CHARGE, Ending.LIMIT]


def test_duration_and_ramp_are_kept() -> None:
    rest = {"step": "constant_current", "rate_C": -0.1, "until": {"time_s": 1e6}}
    played = play(program_of([rest], duration_s=600.0))
    assert played.time_s[-1] <= 600.0 and "longer than 10 min" in (played.engine.stopped or "")
    step = {"step": "constant_current", "rate_C": -1, "until": {"time_s": 100}}
    slow = play(program_of([step], ramp_A_per_s=0.05), sensors=NOISELESS)
    assert np.abs(np.diff(slow.current_A)).max() <= 0.5 + 1e-9


def test_a_step_can_be_skipped() -> None:
    program = program_of([{"step": "rest", "until": {"time_s": 1e5}}, REST])
    played = play(program, most=5)
    played.engine.skip()
    seen = played.engine._last  # noqa: SLF001
    assert seen is not None and played.engine.advance(seen) == 0.0
    assert endings(played) == [Ending.SKIPPED]
