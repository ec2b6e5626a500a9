"""Which form a bounded network takes: with the surface's state of charge ahead of the mean, with squared terms.

A form is taken where its error on held-out folds is lower by more than the standard error of the difference: a surface
that runs ahead cannot be told from a moved curve where all runs have the same mean current, and then harms elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from models.identification.bounded.surfaces import Surface, moved_sphere, moved_surface, sphere
from models.identification.bounded.terms import SLOW
from models.identification.bounded.variants import Trials, Variant, clearly_better, temperature_in

# Depth in h, time constant in s and activation in K of the surfaces that are offered. A sphere's depth is its slowest
# time constant over 2675 in units of its own filling; a curve that two electrodes share moves by less.
_SPHERES = ((0.055, 150.0, 3500.0), (0.08, 215.0, 3500.0))
_SURFACES = ((0.02, 200.0, 5500.0), (0.02, 700.0, 5500.0), (0.05, 1000.0, 4500.0), (0.1, 2000.0, 2500.0), *_SPHERES)
_ONE_TEMPERATURE = ((0.02, 200.0, 3500.0), (0.05, 400.0, 3500.0), (0.1, 1500.0, 3500.0), *_SPHERES)
# The same of surfaces that run away where the cell is all but empty: there diffusion is slower by so many times.
_EMPTYING = ((0.05, 1000.0, 6500.0, 30.0), (0.03, 700.0, 7500.0, 100.0))
_EMPTYING_ONE = ((0.02, 200.0, 3500.0, 30.0), (0.05, 400.0, 3500.0, 30.0))
# Time constant in s and activation in K of the sphere that is tried first beside a part of the curve over the mean.
_SPHERE_S, _SPHERE_K = 150.0, 3500.0
# The range of temperature from which on a surface's activation can be told.
_WIDE_K = 10.0
# Numbers of a surface whose diffusion is as fast at empty as elsewhere.
_PLAIN_SURFACE = 3
# Such a one is moved to where the runs have it, if these have one temperature: over a wide range its activation would
# have to go with it, and where it did not a Leaf cell between 10 and 40 degC had 5.2 instead of 3.7 mV at 25 degC. None
# is moved whose error is so many times that of the form without: moving takes off up to a quarter. So many samples tell
# where it goes.
_WITHIN_REACH = 1.25
_MOVING_SAMPLES = 15_000


def best_variant(trials: Trials) -> Variant:
    """Return the form to take: the plain one unless a richer one is clearly better, and then what else is."""
    plain = Variant()
    trials.error(plain)
    logs = trials.known[plain][1]
    best = min((plain, *_richer(trials)), key=lambda variant: trials.mean(trials.error(variant, logs)))
    best = _spared(trials, best, plain)
    for surface in _surfaces(trials, _EMPTYING, _EMPTYING_ONE):
        best = _better(trials, replace(best, surface=surface, squared=True), best)
    best = _better(trials, replace(best, fine_gains=True), best)
    best = _beside(trials, _moved(trials, best))
    # What is better where one fold alone was, and worse everywhere else, only goes on to there by another way.
    return best if trials.typical_V(best) < trials.typical_V(plain) else plain


def _beside(trials: Trials, present: Variant) -> Variant:
    """The form with a part of the curve at the mean state of charge, where this is clearly better.

    Where one of two electrodes diffuses much more slowly, a surface for both stands between theirs. The slow one's own
    is deeper than any that serves alone.
    """
    if SLOW in trials.without:
        return present
    bank, beside = trials.bank, replace(present, behind=True)
    best = present if present.surface is None else _better(trials, beside, present)
    first = replace(beside, surface=sphere(_SPHERE_S, 0.0 if temperature_in(bank) == "missing" else _SPHERE_K))
    if trials.mean(trials.error(first, trials.known[present][1])) > _WITHIN_REACH * trials.mean(trials.error(present)):
        return best
    assert first.surface is not None
    moves_K = bank.span_K >= _WIDE_K
    surface = moved_sphere(_of_surface(trials, first), first.surface, bank.runs[0].dt_s, moves_K=moves_K)
    moved = replace(first, surface=surface)
    found = min((first, moved), key=lambda each: trials.mean(trials.error(each, trials.known[first][1])))
    return _better(trials, found, best)


def _of_surface(trials: Trials, form: Variant) -> Callable[[Surface], float]:
    """Held-out error of a form over other surfaces, on fewer samples and with the strengths that it has."""
    logs = trials.known[form][1]
    keep_every = max(trials.keep_every, round(sum(len(run) for run in trials.bank.runs) / _MOVING_SAMPLES))
    return lambda surface: trials.mean(trials.held_out(replace(form, surface=surface), keep_every).mse(logs))


def _moved(trials: Trials, present: Variant) -> Variant:
    """The form over its surface, or the best one, moved to where the runs have it, where this is clearly better."""
    over = [variant for variant in trials.known if variant.surface and len(variant.surface) == _PLAIN_SURFACE]
    best = min(over, key=lambda variant: trials.mean(trials.error(variant)), default=present)
    start = replace(best, fine_gains=present.fine_gains) if present.surface is None else present
    if start.surface is None or len(start.surface) != _PLAIN_SURFACE or trials.bank.span_K >= _WIDE_K:
        return present
    logs = trials.known[present if start == present else best][1]
    if trials.mean(trials.error(start, logs)) > _WITHIN_REACH * trials.mean(trials.error(present)):
        return present
    surface = moved_surface(_of_surface(trials, start), start.surface, trials.bank.runs[0].dt_s)
    moved = replace(start, surface=surface)
    found = trials.error(moved, trials.known[start][1])
    return moved if clearly_better(found, trials.error(present), trials.counts) else present


def _better(trials: Trials, trial: Variant, present: Variant) -> Variant:
    """Return another form where it is clearly better than the present one."""
    error = trials.error(trial, trials.known[present][1])
    return trial if clearly_better(error, trials.error(present), trials.counts) else present


def _spared(trials: Trials, best: Variant, plain: Variant) -> Variant:
    """Return the form without what it can spare; the plain one, where that does as well."""
    if not clearly_better(trials.error(best), trials.error(plain), trials.counts):
        return plain
    for spared in ("fine_slope", "squared"):
        simpler = replace(best, **{spared: False})
        if not clearly_better(trials.error(best), trials.error(simpler, trials.known[best][1]), trials.counts):
            best = simpler
    return best


def _richer(trials: Trials) -> list[Variant]:
    moves = temperature_in(trials.bank) == "moves"
    surfaces = [None, *_surfaces(trials, _SURFACES, _ONE_TEMPERATURE)]
    return [Variant(surface, squared=True, fine_slope=moves) for surface in surfaces]


def _surfaces(
    trials: Trials, wide: tuple[tuple[float, ...], ...], one: tuple[tuple[float, ...], ...]
) -> list[tuple[float, ...]]:
    """Surfaces to be tried, of those for runs at many temperatures and those for runs at one."""
    if SLOW in trials.without:
        return []
    if trials.bank.span_K >= _WIDE_K:
        return list(wide)
    unscaled = temperature_in(trials.bank) == "missing"
    return [(depth, tau_s, 0.0 if unscaled else kelvin, *more) for depth, tau_s, kelvin, *more in one]
