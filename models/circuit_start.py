"""A second beginning of the search for a structure: an equivalent circuit's terms, few, with their constants moved.

The search of `auto_structure` begins with diffusion and many fixed time constants and adds terms one by one. Where the
cell is a circuit with hysteresis, each of those stands in for another: no single step leads to few slow terms beside a
hysteresis of the right rate, and the settled resistance is then shared out wrongly between hysteresis, surface and slow
low-passes although the voltage is simulated well. From here these constants are found by moving each of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from models.auto_structure import AutoCandidate, share_of_soc
from models.regression import SignalBank

_TIMES_S = (2.0, 30.0, 1000.0)
_RATE = 25.0
# Hysteresis and slow diffusion stand in for each other: their constants are moved together, on an even grid of factors
# first and then in ever smaller steps around the best.
_RATES = tuple(_RATE * 1.6**k for k in range(-4, 5))
_SLOWEST_S = tuple(_TIMES_S[-1] * 2.0**k for k in (-1, 0, 1))
_STEPS = (1.26, 1.12, 1.06)
_LARGEST_SHARE = 0.5
_SIZES = (12, 16, 24)
_EXCHANGE_C_RATE = (None, 0.3, 1.0, 6.0)
_ACTIVATION_K = (1700.0, 3500.0)


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


def stands_apart(best: AutoCandidate, bank: SignalBank) -> bool:
    """Whether the runs tell the slowest low-pass and the hysteresis from the open-circuit curve.

    A candidate for which they do not is exact on these runs and far off at another load, see `share_of_soc`.
    """
    names = [f"low_pass:{best.time_constants_s[-1]:g}", *(f"hysteresis_state:{r:g}" for r in best.hysteresis_rates)]
    return all(share_of_soc(bank, name) <= _LARGEST_SHARE for name in names)


def circuit_alternatives(best: AutoCandidate, warm: bool, stage: int) -> list[AutoCandidate] | None:
    """What is tried next to `best` in one stage; None ends the search."""

    def grid() -> list[AutoCandidate]:
        pairs = [(rate, slowest_s) for rate in _RATES for slowest_s in _SLOWEST_S]
        return [replace(best, hysteresis_rates=(r,), time_constants_s=(*_TIMES_S[:-1], s)) for r, s in pairs]

    stages: list[Callable[[], list[AutoCandidate]]] = [
        grid,
        lambda: [replace(best, n_models=size) for size in _SIZES],
        lambda: [replace(best, exchange_c_rate=rate) for rate in _EXCHANGE_C_RATE],
        lambda: [replace(best, activation_K=k) for k in _ACTIVATION_K] if warm else [],
        lambda: [replace(best, hysteresis_rates=())],
    ]
    for step in _STEPS:
        around = (1.0 / step, 1.0, step)
        stages += [partial(_around, best, around), partial(_middle, best, around)]
    # The curve's resolution again, now that it is not asked to stand in for wrong constants.
    stages.append(lambda: [replace(best, n_models=size) for size in _SIZES])
    stages.append(lambda: [replace(best, entropic=not best.entropic)] if warm else [])
    return stages[stage]() if stage < len(stages) else None


def _around(best: AutoCandidate, factors: tuple[float, ...]) -> list[AutoCandidate]:
    return [_moved(best, f, g) for f in factors for g in factors]


def _middle(best: AutoCandidate, factors: tuple[float, ...]) -> list[AutoCandidate]:
    fast, middle, slow = best.time_constants_s
    return [replace(best, time_constants_s=(fast, _rounded(f * middle), slow)) for f in factors]


def _moved(best: AutoCandidate, rate_factor: float, time_factor: float) -> AutoCandidate:
    """Candidate with another hysteresis rate and another slowest time constant."""
    fast, middle, slow = best.time_constants_s
    rates = tuple(_rounded(rate_factor * rate) for rate in best.hysteresis_rates)
    return replace(best, hysteresis_rates=rates, time_constants_s=(fast, middle, _rounded(time_factor * slow)))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")
