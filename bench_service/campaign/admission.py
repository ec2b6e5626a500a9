"""What may start: limits and profiles are checked here before any command reaches a bench. Pure functions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.bench.limits import Limits
from bench_service.errors import BadRequestError

_SECONDS_PER_HOUR = 3600.0
# A set-point that equals its limit after a round trip through decimal text is within it.
_RELATIVE_SLACK = 1e-9
# Times such as 3 * 0.1 fall a rounding error short of the grid of ticks.
_GRID_TOLERANCE = 1e-6
# Wider than any bench, narrow enough that no sum over a profile overflows.
_LARGEST = {"time_s": 1e9, "current_A": 1e5}
# The control process holds the profile on the grid of ticks in memory.
MOST_TICKS = 20_000_000


def narrowed(bench: Limits, wanted: Mapping[str, Any] | None) -> Limits:
    """Limits of a run: those of the bench where the request says nothing, else the request's.

    Raises
    ------
    BadRequestError
        A limit of the request is wider than the bench's.
    """
    if not wanted:
        return bench
    try:
        run = Limits.from_json(bench.to_json() | {k: v for k, v in wanted.items() if v is not None})
    except ValueError as error:
        raise BadRequestError(str(error), ("limits",)) from error
    if (excess := run.wider_than(bench)) is not None:
        raise BadRequestError(f"a run may only narrow the bench's limits: {excess}", ("limits",))
    return run


def check_profile(time_s: NDArray[np.float64], current_A: NDArray[np.float64]) -> None:
    """Check the form of a profile: forward hold, the last row ends it.

    Raises
    ------
    BadRequestError
        Fewer than two rows, unequal lengths, a value that is not finite, time not starting at 0 or not rising.
    """
    if len(time_s) != len(current_A):
        raise BadRequestError(f"time_s has {len(time_s)} values, current_A {len(current_A)}", ("current_A",))
    if len(time_s) < 2:
        raise BadRequestError("a profile needs at least two rows, the last one ends it", ("time_s",))
    for name, values in (("time_s", time_s), ("current_A", current_A)):
        if (row := _first(~np.isfinite(values))) is not None:
            raise BadRequestError("not a finite number", (name, row), value=float(values[row]))
        if (row := _first(np.abs(values) > _LARGEST[name])) is not None:
            raise BadRequestError("implausible", (name, row), value=float(values[row]), limit=_LARGEST[name])
    if time_s[0] != 0:
        raise BadRequestError("the profile must start at 0 s", ("time_s", 0), value=float(time_s[0]), unit="s")
    if (row := _first(np.diff(time_s, prepend=-np.inf) <= 0)) is not None:
        raise BadRequestError("time does not rise", ("time_s", row), value=float(time_s[row]), unit="s")


def admit(
    time_s: NDArray[np.float64],
    current_A: NDArray[np.float64],
    limits: Limits,
    *,
    dt_s: float,
    tick_s: float,
    initial_soc: float,
    capacity_Ah: float,
) -> None:
    """Check a profile against the limits of a run, before any command.

    Parameters
    ----------
    time_s, current_A : arrays
        The profile; positive current charges.
    limits : Limits
        Limits of the run, see `narrowed`.
    dt_s : float
        Period of the samples.
    tick_s : float
        Period of the set-points, which change on ticks only; see `Bench.tick_s`.
    initial_soc : float
        State of charge at the start, 0..1.
    capacity_Ah : float
        Capacity for counting charge.

    Raises
    ------
    BadRequestError
        The profile leaves a limit; the message names the first row that does.
    """
    check_profile(time_s, current_A)
    low_A, high_A = limits.current_A
    slack_A = _RELATIVE_SLACK * max(abs(low_A), abs(high_A))
    if (row := _first(~((current_A >= low_A - slack_A) & (current_A <= high_A + slack_A)))) is not None:
        raise BadRequestError(
            "current outside the limit",
            ("profile", "current_A", row),
            value=float(current_A[row]),
            unit="A",
            limit=limits.current_A,
            remedy="scale the profile down",
        )
    _admit_duration(float(time_s[-1]), limits.duration_s, dt_s, tick_s)
    _admit_ramp(time_s, current_A, limits.ramp_A_per_s, tick_s)
    _admit_soc(time_s, current_A, limits.soc, initial_soc, capacity_Ah)


def _admit_duration(duration_s: float, limit_s: float, dt_s: float, tick_s: float) -> None:
    if duration_s > limit_s * (1 + _RELATIVE_SLACK):
        raise BadRequestError(
            "the profile is too long",
            ("profile", "time_s"),
            value=duration_s,
            unit="s",
            limit=limit_s,
            remedy="shorten it",
        )
    if not (1 - _GRID_TOLERANCE <= duration_s / dt_s and duration_s / tick_s <= MOST_TICKS):
        raise BadRequestError(
            f"a profile of {duration_s:g} s is a sample to {MOST_TICKS} ticks long with another period",
            ("dt_s",),
            value=dt_s,
            unit="s",
        )


def _admit_ramp(time_s: NDArray, current_A: NDArray, ramp_A_per_s: float | None, tick_s: float) -> None:
    if ramp_A_per_s is None:
        return
    # A row takes effect on the first tick at or after its time; of several before one tick the last counts.
    tick = np.ceil(time_s[:-1] / tick_s - _GRID_TOLERANCE)
    last_of_tick = np.append(np.diff(tick) > 0, True)
    rows = np.flatnonzero(last_of_tick)
    steps_A = np.abs(np.diff(current_A[rows], prepend=0.0))
    if (bad := _first(~(steps_A <= ramp_A_per_s * tick_s * (1 + _RELATIVE_SLACK)))) is not None:
        raise BadRequestError(
            "the set-point changes too fast",
            ("profile", "current_A", int(rows[bad])),
            value=float(steps_A[bad] / tick_s),
            unit="A/s",
            limit=ramp_A_per_s,
            remedy="spread the step over more rows",
        )


def _admit_soc(
    time_s: NDArray, current_A: NDArray, window: tuple[float, float], initial_soc: float, capacity_Ah: float
) -> None:
    soc = initial_soc + _counted_charge_Ah(time_s, current_A) / capacity_Ah
    low, high = window
    if (row := _first(~((soc >= low - 1e-9) & (soc <= high + 1e-9)))) is not None:
        raise BadRequestError(
            f"state of charge leaves the window after {time_s[row]:g} s, counted from initial_soc "
            f"{initial_soc:g} with {capacity_Ah:g} Ah,",
            ("profile", "time_s", row),
            value=float(soc[row]),
            limit=window,
            remedy="start at another state of charge or shorten the profile",
        )


def _counted_charge_Ah(time_s: NDArray, current_A: NDArray) -> NDArray[np.float64]:
    # Forward hold: between rows the charge moves on a straight line, so its extremes lie at rows.
    moved_As = np.diff(time_s) * current_A[:-1]
    return np.concatenate(([0.0], np.cumsum(moved_As))) / _SECONDS_PER_HOUR


def _first(bad: NDArray[np.bool_]) -> int | None:
    rows = np.flatnonzero(bad)
    return int(rows[0]) if rows.size else None
