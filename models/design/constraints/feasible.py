"""Currents that keep all limits: every current can be moved into them, and what leaves here has been checked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.anchor import linear_anchor
from models.design.constraints.limiter import FlatLimits, limit
from models.design.constraints.limits import CurrentBounds, InfeasibleError, Limits, broken, soc_path
from models.design.constraints.projection import nearest_within
from models.design.constraints.reachable import corridor, reachable_bounds
from models.design.constraints.voltage_band import Band, colder_words
from models.design.information.experiment import Evaluator, Experiment
from models.network.compiled_network import flat_network

_RENEWALS = 12
_BAND_SLACK = 0.01
# Of the widest band that a sample has had, at each renewal: where its current was made smaller, the band is narrower,
# and the wide one would let no current pass there any more.
_KEPT_WIDTH = 0.85
_BLENDS = 40
# From which renewal on the current is made smaller, over which time before each sample that is outside, and to which
# share.
_EASED_AFTER, _EASED_S, _EASED_TO = 3, 60.0, 0.7

# Predicted temperature in degC of a current, uncertainty added.
TemperatureOf = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Demands:
    """Everything that a current has to keep.

    Attributes
    ----------
    limits : Limits
    bounds : narrower limits of the current at each sample; None: the limits' own
    band : of the predicted voltage; needed where the limits watch the voltage
    temperature_of : predicts the temperature; needed where the limits watch it
    """

    limits: Limits
    bounds: CurrentBounds | None = None
    band: Band | None = field(default=None, repr=False)
    temperature_of: TemperatureOf | None = field(default=None, repr=False)


class Feasible:
    """Moves currents of one length into all limits.

    Parameters
    ----------
    experiment : where the cell stands, and the model that predicts it
    demands : what has to be kept
    n_samples : length of the currents

    Raises
    ------
    InfeasibleError
        No current keeps the limits; the message names those in conflict.
    """

    def __init__(self, experiment: Experiment, demands: Demands, n_samples: int) -> None:
        if n_samples < 1:
            raise InfeasibleError("duration: the experiment holds no sample; make it at least one sampling time long")
        for name, source in (("voltage_V", demands.band), ("temperature_degC", demands.temperature_of)):
            if getattr(demands.limits, name) is not None and source is None:
                raise InfeasibleError(f"limit {name} is given, but nothing predicts it with its uncertainty")
        experiment = experiment.predicted
        self._experiment, self._demands = experiment, demands
        network = experiment.network
        self._net = flat_network(network)
        self._dt_s = network.structure.dt_s
        self._soc_per_A, self._efficiency = self._net.soc_per_A, network.cell.efficiency
        low_A, high_A = demands.limits.current_A
        bounds = demands.bounds or CurrentBounds(np.full(n_samples, low_A), np.full(n_samples, high_A))
        if len(bounds.low_A) != n_samples:
            raise InfeasibleError(
                f"load cycle: its limits hold for {len(bounds.low_A)} samples, the experiment has {n_samples}"
            )
        self._bounds = reachable_bounds(demands.limits, bounds, self._dt_s)
        self._flat = self._flatten()
        # Bounds and charge alone: the projection is the whole answer.
        ratios = (bounds.discharge_ratio, bounds.charge_ratio)
        steady = self._efficiency == 1.0 and all(bool(np.all(np.asarray(ratio) == 1.0)) for ratio in ratios)
        self._convex = steady and demands.limits.ramp_A_per_s is None
        # Sums of the current up to and with each sample.
        start = experiment.initial_soc
        self._sum_low = (self._flat.soc_low[1:] - start) / self._soc_per_A
        self._sum_high = (self._flat.soc_high[1:] - start) / self._soc_per_A
        self._evaluator = Evaluator(replace(experiment, sensitivity="free_run"), n_samples)
        self.anchor_A = self._anchor(n_samples)

    @property
    def limits(self) -> Limits:
        """What has to be kept."""
        return self._demands.limits

    def project(self, current_A: FloatArray) -> FloatArray:
        """Move a current into the limits: the nearest by bounds and charge, then sample by sample by all the others.

        The voltage's by the band last renewed.
        """
        near, out = np.empty(len(current_A)), np.empty(len(current_A))
        flat, where = self._flat, self._experiment
        nearest_within(current_A, flat.low_A, flat.high_A, self._sum_low, self._sum_high, near)
        if self._convex and not flat.watch_voltage:
            return near
        limit(self._net, flat, near, where.initial_soc, where.temperature_degC, where.lead, out)
        return out

    def renew(self, current_A: FloatArray) -> bool:
        """Take the voltage's band at this current from now on; whether there is one."""
        if self._demands.limits.voltage_V is None or self._demands.band is None:
            return False
        self._take(self._width_V(current_A))
        return True

    def _width_V(self, current_A: FloatArray) -> FloatArray:
        """(N,) half width of the voltage's band at a current; 0 where there is none."""
        band = self._demands.band
        if band is None:
            return np.zeros(len(current_A))
        return band.width_V(self._experiment, current_A, self._evaluator.predict(current_A))

    def _take(self, width: FloatArray) -> None:
        window = self._demands.limits.voltage_V
        if window is None:
            return
        low, high = window[0] + width, window[1] - width
        zero = self._experiment.network.to_volts(np.zeros(1))[0]
        span = self._experiment.network.voltage_span_V
        self._flat = self._flat._replace(watch_voltage=True, y_low=(low - zero) / span, y_high=(high - zero) / span)

    def finish(self, current_A: FloatArray) -> FloatArray:
        """Return a current that keeps every limit, as near to this one as can be had; checked, not assumed."""
        current_A, widest = self.project(current_A), np.zeros(len(current_A))
        for number in range(_RENEWALS):
            if not self.excess(current_A):
                return current_A
            # The band moves with the current that it is taken at: each sample keeps most of the widest that it has
            # had, else they would take turns.
            width = self._width_V(current_A)
            widest = np.maximum(_KEPT_WIDTH * widest, (1.0 + number * _BAND_SLACK) * width)
            self._take(widest)
            if number >= _EASED_AFTER:
                current_A = self._eased(current_A, width)
            current_A = self.project(current_A)
        if not self.excess(current_A):
            return current_A
        good, bad, found = 0.0, 1.0, self.anchor_A
        for _ in range(_BLENDS):
            share = 0.5 * (good + bad)
            trial = self.anchor_A + share * (current_A - self.anchor_A)
            if self.excess(trial):
                bad = share
            else:
                good, found = share, trial
        return found

    def _eased(self, current_A: FloatArray, width: FloatArray) -> FloatArray:
        """A smaller current before the voltage would leave its limits: that of the sample alone may come too late."""
        low, high = self._demands.limits.voltage_V or (-np.inf, np.inf)
        voltage = self._evaluator.predict(current_A).voltage_V
        outside = np.flatnonzero((voltage - width < low) | (voltage + width > high))
        near = np.zeros(len(current_A), dtype=bool)
        for k in outside.tolist():
            near[max(0, k - max(1, round(_EASED_S / self._dt_s))) : k + 1] = True
        return np.where(near, self.anchor_A + _EASED_TO * (current_A - self.anchor_A), current_A)

    def excess(self, current_A: FloatArray) -> dict[str, float]:
        """By how much a current breaks each limit; empty where it keeps them all."""
        soc = soc_path(current_A, self._experiment.initial_soc, self._soc_per_A, self._efficiency)
        found = broken(self._demands.limits, self._bounds, current_A, soc, self._dt_s)
        limits = self._demands.limits
        if limits.voltage_V is not None:
            low, high = self.voltage_band_V(current_A)
            outside = float(max(limits.voltage_V[0] - low.min(), high.max() - limits.voltage_V[1]))
            if outside > 0.0:
                found["voltage_V"] = outside
        if limits.temperature_degC is not None and self._demands.temperature_of is not None:
            degC = self._demands.temperature_of(current_A)
            outside = float(max(limits.temperature_degC[0] - degC.min(), degC.max() - limits.temperature_degC[1]))
            if outside > 0.0:
                found["temperature_degC"] = outside
        return found

    def voltage_band_V(self, current_A: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest voltage that the model expects of each sample."""
        predicted = self._evaluator.predict(current_A)
        band = self._demands.band
        width = band.width_V(self._experiment, current_A, predicted) if band is not None else 0.0
        return predicted.voltage_V - width, predicted.voltage_V + width

    def touched(self, current_A: FloatArray) -> np.ndarray:
        """(N,) whether each sample lies at one of its limits (within 0.1 % of the window)."""
        limits = self._demands.limits
        soc = soc_path(current_A, self._experiment.initial_soc, self._soc_per_A, self._efficiency)
        low, high = self._bounds.at(soc[:-1])
        near = 1e-3 * (limits.current_A[1] - limits.current_A[0])
        at = (current_A <= low + near) | (current_A >= high - near)
        near = 1e-3 * (limits.soc[1] - limits.soc[0])
        at |= (soc[1:] <= limits.soc[0] + near) | (soc[1:] >= limits.soc[1] - near)
        if limits.ramp_A_per_s is not None:
            steps = np.diff(current_A, prepend=0.0) / self._dt_s
            at |= (steps <= 0.999 * limits.ramp_A_per_s[0]) | (steps >= 0.999 * limits.ramp_A_per_s[1])
        if limits.voltage_V is not None:
            lowest, highest = self.voltage_band_V(current_A)
            near = 1e-3 * (limits.voltage_V[1] - limits.voltage_V[0])
            at |= (lowest <= limits.voltage_V[0] + near) | (highest >= limits.voltage_V[1] - near)
        return at

    def _flatten(self) -> FlatLimits:
        limits, bounds = self._demands.limits, self._bounds
        n = len(bounds.low_A)
        start = self._experiment.initial_soc
        soc_low, soc_high = corridor(limits, bounds, start, self._soc_per_A, self._efficiency, self._dt_s)
        fall, rise = np.inf, np.inf
        if limits.ramp_A_per_s is not None:
            fall, rise = -limits.ramp_A_per_s[0] * self._dt_s, limits.ramp_A_per_s[1] * self._dt_s
        return FlatLimits(
            low_A=np.ascontiguousarray(bounds.low_A),
            high_A=np.ascontiguousarray(bounds.high_A),
            ratio_soc=np.asarray(bounds.soc, np.float64),
            discharge_ratio=np.asarray(bounds.discharge_ratio, np.float64),
            charge_ratio=np.asarray(bounds.charge_ratio, np.float64),
            fall_A=float(fall),
            rise_A=float(rise),
            soc_low=soc_low,
            soc_high=soc_high,
            watch_voltage=False,
            y_low=np.full(n, -np.inf),
            y_high=np.full(n, np.inf),
        )

    def _anchor(self, n_samples: int) -> FloatArray:
        """A current that keeps all limits: rest where that is allowed."""
        limits = self._demands.limits
        rest = self.project(np.zeros(n_samples))
        if self._linear_excess(rest):
            start = self._experiment.initial_soc
            rest = linear_anchor(limits, self._bounds, self._flat, self._soc_per_A, start, self._dt_s)
        left = self.excess(rest)
        if left:
            raise InfeasibleError(self._complaint(rest, left))
        self.renew(rest)
        return rest

    def _linear_excess(self, current_A: FloatArray) -> dict[str, float]:
        soc = soc_path(current_A, self._experiment.initial_soc, self._soc_per_A, self._efficiency)
        return broken(self._demands.limits, self._bounds, current_A, soc, self._dt_s)

    def _complaint(self, current_A: FloatArray, left: dict[str, float]) -> str:
        limits = self._demands.limits
        if "voltage_V" in left and limits.voltage_V is not None:
            low, high = self.voltage_band_V(current_A)
            return (
                f"limit voltage_V is {limits.voltage_V[0]:g}..{limits.voltage_V[1]:g} V, but with the smallest current "
                f"that the other limits leave the model expects {low.min():.3f}..{high.max():.3f} V, its uncertainty "
                "included: widen the window, start at another SoC, refine the model" + colder_words(self._experiment)
            )
        names = ", ".join(f"{name} (by {excess:.3g})" for name, excess in left.items())
        return f"limits are in conflict: no current keeps {names} together with the others"
