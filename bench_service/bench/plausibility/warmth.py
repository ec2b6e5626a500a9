"""Temperatures that do not move under load, and such as move faster than the cell's own heat could make them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

from bench_service.bench.plausibility.band import CellBand
from bench_service.bench.plausibility.finding import Finding
from bench_service.bench.plausibility.response import Response
from bench_service.bench.plausibility.sample import Sample

# A temperature is looked at over this time: so much, and twice what the cell's own heat explains, is plausible.
RATE_WINDOW_S = 10.0
RATE_TRIP_K, RATE_WARN_K = 4.0, 2.5
_OWN_HEAT_FACTOR = 2.0
_OWN_RESISTANCE_FACTOR = 3.0
_POINTS = 12  # of the window
# The same to the last bit although the cell must have warmed by so much.
STUCK_TRIP_K, STUCK_WARN_K = 1.0, 0.6
_COOLING_S = 150.0  # a small cell in moving air
# A temperature that is noisy does not stay the same so often by chance.
STUCK_REPEATS = 40
_LIVELY_SAMPLES, _LIVELY_SHARE = 20, 0.7
_REMEDY = "check the temperature sensor and its contact to the cell"


@dataclass(frozen=True, slots=True)
class Warmth:
    """What is known of the temperature.

    Parameters
    ----------
    points : tuple of (time_s, temperature_degC, heat_K)
        Of the last `RATE_WINDOW_S`, oldest first; heat is the most that the cell's own losses explain since the start.
    heat_K : float
    same, changes, samples : int
        How often the last value has come again, how often it was another one, of so many.
    least_K : float
        Least warming since it last changed.
    """

    points: tuple[tuple[float, float, float], ...] = ()
    heat_K: float = 0.0
    same: int = 0
    changes: int = 0
    samples: int = 0
    least_K: float = 0.0

    @property
    def lively(self) -> bool:
        """Whether the temperature was noisy until it began to repeat itself."""
        before = self.samples - self.same
        return before >= _LIVELY_SAMPLES and self.changes >= _LIVELY_SHARE * before


def follow(warmth: Warmth, band: CellBand, response: Response, before: Sample, now: Sample) -> Warmth:
    """Return what is known after one sample more."""
    dt_s = now.time_s - before.time_s
    square_A2s = max(before.current_A**2, now.current_A**2) * dt_s
    least_Ohm, most_Ohm = _resistances(response, band)
    heat_K = warmth.heat_K + square_A2s * most_Ohm / band.heat_capacity_J_per_K[0]
    same = now.temperature_degC == before.temperature_degC
    fade = math.exp(-dt_s / _COOLING_S)
    least_K = (
        warmth.least_K * fade
        + min(before.current_A**2, now.current_A**2) * dt_s * least_Ohm * fade / (band.heat_capacity_J_per_K[1])
    )
    return replace(
        warmth,
        points=_points(warmth.points, now, heat_K),
        heat_K=heat_K,
        same=warmth.same + 1 if same else 0,
        changes=warmth.changes + (not same),
        samples=warmth.samples + 1,
        least_K=least_K if same else 0.0,
    )


def _resistances(response: Response, band: CellBand) -> tuple[float, float]:
    """Least and largest resistance that may heat the cell."""
    resistance, std = response.resistance_Ohm
    if not (0.0 < std < 0.5 * resistance):
        return band.usual_Ohm[0], band.usual_Ohm[1]
    return max(band.usual_Ohm[0], 0.7 * resistance), min(band.usual_Ohm[1], _OWN_RESISTANCE_FACTOR * resistance)


def _points(
    points: tuple[tuple[float, float, float], ...], now: Sample, heat_K: float
) -> tuple[tuple[float, float, float], ...]:
    """Keep a point each twelfth of the window, and one just outside of it."""
    if points and now.time_s - points[-1][0] < RATE_WINDOW_S / _POINTS:
        return points
    kept: Iterable[tuple[float, float, float]] = points
    if len(points) > 1 and points[1][0] <= now.time_s - RATE_WINDOW_S:
        kept = points[1:]
    return (*kept, (now.time_s, now.temperature_degC, heat_K))


def judge(warmth: Warmth, now: Sample) -> Finding | None:
    """Return what is not plausible about the temperature."""
    return _judge_rate(warmth, now) or _judge_stuck(warmth, now)


def _judge_rate(warmth: Warmth, now: Sample) -> Finding | None:
    if len(warmth.points) < 3:
        return None
    time_s, temperature_degC, heat_K = warmth.points[0]
    rise_K, own_K = now.temperature_degC - temperature_degC, _OWN_HEAT_FACTOR * (warmth.heat_K - heat_K)
    span_s = now.time_s - time_s
    # A window that a slow clock has made longer holds more of everything.
    longer = max(1.0, span_s / RATE_WINDOW_S)
    if rise_K <= RATE_WARN_K * longer + own_K:
        return None
    text = (
        f"temperature rose by {rise_K:.3g} K in {span_s:.3g} s to {now.temperature_degC:.4g} degC, the cell's own heat "
        f"explains {own_K:.2g} K"
    )
    remedy = "leave the cell alone until it is cool: a short inside, or heat from elsewhere; check the sensor"
    return Finding("trip" if rise_K > RATE_TRIP_K * longer + own_K else "warn", "temperature_rate", text, remedy)


def _judge_stuck(warmth: Warmth, now: Sample) -> Finding | None:
    by_heat = warmth.least_K / STUCK_TRIP_K
    by_noise = warmth.same / STUCK_REPEATS if warmth.lively else 0.0
    share = max(by_heat, by_noise)
    if share < STUCK_WARN_K / STUCK_TRIP_K:
        return None
    text = (
        f"temperature {now.temperature_degC:.4g} degC has come {warmth.same + 1} times to the last bit, in which the "
        f"cell has warmed by {warmth.least_K:.2g} K at least"
    )
    return Finding("trip" if share >= 1.0 else "warn", "temperature_stuck", text, _REMEDY)
