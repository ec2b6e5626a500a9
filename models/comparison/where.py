"""Where a model is off, over two variables at once: maps for the eye, and the few regions that stand out, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypedDict

import numpy as np

from models.comparison.profile import ErrorProfile, error_profiles
from models.comparison.samples import REST_C_RATE, ErrorSamples, error_samples, spread
from models.comparison.shares import telling
from models.comparison.simulated_runs import RunComparison
from models.data.timeseries import FloatArray
from models.network.cell_model import CellModel

_SOC_EDGES = np.linspace(0.0, 1.0, 11)
_C_RATES = np.array([-4.0, -3.0, -2.0, -1.5, -1.0, -0.5, -0.05, 0.05, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])
_TEMPERATURE_STEPS_K = (1.0, 2.5, 5.0, 10.0)
_MOST_TEMPERATURES = 12
# A cell of a map with fewer samples shows chance.
_FEWEST_SAMPLES = 5
_MOST_REGIONS = 4
_LEAST_SHARE_OF_TIME = 0.005
_LEAST_SHARE_OF_ERROR = 0.03
_LEAST_CONTRAST = 1.5


@dataclass(frozen=True)
class Condition:
    """One side of a region: a range of one variable.

    Attributes
    ----------
    variable, low, high, unit : None where the range has no end there
    text : as a person says it
    holds : (n,) bool
    """

    variable: str
    low: float | None
    high: float | None
    unit: str
    text: str
    holds: np.ndarray

    def to_json(self) -> ConditionRange:
        """Return a document of plain types."""
        return {"variable": self.variable, "from": self.low, "to": self.high, "unit": self.unit}


ConditionRange = TypedDict("ConditionRange", {"variable": str, "from": float | None, "to": float | None, "unit": str})
"""One side of a region, for the outside."""


class Region(TypedDict):
    """A place that holds much of the error in little of the time."""

    text: str
    conditions: list[ConditionRange]
    rmse_mV: float
    share_of_squared_error: float
    share_of_time: float


class MapAxis(TypedDict):
    """One variable of a map."""

    variable: str
    unit: str
    edges: list[float]


class PairMap(TypedDict):
    """Residual over a pair of variables, rows by y."""

    x: MapAxis
    y: MapAxis
    rmse_mV: list[list[float]]
    bias_mV: list[list[float]]
    share_of_time: list[list[float]]


class ErrorMap(TypedDict):
    """Where a model is off; see `error_map`."""

    maps: list[PairMap]
    regions: list[Region]
    profiles: list[ErrorProfile]
    outside_training: float


def error_map(network: CellModel, compared: list[RunComparison]) -> ErrorMap:
    """Maps of the residual over pairs of variables, and the regions that hold most error in least time.

    Parameters
    ----------
    network : the model
    compared : runs beside their free runs, as `models.comparison.simulated_runs.simulate_runs` gives them

    Returns
    -------
    dict
        ``maps``: of each ``x`` and ``y`` (variable, unit, edges), ``rmse_mV``, ``bias_mV`` (measured minus model) and
        ``share_of_time``, rows by y, NaN where fewer than 5 samples lie; ``regions``: ranked, with ``text``,
        ``conditions``, ``rmse_mV`` and the shares; ``profiles``: see
        `models.comparison.profile`; ``outside_training``: share of samples outside the trained domain,
        which are in neither.
    """
    samples, outside = error_samples(network, compared)
    maps = [_map(samples, "current_A")]
    if spread(samples.temperature_degC) >= _TEMPERATURE_STEPS_K[0]:
        maps.append(_map(samples, "temperature_degC"))
    return {
        "maps": maps,
        "regions": regions(samples),
        "profiles": error_profiles(samples),
        "outside_training": outside,
    }


def _map(samples: ErrorSamples, variable: str) -> PairMap:
    if variable == "current_A":
        values, unit = samples.c_rate * samples.capacity_Ah, "A"
        edges = _covering(_C_RATES * samples.capacity_Ah, values)
    else:
        values, unit = samples.temperature_degC, "degC"
        edges = _temperature_edges(values)
    soc_edges = _covering(_SOC_EDGES, samples.soc)
    known = ~np.isnan(values)
    bins = [_bin(edges, values[known]), _bin(soc_edges, samples.soc[known])]
    shape = (len(edges) - 1, len(soc_edges) - 1)
    flat = np.ravel_multi_index(tuple(bins), shape)
    error = samples.error_V[known]
    n = np.bincount(flat, minlength=shape[0] * shape[1]).astype(float)
    seen = np.where(n >= _FEWEST_SAMPLES, n, np.nan)
    total = np.bincount(flat, error, minlength=len(n)) / seen
    squared = np.bincount(flat, error**2, minlength=len(n)) / seen
    return {
        "x": {"variable": "soc", "unit": "1", "edges": soc_edges.tolist()},
        "y": {"variable": variable, "unit": unit, "edges": edges.tolist()},
        "rmse_mV": (1e3 * np.sqrt(squared)).reshape(shape).tolist(),
        "bias_mV": (1e3 * total).reshape(shape).tolist(),
        "share_of_time": (n / len(samples.error_V)).reshape(shape).tolist(),
    }


def _bin(edges: FloatArray, values: FloatArray) -> np.ndarray:
    return np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)


def _covering(edges: FloatArray, values: FloatArray) -> FloatArray:
    """The edges from the last one below all values to the first one above; what lies beyond goes to the ends."""
    first = max(int(np.searchsorted(edges, values.min(), side="right")) - 1, 0)
    last = min(int(np.searchsorted(edges, values.max(), side="left")), len(edges) - 1)
    return edges[first : max(last, first + 1) + 1]


def _temperature_edges(values: FloatArray) -> FloatArray:
    span = spread(values)
    step = next((s for s in _TEMPERATURE_STEPS_K if span / s <= _MOST_TEMPERATURES), span / _MOST_TEMPERATURES)
    low, high = np.floor(np.nanmin(values) / step), np.ceil(np.nanmax(values) / step)
    return step * np.arange(low, max(high, low + 1.0) + 1.0)


def regions(samples: ErrorSamples) -> list[Region]:
    """The regions of one or two conditions in which the error is concentrated, the most telling first.

    Notes
    -----
    Each is the one with the largest scan statistic, see `shares.telling`; its samples are then taken out and another
    is looked for, so that one spot is not told four times.
    """
    conditions = _conditions(samples)
    masks = np.array([each.holds for each in conditions], dtype=np.float32)
    squared, left = samples.error_V**2, np.ones(len(samples.error_V), dtype=bool)
    found: list[Region] = []
    while len(found) < _MOST_REGIONS and left.any() and squared[left].sum() > 0.0:
        pair = _most_telling(masks, squared * left / squared.sum(), left / len(left))
        if pair is None:
            break
        chosen = [conditions[k] for k in sorted(set(pair))]
        inside = np.logical_and.reduce([each.holds for each in chosen]) & left
        found.append(_region(chosen, inside, squared))
        left &= ~inside
    return found


def _most_telling(masks: np.ndarray, error_share: FloatArray, time_share: FloatArray) -> tuple[int, int] | None:
    """Indices of the conditions whose overlap stands out most; one condition alone is the pair with itself.

    `error_share` and `time_share` (n,) are what each sample has of all, 0 where it has been told already.
    """
    s = (masks * error_share.astype(np.float32)) @ masks.T
    t = (masks * time_share.astype(np.float32)) @ masks.T
    score = telling(s, t)
    enough = (t >= _LEAST_SHARE_OF_TIME) & (s >= _LEAST_SHARE_OF_ERROR) & (s >= _LEAST_CONTRAST * t)
    score[~enough] = -np.inf
    # A second condition must earn its place in the sentence.
    score[~np.eye(len(score), dtype=bool)] *= 0.9
    best = int(np.argmax(score))
    first, second = divmod(best, len(score))
    return (first, second) if np.isfinite(score[first, second]) and score[first, second] > 0.0 else None


def _region(chosen: list[Condition], inside: np.ndarray, squared: FloatArray) -> Region:
    share_error, share_time = float(squared[inside].sum() / squared.sum()), float(inside.mean())
    place = ", ".join(each.text for each in chosen)
    return {
        "text": f"{100 * share_error:.0f} % of the squared error in {100 * share_time:.0f} % of the time: {place}",
        "conditions": [each.to_json() for each in chosen],
        "rmse_mV": 1e3 * float(np.sqrt(squared[inside].mean())),
        "share_of_squared_error": share_error,
        "share_of_time": share_time,
    }


def _conditions(samples: ErrorSamples) -> list[Condition]:
    found = [
        *_ends("soc", "1", samples.soc, np.round(np.arange(0.1, 0.95, 0.1), 1), "SoC {} {:.1f}"),
        *_middle(samples),
        *_current(samples),
        *_since_step(samples),
        *_part_of_time(samples),
    ]
    if spread(samples.temperature_degC) >= _TEMPERATURE_STEPS_K[0]:
        edges = _temperature_edges(samples.temperature_degC)[1:-1]
        found += _ends("temperature_degC", "degC", samples.temperature_degC, edges, "cell {} {:g} degC")
    return [each for each in found if each.holds.any() and not each.holds.all()]


def _ends(variable: str, unit: str, values: FloatArray, edges: FloatArray, words: str) -> list[Condition]:
    below = [Condition(variable, None, float(e), unit, words.format("below", e), values < e) for e in edges]
    above = [Condition(variable, float(e), None, unit, words.format("above", e), values >= e) for e in edges]
    return [*below, *above]


def _middle(samples: ErrorSamples) -> list[Condition]:
    pairs = [(low / 10, (low + width) / 10) for width in (2, 3) for low in range(1, 10 - width)]
    return [
        Condition("soc", low, high, "1", f"SoC {low:.1f} to {high:.1f}", (samples.soc >= low) & (samples.soc < high))
        for low, high in pairs
    ]


def _current(samples: ErrorSamples) -> list[Condition]:
    rate, scale = samples.c_rate, samples.capacity_Ah
    found = [
        Condition(
            "current_A",
            -REST_C_RATE * scale,
            REST_C_RATE * scale,
            "A",
            "at rest",
            np.abs(rate) <= REST_C_RATE,
        ),
        Condition("current_A", None, -REST_C_RATE * scale, "A", "discharge", rate < -REST_C_RATE),
        Condition("current_A", REST_C_RATE * scale, None, "A", "charge", rate > REST_C_RATE),
    ]
    for limit in (1.0, 2.0, 3.0):
        found.append(Condition("current_A", None, -limit * scale, "A", f"discharge above {limit:g}C", rate < -limit))
        found.append(Condition("current_A", limit * scale, None, "A", f"charge above {limit:g}C", rate > limit))
    return found


def _since_step(samples: ErrorSamples) -> list[Condition]:
    since = samples.since_step_s
    words = ((10.0, "10 s"), (60.0, "1 min"), (600.0, "10 min"))
    variable = "since_step_s"
    first = [Condition(variable, None, e, "s", f"within {w} after a current step", since < e) for e, w in words]
    later = [Condition(variable, e, None, "s", f"later than {w} after a current step", since >= e) for e, w in words]
    return [*first, *later]


def _part_of_time(samples: ErrorSamples) -> list[Condition]:
    part = samples.progress
    return [
        Condition("progress", None, 1 / 3, "1", "in the first third of the test", part < 1 / 3),
        Condition("progress", 2 / 3, None, "1", "in the last third of the test", part >= 2 / 3),
    ]
