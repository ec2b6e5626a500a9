"""A voltage that does not move although it should: the sensor or its lead is stuck."""

import math
from dataclasses import dataclass, replace

from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.sample import Sample

# Bits that stay the same although the current has moved by this much voltage at the least usual resistance.
_STUCK_V = 5e-3
_STUCK_SAMPLES = 5
# A noisy voltage that stays the same for so often and so long, under a current that does not fade, is none: a constant
# current may be on its way to where the voltage should end it.
_STILL_SAMPLES, _STILL_S, _STILL_SHARE = 100, 120.0, 0.98
_LIVELY_SHARE, _LIVELY_FADE = 0.7, 0.98
_REMEDY = "check the voltage sensor and its leads"


@dataclass(frozen=True, slots=True)
class Stillness:
    """How long the voltage has been the same to the last bit.

    Parameters
    ----------
    held_V, held_A, held : float, float, int
        Voltage that has come again to the last bit, the current that it first came with or has faded to since, and how
        often it has come with a current that must show.
    still, still_s, still_A, lively : int, float, float, float
        How often and for how long it has come at all, with which current at first, and the share of the samples before
        it that had another value than the one before.
    """

    held_V: float = math.nan
    held_A: float = math.nan
    held: int = 0
    still: int = 0
    still_s: float = 0.0
    still_A: float = 0.0
    lively: float = 0.0


def follow(stillness: Stillness, band: CellBand, before: Sample, now: Sample) -> Stillness:
    """Return what is known after one sample more."""
    if now.voltage_V != stillness.held_V:
        share = stillness.lively * _LIVELY_FADE ** (stillness.still + 1) + 1.0 - _LIVELY_FADE
        return Stillness(held_V=now.voltage_V, held_A=now.current_A, still_A=now.current_A, lively=share)
    still_s = stillness.still_s + now.time_s - before.time_s
    stillness = replace(stillness, still=stillness.still + 1, still_s=still_s)
    if now.current_A * stillness.held_A >= 0.0 and abs(now.current_A) <= abs(stillness.held_A):
        return replace(stillness, held_A=now.current_A)  # constant voltage: it is held by a current that fades
    shows = abs(now.current_A - stillness.held_A) * band.usual_Ohm[0] > _STUCK_V * band.cells_in_series
    return replace(stillness, held=stillness.held + shows)


def judge(stillness: Stillness, now: Sample, least_A: float) -> Finding | None:
    """Return what is not plausible about a voltage that has stayed the same."""
    if _stands_still(stillness, now, least_A):
        text = (
            f"voltage {stillness.held_V:.5g} V has come {stillness.still} times to the last bit, in "
            f"{stillness.still_s:.0f} s at {now.current_A:.4g} A, and was noisy before"
        )
        return Finding("trip", "voltage_stuck", text, _REMEDY)
    if stillness.held >= _STUCK_SAMPLES:
        text = (
            f"voltage {stillness.held_V:.5g} V has come {stillness.held} times to the last bit although the current is "
            f"another than the {stillness.held_A:.4g} A that it came with before"
        )
        return Finding("trip", "voltage_stuck", text, _REMEDY)
    return None


def _stands_still(stillness: Stillness, now: Sample, least_A: float) -> bool:
    long = stillness.still >= _STILL_SAMPLES and stillness.still_s >= _STILL_S
    loaded = min(abs(now.current_A), abs(stillness.still_A)) > least_A
    same = now.current_A * stillness.still_A > 0.0 and abs(now.current_A) >= _STILL_SHARE * abs(stillness.still_A)
    return long and loaded and same and stillness.lively >= _LIVELY_SHARE
