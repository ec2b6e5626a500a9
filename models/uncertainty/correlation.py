"""How residuals hang together in time: white noise and a few exponentially fading parts, found in their spectrum."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray

# Fading times that are offered, a factor apart.
_FACTOR = 2.0
# Fading times beyond this share of a run cannot be told from a constant.
_LONGEST_SHARE = 0.25
_LONGEST_PART = 131_072
_BINS_PER_DECADE = 12
_ITERATIONS = 150
# A part that raises the log-likelihood by less than this is taken out: twice it is the 1 % level of the likelihood
# ratio's chi-square, for one of about ten parts is to be found by chance in one of ten white records at most.
_WORTH = 3.32


@dataclass(frozen=True)
class ResidualCorrelation:
    """Autocorrelation `white` at lag 0 plus sum of share * keep**lag.

    Attributes
    ----------
    white : share of the variance that is white noise
    shares, keep : (J,) share and factor per sample of each fading part; `white` and `shares` add up to 1
    """

    white: float
    shares: FloatArray
    keep: FloatArray

    @property
    def inflation(self) -> float:
        """Variance of a long mean over that of white residuals: samples for each independent one."""
        return float(self.white + self.shares @ ((1.0 + self.keep) / (1.0 - self.keep)))

    def between(self, n_samples: int) -> ResidualCorrelation:
        """From one of the samples in between to the next, where only each `n_samples`-th was seen."""
        return replace(self, keep=self.keep ** (1.0 / n_samples))

    def at(self, lag: FloatArray) -> FloatArray:
        """Autocorrelation at whole lags."""
        lag = np.asarray(lag, dtype=np.float64)
        return np.where(lag == 0.0, self.white, 0.0) + (self.shares * self.keep ** lag[..., None]).sum(axis=-1)


def fit_correlation(residual: FloatArray, starts: np.ndarray) -> ResidualCorrelation:
    """Fit the correlation by the likelihood of the periodogram.

    Parameters
    ----------
    residual : (N,) NaN where missing; divided by its local standard deviation where that differs
    starts : first index of each part; parts are independent

    Returns
    -------
    ResidualCorrelation
        White where the residuals show nothing else.

    Notes
    -----
    Whittle, Arkiv foer Matematik 2, 1953, for the likelihood; the multiplicative steps that raise it are those of
    Fevotte, Bertin and Durrieu, Neural Computation 21, 2009, eq. 4.6 with exponent 1/2. The mean of a part counts as
    its lowest frequency: a model's bias in one run is slow error, too.
    """
    parts = _parts(residual, starts)
    if not parts:
        return ResidualCorrelation(1.0, np.zeros(0), np.zeros(0))
    longest = _LONGEST_SHARE * max(len(part) for part in parts)
    times = _FACTOR ** np.arange(0, max(np.floor(np.log(max(longest, 1.0)) / np.log(_FACTOR)), 0) + 1)
    keep = np.exp(-1.0 / times)
    power, weight, spectra = _binned(parts, keep)
    chosen = list(range(len(spectra)))
    sizes, best = _likeliest(power, weight, spectra)
    while len(chosen) > 1:
        # White noise (the first) stays: every voltage has some.
        trials = [(_likeliest(power, weight, spectra[[c for c in chosen if c != k]]), k) for k in chosen[1:]]
        (trial_sizes, likelihood), dropped = max(trials, key=lambda t: t[0][1])
        if likelihood < best - _WORTH:
            break
        chosen.remove(dropped)
        sizes, best = trial_sizes, max(likelihood, best - _WORTH)
    sizes = sizes / sizes.sum()
    return ResidualCorrelation(float(sizes[0]), sizes[1:], keep[[c - 1 for c in chosen[1:]]])


def _parts(residual: FloatArray, starts: np.ndarray) -> list[FloatArray]:
    """Parts with at least a few known samples, long ones cut; gaps filled with zeros, the power made good for them."""
    bounds = [*np.asarray(starts).tolist(), len(residual)]
    parts = []
    for first, end in zip(bounds[:-1], bounds[1:], strict=True):
        for begin in range(first, end, _LONGEST_PART):
            part = residual[begin : min(end, begin + _LONGEST_PART)]
            known = ~np.isnan(part)
            if known.sum() >= 16:
                parts.append(np.where(known, part, 0.0) / np.sqrt(known.mean()))
    return parts


def _binned(parts: list[FloatArray], keep: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean periodogram, number of ordinates and mean model spectra (J + 1, bins) in bins of the frequency."""
    frequency = np.concatenate([np.fft.rfftfreq(len(part)) for part in parts])
    power = np.concatenate([np.abs(np.fft.rfft(part)) ** 2 / len(part) for part in parts])
    weight = np.where(frequency == 0.0, 0.5, 1.0)
    lowest = 0.5 / max(len(part) for part in parts)
    place = np.floor(_BINS_PER_DECADE * np.log10(np.maximum(frequency, lowest) / lowest)).astype(np.int64)
    count = np.bincount(place, weight).astype(np.float64)
    used = count > 0.0

    def mean(values: FloatArray) -> FloatArray:
        return np.bincount(place, weight * values)[used] / count[used]

    cosine = np.cos(2.0 * np.pi * frequency)
    fading = [mean((1.0 - k**2) / (1.0 - 2.0 * k * cosine + k**2)) for k in keep]
    return mean(power), count[used], np.array([np.ones(int(used.sum())), *fading])


def _likeliest(power: FloatArray, weight: FloatArray, spectra: FloatArray) -> tuple[FloatArray, float]:
    """Sizes of the spectra that are most likely, and the log-likelihood."""
    floor = 1e-12 * max(float(power.mean()), 1e-300)
    sizes = np.full(len(spectra), float(weight @ power / weight.sum()) / len(spectra)) + floor
    for _ in range(_ITERATIONS):
        total = sizes @ spectra
        sizes = sizes * np.sqrt((spectra @ (weight * power / total**2)) / (spectra @ (weight / total))) + floor
    total = sizes @ spectra
    return sizes, -float(weight @ (np.log(total) + power / total))
