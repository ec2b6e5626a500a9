"""Voltages that jump without a current that could make them.

Judged one sample late: a voltage that is measured after its current shows a step before the current does.
"""

import math
from dataclasses import dataclass, replace

from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.response import Response
from bench_service.bench.plausibility.sample import Sample

# For each cell: what relaxes after a step, and noise. Half of the way to the trip people are told.
ALLOWED_V = 0.08
WARN_SHARE = 0.5
# A resistance that is known may be so much larger in the next step (temperature, state of charge, slow parts).
_KNOWN_FACTOR = 4.0


@dataclass(frozen=True, slots=True)
class Jumps:
    """The last changes.

    Parameters
    ----------
    steps_A : tuple of float, length 3
        Sizes of the last steps of the current, youngest last.
    change_V, allowed_V : float
        Of the voltage, one sample ago, and what charge and relaxation allowed it.
    most_Ohm : float
        Resistance that is plausible by what was known before that change: what comes with a jump must not explain it.
    """

    steps_A: tuple[float, float, float] = (0.0, 0.0, 0.0)
    change_V: float = 0.0
    allowed_V: float = math.inf
    most_Ohm: float = math.inf


def follow(jumps: Jumps, band: CellBand, known: Response, before: Sample, now: Sample) -> Jumps:
    """Return the changes after one sample more; `known` is the response without that sample."""
    resistance, std = known.resistance_Ohm
    charge_As = max(abs(now.current_A), abs(before.current_A)) * (now.time_s - before.time_s)
    return replace(
        jumps,
        steps_A=(*jumps.steps_A[1:], abs(now.current_A - before.current_A)),
        change_V=now.voltage_V - before.voltage_V,
        allowed_V=ALLOWED_V * band.cells_in_series + band.slope_V_per_As * charge_As,
        most_Ohm=min(_KNOWN_FACTOR * (max(resistance, 0.0) + 2.0 * std), band.possible_Ohm[1]),
    )


def judge(before: Jumps, now: Jumps) -> Finding | None:
    """Return what is not plausible about the change one sample ago."""
    largest_A = max(*before.steps_A, now.steps_A[-1])
    by_step_V = largest_A * before.most_Ohm if largest_A > 0.0 else 0.0
    allowed_V = before.allowed_V + by_step_V
    share = abs(before.change_V) / allowed_V
    if share <= WARN_SHARE:
        return None
    text = (
        f"voltage jumped by {before.change_V:.3g} V from one sample to the next with steps of the current of at most "
        f"{largest_A:.3g} A, plausible are {allowed_V:.2g} V"
    )
    remedy = "check sense leads and cell"
    return Finding("trip" if share > 1.0 else "warn", "voltage_jump", text, remedy)
