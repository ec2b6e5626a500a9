"""Voltages that jump without a current that could make them.

Judged one sample late: a voltage that is measured after its current shows a step before the current does.
"""

import math
from dataclasses import dataclass, replace

from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.response import Response
from bench_service.bench.plausibility.sample import Sample

# For each cell: what relaxes within a second, and noise; with longer between two samples, as diffusion, by its root.
# Half of the way to the trip people are told.
ALLOWED_V = 0.08
WARN_SHARE = 0.5
# A resistance that is known may be so much larger in the next step (temperature, state of charge).
_KNOWN_FACTOR = 4.0


@dataclass(frozen=True, slots=True)
class Jumps:
    """The last changes.

    Parameters
    ----------
    steps_A : tuple of float, length 3
        The last steps of the current, youngest last.
    change_V, allowed_V : float
        Of the voltage, one sample ago, and what charge and relaxation allowed it.
    known : Response
        What was known of the resistance before that change: what comes with a jump must not explain it.
    """

    steps_A: tuple[float, float, float] = (0.0, 0.0, 0.0)
    change_V: float = 0.0
    allowed_V: float = math.inf
    known: Response = Response()


def follow(jumps: Jumps, band: CellBand, known: Response, before: Sample, now: Sample) -> Jumps:
    """Return the changes after one sample more; `known` is the response without that sample."""
    dt_s = now.time_s - before.time_s
    charge_As = max(abs(now.current_A), abs(before.current_A)) * dt_s
    relaxing_V = ALLOWED_V * band.cells_in_series * math.sqrt(max(1.0, dt_s))
    return replace(
        jumps,
        steps_A=(*jumps.steps_A[1:], now.current_A - before.current_A),
        change_V=now.voltage_V - before.voltage_V,
        allowed_V=relaxing_V + band.slope_V_per_As * charge_As,
        known=known,
    )


def judge(before: Jumps, now: Jumps, band: CellBand) -> Finding | None:
    """Return what is not plausible about the change one sample ago."""
    present_A, others_A = before.steps_A[-1], (*before.steps_A[:-1], now.steps_A[-1])
    largest_A = max(abs(present_A), *(abs(step_A) for step_A in others_A))
    fall_V, rise_V = _by_steps_V(before.known, band, present_A, others_A)
    allowed_V = before.allowed_V + (rise_V if before.change_V > 0.0 else fall_V)
    share = abs(before.change_V) / allowed_V
    if share <= WARN_SHARE:
        return None
    text = (
        f"voltage jumped by {before.change_V:.3g} V from one sample to the next with steps of the current of at most "
        f"{largest_A:.3g} A, plausible are {allowed_V:.2g} V"
    )
    remedy = "check sense leads and cell"
    return Finding("trip" if share > 1.0 else "warn", "voltage_jump", text, remedy)


def _by_steps_V(known: Response, band: CellBand, present_A: float, others_A: tuple[float, ...]) -> tuple[float, float]:
    """Most that the voltage may fall and rise by the step of the current that came with it, and by its neighbours."""
    at_once, later, std = known.parts_Ohm
    resistance, most_Ohm = at_once + later, band.possible_Ohm[1]
    if not resistance > 2.0 * std:  # not known, or of the wrong sign, which another rule tells: either way
        largest_A = max(abs(step_A) for step_A in (present_A, *others_A))
        either_V = min(_KNOWN_FACTOR * (max(resistance, 0.0) + 2.0 * std), most_Ohm) * largest_A
        return either_V, either_V
    # Of a step that has come already, or comes next, there is what shows late, and what relaxes: as much again at most.
    at_once_Ohm = min(_KNOWN_FACTOR * (max(at_once, 0.0) + 2.0 * std), most_Ohm)
    later_Ohm = min(_KNOWN_FACTOR * (max(later, 0.0) + 2.0 * std) + resistance, most_Ohm)
    parts_V = [at_once_Ohm * present_A, *(later_Ohm * step_A for step_A in others_A)]
    return -sum(min(part_V, 0.0) for part_V in parts_V), sum(max(part_V, 0.0) for part_V in parts_V)
