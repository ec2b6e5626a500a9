"""A second beginning of the search for a structure: an equivalent circuit's terms, few, with their constants moved.

The search of `auto_structure` begins with diffusion and many fixed time constants and adds terms one by one. Where the
cell is a circuit with hysteresis, each of those stands in for another: no single step leads to few slow terms beside a
hysteresis of the right rate, and the settled resistance is then shared out wrongly between hysteresis, surface and slow
low-passes although the voltage is simulated well. From here these constants are found by moving each of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from models.identification.search.auto import AutoCandidate

_TIMES_S = (2.0, 30.0, 1000.0)
_RATE = 25.0
_RATES = (8.0, 25.0, 80.0)
_SIZES = (12, 16, 24)
_EXCHANGE_C_RATE = (None, 0.3, 6.0)


def circuit_candidate(capacity_Ah: float, warm: bool) -> AutoCandidate:
    """Three time constants, charge transfer and hysteresis, as pulse tests of most cells show them.

    Parameters
    ----------
    capacity_Ah : of the cell
    warm : whether the runs' temperatures differ enough to show what temperature does
    """
    return AutoCandidate(
        capacity_Ah,
        time_constants_s=_TIMES_S,
        activation_K=2500.0 if warm else 0.0,
        entropic=warm,
        exchange_c_rate=2.0,
        hysteresis_rates=(_RATE,),
        n_models=12,
    )


def circuit_starts(capacity_Ah: float, warm: bool) -> list[AutoCandidate]:
    """Candidates whose constants are moved before anything else is tried: hysteresis slow, middling and fast.

    Hysteresis and slow diffusion stand in for each other, and moving both ends where it began on the wrong side.
    """
    return [replace(circuit_candidate(capacity_Ah, warm), hysteresis_rates=(rate,)) for rate in _RATES]


def circuit_alternatives(best: AutoCandidate, warm: bool, stage: int) -> list[AutoCandidate] | None:
    """What is tried next to `best` in one stage, after which the constants are moved again; None ends the search."""
    stages: list[Callable[[], list[AutoCandidate]]] = [
        lambda: [replace(best, n_models=size) for size in _SIZES],
        lambda: [replace(best, exchange_c_rate=rate) for rate in _EXCHANGE_C_RATE],
        lambda: [replace(best, hysteresis_rates=())],
        lambda: [replace(best, entropic=not best.entropic)] if warm else [],
    ]
    return stages[stage]() if stage < len(stages) else None
