"""What ends a protocol before a safety rule has to: limits of a step, and set-points that would leave those of the run.

The safety rules of the bench stay what they are and come first; a run that is ended here has broken none of them.
"""

from __future__ import annotations

import math

from bench_service.protocol.laws import Seen
from bench_service.protocol.program import End, Play, Program
from bench_service.protocol.response import Response
from bench_service.protocol.state import Standing

_CLOSE_V = 0.002
_SLACK = 1e-9  # of sums and differences that are the same on paper
_UNITS = {"voltage_V": "V", "current_A": "A", "temperature_degC": "degC", "soc": ""}


def broken_limit(play: Play, seen: Seen) -> str | None:
    """Return which of a step's own limits a sample has left; None if none."""
    for name, low, high in play.limits:
        value = getattr(seen, name)
        if value is not None and not low <= value <= high:
            return f"{name} = {value:.4g} {_UNITS[name]} is outside the step's {low:g} to {high:g} {_UNITS[name]}"
    return None


def leaves(
    program: Program,
    play: Play,
    cell: Response,
    seen: Seen,
    set_A: tuple[float, float],
    dt_s: float,
    standing: Standing,
) -> tuple[str, str] | None:
    """Return which quantity would leave its limits before the next sample, and in words; None if none.

    Parameters
    ----------
    set_A : (now, next)
        Set-point in force and the one that is wanted.
    dt_s : float
        Until the next sample.
    standing : Standing
        With what has been moved.
    """
    window, current_A = program.window, set_A[1]
    if current_A == 0.0:
        return None
    charge_Ah = current_A * dt_s / 3600.0
    if window.charge_Ah is not None:
        now_Ah = standing.total.net_Ah + standing.step.net_Ah
        if (now_Ah + charge_Ah) * current_A > 0 and abs(now_Ah + charge_Ah) > window.charge_Ah * (1 + _SLACK):
            text = f"the charge since the protocol began would leave {window.charge_Ah:g} Ah: {now_Ah:.4g} Ah now"
            return "charge_Ah", text
    if window.soc is not None and seen.soc is not None:
        soc = seen.soc + charge_Ah / program.capacity_Ah
        low, high = window.soc
        if (soc < low and current_A < 0) or (soc > high and current_A > 0):
            return "soc", f"the counted state of charge would leave {low:g} to {high:g}: {soc:.4f}"
    if play.law in ("voltage", "cc_cv"):
        return None
    ahead_V = _ahead(cell, seen, set_A, dt_s)
    low, high = window.voltage_V
    if (ahead_V > high - _CLOSE_V and current_A > 0) or (ahead_V < low + _CLOSE_V and current_A < 0):
        return "voltage_V", f"the voltage would leave {low:g} to {high:g} V: {seen.voltage_V:.4g} V now"
    return None


def near_end(play: Play, quantity: str, current_A: float, standing: Standing, dt_s: float) -> End | None:
    """Return the step's own end that is less than a sample away where a limit of its quantity is; None if none is."""
    moved_Ah = abs(standing.step.net_Ah + current_A * dt_s / 3600.0)
    for end in play.ends:
        # A step counts its own charge, the limit that of all steps.
        near = moved_Ah >= end.value if quantity == "charge_Ah" else end.above == (current_A > 0)
        if end.quantity == quantity and near:
            return end
    return None


def ramped(ramp_A_per_s: float | None, now_A: float, wanted_A: float, dt_s: float) -> float:
    """Return as much of a change of the set-point as the ramp allows until the next sample; None allows all."""
    most_A = math.inf if ramp_A_per_s is None else ramp_A_per_s * dt_s
    if abs(wanted_A - now_A) <= most_A * (1 + _SLACK):  # a step that was admitted is played as it is written
        return wanted_A
    return now_A + math.copysign(most_A, wanted_A - now_A)


def careful(program: Program, cell: Response, seen: Seen, wanted_A: float) -> float:
    """Return the first current into a cell of which nothing is known yet.

    It is the one that is wanted, unless a cell of rather high resistance would leave the limits with it; then so much
    that even this one stays inside. One sample later the resistance is known.
    """
    low, high = program.window.voltage_V
    end = high - _CLOSE_V if wanted_A > 0 else low + _CLOSE_V
    most_A = (end - seen.voltage_V) / cell.resistance_Ohm
    return min(wanted_A, max(most_A, 0.0)) if wanted_A > 0 else max(wanted_A, min(most_A, 0.0))


def _ahead(cell: Response, seen: Seen, set_A: tuple[float, float], dt_s: float) -> float:
    """Return the voltage to expect at the next sample."""
    step_A = set_A[1] - set_A[0]
    jump_V = cell.resistance_Ohm * step_A if cell.known else 0.0
    drift_V = cell.drift_V_per_s * dt_s if cell.drift_V_per_s * set_A[1] > 0 else 0.0
    return seen.voltage_V + jump_V + drift_V
