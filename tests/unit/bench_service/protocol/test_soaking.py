"""Steps that need a temperature chamber: what they set, when a soak is over, and what is refused without one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.counters import Ending
from bench_service.protocol.document import read_protocol
from bench_service.protocol.engine import Engine
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.formats.pybamm import from_pybamm, to_pybamm
from bench_service.protocol.formats.unicycler_out import to_unicycler
from bench_service.protocol.laws import Seen
from bench_service.protocol.preview import preview
from bench_service.protocol.program import ChamberWindow, Program, Window
from bench_service.protocol.resuming import standing_after
from bench_service.protocol.state import Standing
from tests.unit.bench_service.protocol.protocol_rig import document

CHAMBER = ChamberWindow((0.0, 50.0), 0.5)
SOAK = {"step": "soak", "temperature_degC": 35, "within_K": 2, "hold_s": 30, "limit_s": 200}
REST = {"step": "rest", "until": {"time_s": 20}}


def made(*steps: dict[str, Any], chamber: ChamberWindow | None = CHAMBER) -> Program:
    return compile_protocol(read_protocol(document(*steps)), 2.5, Window((2.5, 4.2), (-10.0, 5.0), chamber=chamber))


def fed(engine: Engine, *rows: tuple[float, float], dt_s: float = 10.0) -> list[float | None]:
    """Give samples of (cell, air); return the set-points."""
    return [engine.advance(Seen(3.7, 0.0, cell, 0.5, dt_s, air)) for cell, air in rows]


def test_a_chamber_step_sets_and_goes_on_at_once() -> None:
    engine = Engine(
        made({"step": "chamber", "temperature_degC": 40}, REST, {"step": "chamber", "temperature_degC": 25}), 10
    )
    assert engine.chamber_degC is None
    assert fed(engine, (25, 25)) == [0.0] and engine.chamber_degC == 40 and engine.step_index == 1
    assert fed(engine, (25, 25), (25, 25))[-1] is None and engine.chamber_degC == 25


def test_a_soak_ends_when_air_and_cell_have_been_near_for_long_enough() -> None:
    engine = Engine(made(SOAK, REST), 10)
    assert fed(engine, (25, 25)) == [0.0] and engine.chamber_degC == 35
    # Air alone, cell alone, both but not long enough, then both.
    rows = [(25, 35), (34, 34), (34, 35), (34, 35), (34, 35.6), (34, 35), (34, 35), (34, math.nan)]
    fed(engine, *rows)
    assert engine.step_count == 1 and not engine.ended
    fed(engine, (34, 35), (33.5, 34.6), (36.9, 35.4))
    assert not engine.ended
    assert fed(engine, (34, 35)) == [0.0]
    assert [end.ended_by for end in engine.ended] == [Ending.SOAKED] and engine.standing.step_count == 2
    assert engine.ended[0].moved.time_s == 120


@pytest.mark.parametrize("at_limit", [None, "stop", "go_on"])
def test_what_happens_at_the_limit_is_stated(at_limit: str | None) -> None:
    engine = Engine(made(SOAK | ({"at_limit": at_limit} if at_limit else {}), REST), 10)
    found = fed(engine, *[(26, 31)] * 21)
    if at_limit == "go_on":
        assert found[-1] == 0.0 and engine.ended[0].ended_by is Ending.TIME and engine.stopped is None
    else:
        assert found[-1] is None and engine.ended[0].ended_by is Ending.LIMIT
        assert engine.stopped == (
            "step 1 (soak): not at 35 degC after 200 s: the chamber's air is 31 degC, the cell 26 degC; "
            "check chamber and sensors, or give limit_s more"
        )


@pytest.mark.parametrize(
    ("step", "told"),
    [
        ({"step": "chamber"}, "chamber needs temperature_degC at steps.0"),
        ({"step": "soak", "hold_s": 5}, "soak needs temperature_degC at steps.0"),
        (SOAK | {"until": {"time_s": 5}}, "unknown key at steps.0.until"),
        (SOAK | {"at_limit": "cry"}, "unknown way to go on at steps.0.at_limit"),
        (SOAK | {"limit_s": 5}, "shorter than the time to hold at steps.0.limit_s: 5 s"),
        (SOAK | {"temperature_degC": 55}, r"step 1 \(soak\): set point outside the chamber's window.*55 degC"),
        ({"step": "loop", "count": 2, "steps": [{"step": "chamber", "temperature_degC": 20}]}, "nothing is played"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(step: dict[str, Any], told: str) -> None:
    with pytest.raises(ProtocolError, match=told):
        made(step)


@pytest.mark.parametrize("step", [SOAK, {"step": "chamber", "temperature_degC": 30}])
def test_a_bench_without_a_chamber_refuses_it_and_names_the_step(step: dict[str, Any]) -> None:
    inside = {"step": "group", "steps": [REST, step]}
    with pytest.raises(ProtocolError, match=rf"step 2\.2 \({step['step']}\) needs a temperature chamber"):
        made(REST, inside, chamber=None)


def test_it_is_foreseen_how_long_a_soak_takes() -> None:
    seen = preview(made(SOAK | {"limit_s": 1e4, "hold_s": 600}, REST), 0.5, 1.0)
    # 10 K at 2 K/min, then the cell's own lag, then the hold.
    assert seen.stopped is None and seen.duration_s is not None and 1300 < seen.duration_s < 2600


def test_a_protocol_that_goes_on_sets_the_chamber_again() -> None:
    program = made(SOAK, {"step": "rest", "until": {"time_s": 500}}, {"step": "chamber", "temperature_degC": 20}, REST)
    first = Engine(program, 10)
    fed(first, (34, 35), (34, 35), (34, 35), (34, 35), (34, 35))
    standing = Standing.from_json(first.standing.to_json())
    assert (standing.step_count, standing.chamber_degC) == (2, 35)
    again = Engine(program, 10, standing)
    assert fed(again, (25, 25)) == [0.0] and again.chamber_degC == 35
    old = {name: value for name, value in first.standing.to_json().items() if name != "chamber_degC"}
    assert Standing.from_json(old).chamber_degC is None  # of a run before there were chambers
    # From what was stored: the soak had ended, the rest was cut off.
    end, n = first.ended[0], 8
    steps = {
        "time_s": [40.0], "step_count": [1], "step_index": [1], "cycle_count": [1], "instruction": [end.at],
        "ended_by": [int(end.ended_by)], "duration_s": [40.0], "charged_Ah": [0.0], "discharged_Ah": [0.0],
        "charged_Wh": [0.0], "discharged_Wh": [0.0], "mean_voltage_V": [3.7], "end_voltage_V": [3.7],
        "end_current_A": [0.0], "end_temperature_degC": [34.0], "end_soc": [0.5],
    }  # fmt: skip
    samples = {
        "time_s": np.arange(n) * 10.0, "voltage_V": np.full(n, 3.7), "current_A": np.zeros(n),
        "temperature_degC": np.full(n, 34.0), "step_count": np.array([1] * 5 + [2] * 3),
        "flags": np.zeros(n, np.uint32),
    }  # fmt: skip
    after = standing_after(program, None, {name: np.array(each) for name, each in steps.items()}, samples)
    assert after is not None and (after.step_count, after.chamber_degC, after.step.time_s) == (2, 35, 30.0)


def test_other_formats_say_that_they_have_none() -> None:
    own = document(REST, SOAK, record={"time_s": 1})
    with pytest.raises(ProtocolError, match=r"step 2 \(soak\) has no PyBaMM string"):
        to_pybamm(own)
    with pytest.raises(ProtocolError, match=r"step 2 \(soak\) has no counterpart in unicycler"):
        to_unicycler(own)
    for text in ("Rest for 1 hour (temperature = 35)", "Rest at 35 oC for 1 hour"):
        with pytest.raises(ProtocolError, match=r"a string has no temperature.*at experiment\.0.*soak"):
            from_pybamm([text])
