"""Depth and time constant of a surface's state of charge, moved from those of a table to what the runs show.

Surfaces of a table stand apart by factors of two and more. A cell's own lies between them, and then none of them is
clearly better than the mean state of charge, or two of them tie: which one is taken was decided by chance, and each
left more error than the surface between them.
"""

from __future__ import annotations

from collections.abc import Callable

Surface = tuple[float, ...]

# Factors by which depth and time constant are moved in turn; steps below a quarter changed held-out errors by less than
# a percent. Chosen, as all that follows, on `benchmarks/design_coverage.py`, seeds 20 to 24.
_STEPS = (1.5, 1.25)
# A move has to pay by this share of the error: less is not told from chance by five folds.
_WORTH = 0.005
# Ranges of the depth in h and of the time constant in s: those of the table, and a factor of two to four beyond.
_DEPTH_H, _TAU_S = (0.01, 0.15), (40.0, 2000.0)
# A sphere's depth in h is its slowest time constant over so many seconds: 15 hours over the squared first root of
# tan x = x (Crank, as in `filters.diffusion`). Ranges in which that and its activation in K are moved, and the factor.
_SPHERE_S_PER_H = 2675.0
_SPHERE_RANGES, _SPHERE_STEP = ((40.0, 600.0), (1500.0, 7000.0)), 1.4
# A time constant of fewer samples is none.
_FASTEST_SAMPLES = 2.0


def moved_surface(error: Callable[[Surface], float], surface: Surface, dt_s: float) -> Surface:
    """Return the surface with the least error that single moves lead to.

    Parameters
    ----------
    error : held-out error of a surface
    surface : to begin with: depth in h, time constant in s, then what is kept
    dt_s : sampling time
    """
    best, least = surface, error(surface)
    ranges = (_DEPTH_H, (max(_TAU_S[0], _FASTEST_SAMPLES * dt_s), _TAU_S[1]))
    for step in _STEPS:
        before: Surface | None = None
        while best != before:
            before = best
            for place, (low, high) in enumerate(ranges):
                for factor in (step, 1.0 / step):
                    at, (best, least) = best, _along(error, (best, least), place, factor, (low, high))
                    if best != at:
                        break
    return best


def sphere(tau_s: float, kelvin: float) -> Surface:
    """Return the surface of a sphere by its slowest time constant in s and its activation in K."""
    return float(f"{tau_s / _SPHERE_S_PER_H:.3g}"), tau_s, kelvin


def moved_sphere(error: Callable[[Surface], float], surface: Surface, dt_s: float, *, moves_K: bool) -> Surface:
    """Return the sphere's surface with the least error that single moves lead to.

    Parameters
    ----------
    error : held-out error of a surface
    surface : of a sphere, to begin with
    dt_s : sampling time
    moves_K : whether its activation is moved as well
    """
    best, least = surface[1:], error(surface)
    low_s = max(_SPHERE_RANGES[0][0], _FASTEST_SAMPLES * dt_s)
    ranges = ((low_s, _SPHERE_RANGES[0][1]), _SPHERE_RANGES[1])
    for place in (0, 1, 0) if moves_K else (0,):
        for factor in (_SPHERE_STEP, 1.0 / _SPHERE_STEP):
            at, (best, least) = best, _along(lambda s: error(sphere(*s)), (best, least), place, factor, ranges[place])
            if best != at:
                break
    return sphere(*best)


def _along(
    error: Callable[[Surface], float],
    found: tuple[Surface, float],
    place: int,
    factor: float,
    within: tuple[float, float],
) -> tuple[Surface, float]:
    """Surface and error after as many moves of one number in one direction as pay."""
    best, least = found
    while True:
        trial = (*best[:place], float(f"{factor * best[place]:.3g}"), *best[place + 1 :])
        if not within[0] <= trial[place] <= within[1]:
            return best, least
        own = error(trial)
        if own > (1.0 - _WORTH) * least:
            return best, least
        best, least = trial, own
