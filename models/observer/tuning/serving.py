"""From the noise that is most likely to the noise that serves the state of charge best.

The likelihood takes an error of the model that lasts for minutes for one that tells nothing of the state of charge, and
follows it. A filter that waits for it to pass estimates better, and its band can be calibrated as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.observer.filter.settings import ObserverSettings
from models.observer.tuning.calibration import calibrated_band
from models.observer.tuning.unseen import Judged

# Noise that is tried, in multiples of the model's RMS error; with more a wrong start would stand for an hour, which
# runs that are longer than that do not mind. And with each of them, how much of the quick error.
_NOISE = (0.3, 1.0, 4.0)
_QUICK = (1.0, 0.1)
# Then these are moved by a factor at a time, down or up so often at most.
_STEP = 10.0**0.5
_MOVED = (("slow_error_std_V", 1, 1), ("resistance_std", 2, 0))
# Samples that settings are judged by, and the fewest runs: with few the choice is a matter of which runs they are.
_SAMPLES, _FEWEST = 60_000, 3
_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
# What is most likely stays unless something near it is clearly better: it has all samples behind it.
_CLEARLY = 0.9


def serving_best(judged: list[Judged], likely: ObserverSettings, rms_V: float) -> ObserverSettings:
    """Settings near the most likely ones with the best band of the SoC; they themselves, where none is clearly better.

    Parameters
    ----------
    judged : runs with a known SoC, as if the model had not seen them
    likely : settings to begin with
    rms_V : RMS error of the model in free run
    """
    some = spread_runs(judged)
    best, score = likely, calibrated_band(some, likely).score

    def taken(trial: ObserverSettings) -> bool:
        nonlocal best, score
        found = calibrated_band(some, trial).score
        if found > _CLEARLY * score:
            return False
        best, score = trial, found
        return True

    for noise_V in (likely.voltage_std_V, *(share * rms_V for share in _NOISE)):
        for quick in _QUICK:
            trial = replace(likely, voltage_std_V=noise_V, quick_error_std_V=quick * likely.quick_error_std_V)
            if noise_V >= likely.voltage_std_V and trial != likely:
                taken(trial)
    for name, down, up in _MOVED:
        for factor, most in ((1.0 / _STEP, down), (_STEP, up)):
            before = best
            for _ in range(most):
                if not taken(replace(best, **{name: factor * getattr(best, name)})):
                    break
            if best is not before:
                break
    return best


def spread_runs(judged: list[Judged]) -> list[Judged]:
    """Runs spread over all: few runs stand there several times in turn, and every second one would be the same run."""
    total = sum(len(each.run) for each in judged)
    count = min(max(round(_SAMPLES * len(judged) / total), _FEWEST), len(judged))
    order = sorted(range(len(judged)), key=lambda place: place * _GOLDEN % 1.0)
    return [judged[place] for place in sorted(order[:count])]


def judged_noise_V(likely: ObserverSettings, best: ObserverSettings) -> float:
    """White noise that health judges innovations by.

    Halfway: the likely noise alone calls what the model errs by an alarm, the noise chosen for the SoC hides it. A
    quick error that the filter was told to leave in the innovations belongs to them.
    """
    left_V2 = max(likely.quick_error_std_V**2 - best.quick_error_std_V**2, 0.0)
    return float(np.sqrt(likely.voltage_std_V * best.voltage_std_V + left_V2))
