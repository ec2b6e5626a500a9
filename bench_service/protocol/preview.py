"""What a protocol will roughly do: played on a nominal cell in a blink, before anybody starts it.

The cell is nobody's: a curve of the usual shape between the run's limits of voltage, and one resistance. Times of
steps that end by a voltage are right to some ten percent; those of steps that end by their time exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from bench_service.protocol.program import Play, Program
from bench_service.protocol.state import Standing, StepEnd

_MOST_TICKS = 60_000
_COARSEST_S = 60.0
_TICKS_PER_STEP = 5
_RESISTANCE_SHARE = 0.015  # of the voltage, at 1C
_ROOM_DEGC = 25.0
_CHAMBER_K_PER_S = 2.0 / 60.0
_CELL_FOLLOWS_S = 600.0
_CHANGE_C = 0.02


@dataclass(frozen=True, slots=True)
class Preview:
    """What to expect.

    Attributes
    ----------
    duration_s : float or None
        None: longer than was looked at.
    time_s, current_A, voltage_V, step_count : tuples of equal length
        Where something changes; a current holds to the next time.
    ended : tuple of StepEnd
    stopped : str or None
        Why it would not come to its end.
    """

    duration_s: float | None
    time_s: tuple[float, ...]
    current_A: tuple[float, ...]
    voltage_V: tuple[float, ...]
    step_count: tuple[int, ...]
    ended: tuple[StepEnd, ...]
    stopped: str | None


def preview(
    program: Program, initial_soc: float, dt_s: float, standing: Standing | None = None, most_ticks: int = _MOST_TICKS
) -> Preview:
    """Play a program on a nominal cell.

    Parameters
    ----------
    program : Program
    initial_soc : float
    dt_s : float
        Period of the run; the preview takes longer ones where steps are long.
    standing : Standing or None
        Where it goes on.
    most_ticks : int
        Where it gives up.
    """
    period_s = max(dt_s, min(_COARSEST_S, _shortest_s(program) / _TICKS_PER_STEP))
    engine, soc, current_A, time_s, interval_s = Engine(program, period_s, standing), initial_soc, 0.0, 0.0, 0.0
    air_degC = cell_degC = _ROOM_DEGC
    series: list[tuple[float, float, float, int]] = []
    for _ in range(most_ticks):
        voltage_V = _voltage_V(program, soc, current_A)
        wanted_A = engine.advance(Seen(voltage_V, current_A, cell_degC, soc, interval_s, air_degC))
        row = (time_s, wanted_A or 0.0, voltage_V, engine.standing.step_count)
        _note(series, row, program.capacity_Ah, always=wanted_A is None)
        if wanted_A is None:
            break
        current_A, interval_s = wanted_A, period_s
        soc += current_A * period_s / 3600.0 / program.capacity_Ah
        time_s += period_s
        air_degC, cell_degC = _warmed(air_degC, cell_degC, engine.chamber_degC, period_s)
    else:
        return Preview(None, *_columns(series), tuple(engine.ended), None)
    return Preview(time_s, *_columns(series), tuple(engine.ended), engine.stopped)


def _warmed(air_degC: float, cell_degC: float, goal_degC: float | None, period_s: float) -> tuple[float, float]:
    """Return the temperatures of a nominal chamber's air and of the cell in it, a period later."""
    if goal_degC is None:
        return air_degC, cell_degC
    most_K = _CHAMBER_K_PER_S * period_s
    air_degC += min(max(goal_degC - air_degC, -most_K), most_K)
    return air_degC, air_degC + (cell_degC - air_degC) * math.exp(-period_s / _CELL_FOLLOWS_S)


def _note(
    series: list[tuple[float, float, float, int]],
    row: tuple[float, float, float, int],
    capacity_Ah: float,
    *,
    always: bool,
) -> None:
    """Keep a row where current, voltage or step have changed, and the last one."""
    if len(series) > 1 and not always:
        last = series[-1]
        same = last[3] == row[3] and abs(last[1] - row[1]) < _CHANGE_C * capacity_Ah
        if same and abs(last[2] - row[2]) < 0.01:
            return
    series.append(row)


def _columns(series: list[tuple[float, float, float, int]]) -> tuple[tuple, tuple, tuple, tuple]:
    time_s, current_A, voltage_V, steps = zip(*series, strict=True)
    return time_s, current_A, voltage_V, steps


def _voltage_V(program: Program, soc: float, current_A: float) -> float:
    low, high = program.window.voltage_V
    share = 0.45 + 0.35 * soc + 0.2 * max(soc, 0.0) ** 8 - 0.45 * math.exp(-25.0 * soc)
    # Beyond empty and full the curve is steep, so that every end by a voltage is met.
    share += 5.0 * max(soc - 1.0, 0.0)
    ocv_V = low + (high - low) * max(share, -1.0)
    return ocv_V + _RESISTANCE_SHARE * high * current_A / program.capacity_Ah


def _shortest_s(program: Program) -> float:
    times = [
        end.value
        for each in program.instructions
        if isinstance(each, Play)
        for end in each.ends
        if end.quantity == "time_s"
    ]
    for each in program.instructions:
        if isinstance(each, Play) and each.soak is not None:
            times.append(max(each.soak.hold_s, _COARSEST_S))
        if isinstance(each, Play) and each.times_s:
            times += [b - a for a, b in zip(each.times_s, each.times_s[1:], strict=False)]
    return max(min(times, default=math.inf), 1e-3)
