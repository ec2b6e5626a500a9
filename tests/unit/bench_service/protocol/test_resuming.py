"""A protocol that is cut off anywhere goes on there, and counts what it would have counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench_service.bench.protocol_play import ProtocolPlay, _row
from bench_service.protocol.counters import Counters
from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from bench_service.protocol.resuming import standing_after
from bench_service.protocol.state import Standing
from bench_service.protocol.tables import cycle_table, step_table
from bench_service.streams import STEPS, STREAMS, Flag
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.bench_service.protocol.protocol_rig import NOISELESS, Played, play, program_of

STEPS_OF = [
    {"step": "constant_current", "label": "more", "rate_C": 0.5, "until": {"time_s": 100}},
    {"step": "goto", "to": "more", "most": 3, "if": {"soc": {"below": 0.54}}},
    {"step": "loop", "count": 4, "steps": [
        {"step": "cc_cv", "rate_C": 1, "voltage_V": 3.8, "until": {"rate_C": 0.2}},
        {"step": "pulse", "rate_C": -1, "on_s": 60, "off_s": 30, "count": 3, "until": {"voltage_V": 3.4}}]},
]  # fmt: skip


def columns(played: Played) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    rows = [_row(0.0, each) for each in played.ended]
    names = [column.name for column in STREAMS[STEPS]]
    steps = (
        {name: np.array(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)} if rows else {}
    )
    steps = {name: values.astype(np.int64) if name in _WHOLE else values for name, values in steps.items()}
    samples = {
        "time_s": played.time_s,
        "voltage_V": played.voltage_V,
        "current_A": played.current_A,
        "temperature_degC": np.full(len(played.time_s), 25.0),
        "step_count": played.step,
        "flags": np.zeros(len(played.time_s), np.uint32),
    }
    return steps, samples


_WHOLE = ("step_count", "step_index", "cycle_count", "instruction", "ended_by")


@pytest.mark.parametrize("told", [True, False], ids=["stopped", "killed"])
@pytest.mark.parametrize("n", [1, 2, 11, 15, 40, 77, 120])
def test_it_goes_on_where_it_was_cut_off(n: int, told: bool) -> None:
    program = program_of(STEPS_OF)
    whole = play(program, sensors=NOISELESS)
    cell = Cell(CELLS["nmc"].parameters, 0.5)
    first = play(program, sensors=NOISELESS, most=n, true_cell=cell)
    if told:
        first.engine.close()
    steps, samples = columns(first)
    standing = standing_after(program, None, steps, samples)
    assert standing is not None
    written = standing.to_json()
    copy = Standing.from_json(written)
    assert copy == standing
    play(program, sensors=NOISELESS, standing=copy, most=200)
    assert Standing.from_json(written) == standing, "whoever plays from there leaves it as it is"
    soc = 0.5 + float(np.sum(first.current_A[1:] * np.diff(first.time_s))) / 3600 / 2.5
    rest = play(program, sensors=NOISELESS, standing=standing, true_cell=cell, soc=soc)
    parts = [columns(first)[0], columns(rest)[0]]
    joined = {name: np.concatenate([p[name] for p in parts if p]) for name in parts[1]}
    table, expected = step_table(joined), step_table(columns(whole)[0])
    assert [(s["step_count"], s["step_index"], s["cycle_count"], s["ended_by"]) for s in table] == [
        (s["step_count"], s["step_index"], s["cycle_count"], s["ended_by"]) for s in expected
    ]
    for mine, his in zip(cycle_table(table), cycle_table(expected), strict=True):
        assert mine["charged_Ah"] == pytest.approx(his["charged_Ah"], abs=2.5 * 20 / 3600)
        assert mine["discharged_Wh"] == pytest.approx(his["discharged_Wh"], abs=10 * 20 / 3600)


@pytest.mark.parametrize("told", [True, False], ids=["stopped", "killed"])
@pytest.mark.parametrize("n", [1, 15, 40, 77])
def test_the_charge_before_counts_towards_the_limit(n: int, told: bool) -> None:
    """A hundred pulses, of which the limit allows so many in all the parts together."""
    program = program_of([{"step": "pulse", "rate_C": -1, "on_s": 60, "off_s": 30, "count": 100}])
    program = replace(program, window=replace(program.window, charge_Ah=0.5))
    whole = play(program, sensors=NOISELESS)
    cell, moved_Ah = Cell(CELLS["nmc"].parameters, 0.5), 0.0
    standing: Standing | None = Standing(counters=[0] * program.n_counters)
    for most in (n, 3, 1000):
        assert standing is not None
        copy = Standing.from_json(standing.to_json())
        part = play(program, sensors=NOISELESS, most=most, true_cell=cell, standing=copy)
        if told:
            part.engine.close()
        standing = standing_after(program, standing, *columns(part))
        assert standing is not None
        moved_Ah += float(np.sum(part.current_A[1:] * np.diff(part.time_s))) / 3600
        assert standing.total.net_Ah + standing.step.net_Ah == pytest.approx(moved_Ah, abs=1e-9)
    assert "would leave 0.5 Ah" in (whole.engine.stopped or "") and "would leave 0.5 Ah" in (part.engine.stopped or "")
    assert moved_Ah == pytest.approx(-0.5, abs=2.5 * 10 / 3600)


def test_after_the_end_nothing_is_left_and_another_protocol_is_refused() -> None:
    program = program_of(STEPS_OF)
    steps, samples = columns(play(program, sensors=NOISELESS))
    assert standing_after(program, None, steps, samples) is None
    with pytest.raises(ValueError, match="does not follow"):
        standing_after(program_of(STEPS_OF[2:]), None, steps, samples)


def test_progress_goes_on_where_the_protocol_does() -> None:
    standing = Standing(counters=[0], step=Counters(time_s=100.0), total=Counters(time_s=900.0))
    play_on = ProtocolPlay(program_of(STEPS_OF), 1.0, standing, expected_s=1000.0)
    assert [play_on.progress(tick) for tick in (0, 500, 1000)] == pytest.approx([0.5, 0.75, 0.99])


@pytest.mark.parametrize("n", [4, 5, 7, 8, 10])
def test_a_pause_is_no_part_of_the_step_that_was_cut_off(n: int) -> None:
    """Held at 40 s, let go at 70 s: what the machine has counted is what is counted from the samples."""
    program = program_of(STEPS_OF[:1])
    engine, flags, currents_A = Engine(program, 10.0), np.zeros(n, np.uint32), np.full(n, 1.25)
    flags[4:7], currents_A[4:7] = Flag.PAUSED, 0.0
    for k in range(n):
        if flags[k]:
            engine.pause()
        else:
            engine.advance(Seen(3.7, currents_A[k], 25.0, 0.5, 10.0 if k else 0.0))
    time_s = 10.0 * np.arange(n)
    samples = {"time_s": time_s, "voltage_V": np.full(n, 3.7), "current_A": currents_A, "step_count": np.ones(n)}
    samples |= {"temperature_degC": np.full(n, 25.0), "flags": flags}
    standing = standing_after(program, None, {}, samples)
    assert standing is not None and standing.step == engine.standing.step
    assert standing.step.time_s == 10.0 * (n - 1 - np.sum(flags > 0))
