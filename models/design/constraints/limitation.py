"""The limitation ratio: how much of the largest current the voltage leaves at each state of charge (fig. 2.9)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.design.constraints.limits import Limits, Window
from models.design.constraints.voltage_band import Band
from models.design.information.experiment import Evaluator, Experiment

_POINTS = 17
_FINE = 400


@dataclass(frozen=True)
class LimitationRatio:
    """Share of the current that is allowed at each state of charge.

    Attributes
    ----------
    soc : (n,) rising
    discharge, charge : (n,) 0..1
    """

    soc: FloatArray
    discharge: FloatArray
    charge: FloatArray

    def __post_init__(self) -> None:
        """Check ranges."""
        if len(self.soc) < 2 or (np.diff(self.soc) <= 0.0).any():
            raise ModelError("limitation ratio: its SoC values must rise, and at least two are needed")
        for name in ("discharge", "charge"):
            values = getattr(self, name)
            if len(values) != len(self.soc) or not ((values >= 0.0) & (values <= 1.0)).all():
                raise ModelError(f"limitation ratio: {name} needs one value within 0..1 for each SoC")

    def least(self, sign: float, first: float, second: float) -> float:
        """Smallest share on the way between two states of charge, in a direction of the current."""
        low, high = min(first, second), max(first, second)
        values = self.charge if sign > 0.0 else self.discharge
        inside = values[(self.soc > low) & (self.soc < high)]
        ends = np.interp([low, high], self.soc, values)
        return float(min(ends.min(), inside.min() if len(inside) else 1.0))

    def reach(self, start: float, least: float) -> Window:
        """Lowest and highest state of charge to which a share of the largest current leads from a start."""
        grid = np.unique(np.append(np.linspace(self.soc[0], self.soc[-1], _FINE), start))
        barred_low = grid[(grid < start) & (np.interp(grid, self.soc, self.discharge) < least)]
        barred_high = grid[(grid > start) & (np.interp(grid, self.soc, self.charge) < least)]
        low, high = grid[grid > barred_low.max(initial=-np.inf)], grid[grid < barred_high.min(initial=np.inf)]
        return min(float(low[0]), start), max(float(high[-1]), start)


def default_ratio(window: Window) -> LimitationRatio:
    """Full current in the middle of a window, none out of an empty and none into a full cell.

    Falls over the last tenth of the window at either end, as the ratio of fig. 2.9 does in its outer intervals.
    """
    low, high = window
    edge = 0.1 * (high - low)
    soc = np.array([low, low + edge, high - edge, high])
    return LimitationRatio(soc, np.array([0.0, 1.0, 1.0, 1.0]), np.array([1.0, 1.0, 1.0, 0.0]))


def no_limitation() -> LimitationRatio:
    """Full current everywhere."""
    return LimitationRatio(np.array([0.0, 1.0]), np.ones(2), np.ones(2))


def limitation_ratio(experiment: Experiment, limits: Limits, band: Band, pulse_s: float) -> LimitationRatio:
    """Ratio that keeps the voltage, its band included, inside its limits through a pulse from rest.

    Parameters
    ----------
    experiment : with the network that predicts
    limits : the largest currents, and the voltage's window; without one the ratio is 1
    band : of the predicted voltage
    pulse_s : how long the current is held
    """
    if limits.voltage_V is None:
        return no_limitation()
    experiment = experiment.predicted
    count = max(1, round(pulse_s / experiment.network.structure.dt_s))
    grid = np.linspace(*limits.soc, _POINTS)
    shares = np.ones((2, _POINTS))
    for i, soc in enumerate(grid):
        where = replace(experiment, initial_soc=float(soc), prior=None, sensitivity="free_run")
        evaluator = Evaluator(where, count)
        rest, rest_width = _predicted(evaluator, where, band, np.zeros(count))
        for row, limit_A in enumerate(limits.current_A):
            current = np.full(count, limit_A)
            end, width = _predicted(evaluator, where, band, current)
            high = limit_A > 0.0
            edge, most = (limits.voltage_V[1], max) if high else (limits.voltage_V[0], min)
            sign = 1.0 if high else -1.0
            # The band widens with the current.
            moved = sign * (most(end) - most(rest)) + max(float(width.max() - rest_width.max()), 0.0)
            room = sign * (edge - most(rest)) - float(rest_width.max())
            shares[row, i] = np.clip(room / moved, 0.0, 1.0) if moved > 0.0 else float(room > 0.0)
    return LimitationRatio(grid, shares[0], shares[1])


def _predicted(
    evaluator: Evaluator, experiment: Experiment, band: Band, current_A: FloatArray
) -> tuple[FloatArray, FloatArray]:
    predicted = evaluator.predict(current_A)
    return predicted.voltage_V, band.width_V(experiment, current_A, predicted)
