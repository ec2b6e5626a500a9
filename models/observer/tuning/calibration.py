"""How wide the band of the SoC must be: estimates from wrong starts and with sensor offsets, held against the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.network.signals import soc_by_counting
from models.observer.filter.fuzzy_observer import FuzzyObserver
from models.observer.filter.settings import ObserverSettings
from models.observer.tuning.unseen import Judged
from models.uncertainty.bands import NORMAL_95

# Wrong starts, each with an offset of the current sensor in multiples of the assumed standard deviation. The band is
# widened by no more than this, and never narrower than the filter's own: what hours of calibration have told of the
# start and the sensors, a shorter run does not know.
_STARTS_OFF = ((-0.3, -1.0), (0.0, 0.0), (0.3, 1.0))
_BAND_FACTORS = (1.0, 8.0)
_HELD = 0.95
# This part of a run is left to the start. Neighbouring samples say the same; one in so many is enough to judge by.
_SETTLING = 20
_EVERY = 10


@dataclass(frozen=True)
class Band:
    """How good estimates from wrong starts and with sensor offsets are.

    Attributes
    ----------
    soc_rmse : RMS error of the SoC
    factor : by how much the standard deviation must be widened so that 1.96 of it hold 95 % of the errors
    score : mean interval score of the band so widened (Gneiting and Raftery, J. Am. Stat. Assoc. 102, 2007, eq. 43):
        its width, and what lies beyond it times 2 / 0.05; small for an accurate estimate whose band follows its error
    """

    soc_rmse: float
    factor: float
    score: float


def calibrated_band(judged: list[Judged], settings: ObserverSettings) -> Band:
    """Judge settings by the SoC that they lead to, and say by how much the band must be wider.

    The likelihood sees how the model's error changes from sample to sample; what stays with a place on the
    open-circuit curve, and what a bent curve does to a linear filter, it hardly sees.
    """
    errors, stds = [], []
    for each in judged:
        network, run, soc = each.network, each.run, each.initial_soc
        observer = FuzzyObserver(network, replace(settings, band_factor=1.0))
        counted = soc_by_counting(run.charge_Ah, soc, network.cell.capacity_Ah, network.cell.efficiency)
        late, seen = slice(len(run) // _SETTLING, None, _EVERY), []
        for off, offset in _STARTS_OFF:
            state = observer.initial(float(np.clip(soc + off, 0.0, 1.0)))
            current_A = run.current_A + offset * settings.current_offset_std_C * network.cell.capacity_Ah
            seen.append(observer.replay(state, current_A, run.voltage_V, run.temperature_degC)[1][late, :2])
        errors.append(np.concatenate([np.abs(rows[:, 0] - counted[late]) for rows in seen]))
        stds.append(np.concatenate([np.maximum(rows[:, 1], 1e-9) for rows in seen]))
    error, std = np.concatenate(errors), np.concatenate(stds)
    widest = _ratio_that_holds([error / std for error, std in zip(errors, stds, strict=True)])
    factor = float(np.clip(widest / NORMAL_95, *_BAND_FACTORS))
    half_width = factor * NORMAL_95 * std
    score = 2.0 * half_width + 2.0 / (1.0 - _HELD) * np.maximum(error - half_width, 0.0)
    return Band(float(np.sqrt(np.mean(error**2))), factor, float(np.mean(score)))


def _ratio_that_holds(ratios: list[FloatArray]) -> float:
    """Error in standard deviations that 95 % stay below, in a run that was not among those it was found from.

    Errors differ more from run to run than within one: the quantile is raised until each run, judged by the quantile
    of the others, is held often enough on average.
    """
    together = np.concatenate(ratios)
    for level in np.arange(_HELD, 0.9951, 0.005) if len(ratios) > 1 else ():
        held = [
            np.mean(own <= np.quantile(np.concatenate(ratios[:i] + ratios[i + 1 :]), level))
            for i, own in enumerate(ratios)
        ]
        if np.mean(held) >= _HELD:
            return float(np.quantile(together, level))
    return float(np.quantile(together, _HELD if len(ratios) == 1 else 0.995))
