"""What an experiment must not do to a cell, and whether a current does it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray

Window = tuple[float, float]
# Rounding of sums over long currents; far below what a bench can set.
_ROUNDING = 1e-9


class InfeasibleError(ModelError):
    """No current keeps all limits; the message names those in conflict."""


@dataclass(frozen=True)
class CurrentBounds:
    """Limits of the current at each sample, where they are narrower than the cell's.

    Attributes
    ----------
    low_A, high_A : (N,) at an SoC where the limitation ratio is 1
    soc, discharge_ratio, charge_ratio : (n,) limitation ratio over SoC; negative bounds are multiplied by the first,
        positive ones by the second
    """

    low_A: FloatArray
    high_A: FloatArray
    soc: FloatArray = field(default_factory=lambda: np.array([0.0, 1.0]))
    discharge_ratio: FloatArray = field(default_factory=lambda: np.ones(2))
    charge_ratio: FloatArray = field(default_factory=lambda: np.ones(2))

    def at(self, soc: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bounds in A for given SoC at the start of each sample."""
        discharge = np.interp(soc, self.soc, self.discharge_ratio)
        charge = np.interp(soc, self.soc, self.charge_ratio)
        low = self.low_A * np.where(self.low_A < 0.0, discharge, charge)
        high = self.high_A * np.where(self.high_A < 0.0, discharge, charge)
        return low, high


@dataclass(frozen=True)
class Limits:
    """Limits of an experiment, each as (low, high).

    Attributes
    ----------
    current_A : largest discharge (negative) and charge current
    soc : window of the state of charge
    voltage_V : of the cell's voltage as the model predicts it, its uncertainty included; None: not watched
    temperature_degC : of the cell's temperature as a thermal model predicts it; None: not watched
    ramp_A_per_s : steepest fall (negative) and rise, from rest at the start and to rest at the end; None: steps
    net_charge_Ah : charge over the whole experiment; None: whatever the window of the state of charge leaves
    """

    current_A: Window
    soc: Window = (0.0, 1.0)
    voltage_V: Window | None = None
    temperature_degC: Window | None = None
    ramp_A_per_s: Window | None = None
    net_charge_Ah: Window | None = None

    def __post_init__(self) -> None:
        """Check that each limit leaves room."""
        for name in ("current_A", "soc", "voltage_V", "temperature_degC", "ramp_A_per_s", "net_charge_Ah"):
            window = getattr(self, name)
            if window is None:
                continue
            low, high = window
            if not (np.isfinite(window).all() and low <= high) or (low == high and name != "net_charge_Ah"):
                raise InfeasibleError(f"limit {name} is {low:g}..{high:g}: the low end must lie below the high end")
        for name in ("current_A", "ramp_A_per_s"):
            window = getattr(self, name)
            if window is not None and not window[0] < 0.0 < window[1]:
                raise InfeasibleError(f"limit {name} is {window[0]:g}..{window[1]:g}: it must hold 0 between its ends")
        if not (0.0 <= self.soc[0] and self.soc[1] <= 1.0):
            raise InfeasibleError(f"limit soc is {self.soc[0]:g}..{self.soc[1]:g}: it must lie within 0..1")


def soc_path(current_A: FloatArray, initial_soc: float, soc_per_A: float, efficiency: float) -> FloatArray:
    """(N + 1,) state of charge before each sample and after the last."""
    counted = np.where(current_A > 0.0, efficiency, 1.0) * current_A
    return initial_soc + np.concatenate([[0.0], np.cumsum(counted)]) * soc_per_A


def broken(
    limits: Limits, bounds: CurrentBounds, current_A: FloatArray, soc: FloatArray, dt_s: float
) -> dict[str, float]:
    """By how much a current breaks each of the limits that need no model.

    Parameters
    ----------
    limits, bounds : what holds
    current_A : (N,)
    soc : (N + 1,) as `soc_path` gives it
    dt_s : sampling time

    Returns
    -------
    dict
        Largest excess in the limit's unit, of the broken limits only.
    """
    low, high = bounds.at(soc[:-1])
    found = {
        "current_A": _excess(current_A, limits.current_A),
        "load_cycle_A": float(np.maximum(low - current_A, current_A - high).max()),
        "soc": _excess(soc[1:], limits.soc),
    }
    if limits.ramp_A_per_s is not None:
        steps = np.diff(np.concatenate([[0.0], current_A, [0.0]])) / dt_s
        found["ramp_A_per_s"] = _excess(steps, limits.ramp_A_per_s)
    if limits.net_charge_Ah is not None:
        found["net_charge_Ah"] = _excess(np.array([current_A.sum() * dt_s / 3600.0]), limits.net_charge_Ah)
    return {name: excess for name, excess in found.items() if excess > _ROUNDING}


def _excess(values: FloatArray, window: Window) -> float:
    return float(max(window[0] - values.min(), values.max() - window[1]))
