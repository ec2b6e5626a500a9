"""Pulses, moves and rests that follow each other from rest to rest inside the limits."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.limitation import LimitationRatio
from models.design.constraints.limits import InfeasibleError, Limits

# Of the largest current: moves of the charge, and the pulses that they begin with.
PULSE_SHARE_OF_LIMIT = 0.8
# Pulses behind a block show what the limits allow: a model that has never seen it would have to guess.
FULL_PULSE = 1.0
# A move with less than this share of the current would take the time of the whole test.
LEAST_SHARE = 0.05
# Towards an end of the window the current falls in such steps as the voltage leaves less of it.
_TAPER = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, LEAST_SHARE)
_TAPER_SOC = 0.01


class SequenceBuilder:
    """Appends pieces that begin and end at rest, and keeps count of the state of charge.

    Parameters
    ----------
    limits : current, window of the state of charge, ramp
    capacity_Ah, initial_soc : of the cell
    dt_s : sampling time
    pulse_s : duration of a pulse
    ratio : how much of the largest current is allowed at each state of charge
    """

    def __init__(
        self,
        limits: Limits,
        capacity_Ah: float,
        initial_soc: float,
        dt_s: float,
        pulse_s: float,
        ratio: LimitationRatio,
    ) -> None:
        self._limits, self._dt_s, self._pulse_s, self._ratio = limits, dt_s, pulse_s, ratio
        self._parts, self._at = [np.zeros(0)], 0
        self._per_A = dt_s / 3600.0 / capacity_Ah
        self.soc = initial_soc

    def append(self, current_A: FloatArray) -> int:
        """Append samples as they are; returns the number of the first."""
        first = self._at
        self._parts.append(np.asarray(current_A, dtype=np.float64))
        self._at += len(current_A)
        self.soc += float(current_A.sum()) * self._per_A
        return first

    def rest(self, duration_s: float) -> None:
        """Append a rest."""
        self.append(np.zeros(max(1, round(duration_s / self._dt_s))))

    def pulse(self, sign: float, share: float, duration_s: float) -> None:
        """Append a pulse, the other way round where the window has no room for it, or smaller where neither has."""
        low, high = self._limits.soc
        count = max(1, round(duration_s / self._dt_s))
        rooms = {way: (high - self.soc) if way > 0.0 else (self.soc - low) for way in (sign, -sign)}
        sizes_A = {way: share * self._allowed_A(way, self._after(way, share, count)) for way in (sign, -sign)}
        shapes = {way: self._trapezoid(way, sizes_A[way], count) for way in (sign, -sign)}
        fits = [way for way in (sign, -sign) if abs(shapes[way].sum()) * self._per_A <= rooms[way]]
        way = fits[0] if fits else max(rooms, key=lambda w: rooms[w])
        needed = abs(float(shapes[way].sum())) * self._per_A
        self.append(shapes[way] * min(1.0, max(rooms[way], 0.0) / max(needed, 1e-300)))

    def approach(self, level: float, direction: float) -> None:
        """Move to a level so that it is reached in a direction, by a pulse at the least."""
        low, high = self._limits.soc
        count = max(1, round(self._pulse_s / self._dt_s))
        least = PULSE_SHARE_OF_LIMIT * self._limit_A(direction) * self._per_A * count
        if (level - self.soc) * direction < 0.5 * least:
            self._move(min(max(level - direction * least, low), high))
        self._move(level)

    def reach(self, soc: float) -> None:
        """Go towards an end of the window, by smaller currents where the voltage leaves no more, as near as it lets."""
        sign = 1.0 if soc > self.soc else -1.0
        steps = np.linspace(self.soc, soc, max(1, int(np.ceil(abs(soc - self.soc) / _TAPER_SOC))) + 1)
        shares = [self._tapered(sign, float(a), float(b)) for a, b in zip(steps[:-1], steps[1:], strict=True)]
        for k, share in enumerate(shares):
            if share == 0.0:
                break
            if k + 1 == len(shares) or shares[k + 1] != share:
                self._hold_until(float(steps[k + 1]), PULSE_SHARE_OF_LIMIT * share * self._limit_A(sign))

    def _tapered(self, sign: float, first: float, second: float) -> float:
        allowed = self._ratio.least(sign, first, second)
        return next((share for share in _TAPER if share <= allowed), 0.0)

    def current_A(self) -> FloatArray:
        """Return all samples."""
        return np.concatenate(self._parts)

    def _after(self, sign: float, share: float, count: int) -> float:
        """State of charge after a pulse of full size."""
        return self.soc + sign * share * self._limit_A(sign) * count * self._per_A

    def _allowed_A(self, sign: float, soc: float) -> float:
        """Size of the largest current on the way to a state of charge."""
        return self._limit_A(sign) * self._ratio.least(sign, self.soc, soc)

    def _limit_A(self, sign: float) -> float:
        low_A, high_A = self._limits.current_A
        return high_A if sign > 0.0 else -low_A

    def _move(self, soc: float) -> None:
        """Hold the pulses' current for as long as it takes, a little less so that whole samples meet the charge."""
        needed = (soc - self.soc) / self._per_A
        full_A = PULSE_SHARE_OF_LIMIT * self._limit_A(needed)
        if abs(needed) < 1e-6 * full_A:
            return
        size_A = PULSE_SHARE_OF_LIMIT * self._allowed_A(needed, soc)
        if size_A < LEAST_SHARE * full_A:
            raise InfeasibleError(
                f"limit voltage_V and soc_levels are in conflict: between SoC {self.soc:.3f} and {soc:.3f} the "
                f"predicted voltage, its uncertainty included, leaves less than {100.0 * LEAST_SHARE:.0f} % of the "
                "current. Take levels further from the ends, widen the window, or refine the model first"
            )
        self._hold_until(soc, size_A)

    def _hold_until(self, soc: float, size_A: float) -> None:
        """Hold a current, or a little less, for as many whole samples as it takes to a state of charge."""
        needed = (soc - self.soc) / self._per_A
        if not abs(needed) > 0.0:
            return
        count = max(1, int(np.ceil(abs(needed) / size_A - 1e-9)))
        shape = self._trapezoid(float(np.sign(needed)), size_A, count)
        while abs(float(shape.sum())) < abs(needed) * (1.0 - 1e-12):
            # The ramps take a part: as many samples more as the missing charge needs.
            count += max(1, int((abs(needed) - abs(float(shape.sum()))) / size_A))
            shape = self._trapezoid(float(np.sign(needed)), size_A, count)
        self.append(shape * (needed / float(shape.sum())))

    def _trapezoid(self, sign: float, size_A: float, count: int) -> FloatArray:
        """Constant current with the ramps that the limits ask for, from rest to rest."""
        ramp = self._limits.ramp_A_per_s
        shape = np.full(count, size_A)
        if ramp is not None:
            k, (fall, rise) = np.arange(count), (-ramp[0] * self._dt_s, ramp[1] * self._dt_s)
            up, down = (rise, fall) if sign > 0.0 else (fall, rise)
            # With a sample at rest behind: the next piece begins from there.
            shape = np.append(np.minimum(shape, np.minimum((k + 1) * up, (count - k) * down)), 0.0)
        return sign * shape
