"""Limits of a bench or of a run."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

Window = tuple[float, float]
WINDOWS = {"voltage_V": "V", "current_A": "A", "temperature_degC": "degC", "soc": ""}


@dataclass(frozen=True, slots=True)
class Limits:
    """What must never be left; windows are ``(low, high)``, both allowed.

    Parameters
    ----------
    voltage_V, current_A, temperature_degC, soc : tuple of float
    ramp_A_per_s : float or None
        Largest change of the current per second; None allows steps.
    duration_s : float
        Longest run.
    """

    voltage_V: Window
    current_A: Window
    temperature_degC: Window
    soc: Window
    ramp_A_per_s: float | None
    duration_s: float

    def __post_init__(self) -> None:
        """Refuse windows that are empty or not finite: a limit that compares with NaN protects nothing."""
        for name in WINDOWS:
            low, high = getattr(self, name)
            if not (math.isfinite(low) and math.isfinite(high) and low < high):
                raise ValueError(f"limit {name} = ({low}, {high}) is no window; low must be below high")
        if self.ramp_A_per_s is not None and not 0 < self.ramp_A_per_s < math.inf:
            raise ValueError(f"limit ramp_A_per_s = {self.ramp_A_per_s} A/s must be positive and finite")
        if not 0 < self.duration_s < math.inf:
            raise ValueError(f"limit duration_s = {self.duration_s} s must be positive and finite")

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Return the limits of a JSON object with exactly the fields' names.

        Raises
        ------
        ValueError
            A field is missing, unknown or no number.
        """
        names = {*WINDOWS, "ramp_A_per_s", "duration_s"}
        if set(data) != names:
            raise ValueError(f"limits need exactly {sorted(names)}, got {sorted(data)}")
        try:
            windows = {name: (float(data[name][0]), float(data[name][1])) for name in WINDOWS}
            ramp = data["ramp_A_per_s"]
            return cls(
                **windows,
                ramp_A_per_s=None if ramp is None else float(ramp),
                duration_s=float(data["duration_s"]),
            )
        except (TypeError, IndexError) as error:
            raise ValueError(f"limits are not numbers: {error}") from error

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object that `from_json` reads."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in asdict(self).items()}

    def between_samples(self, dt_s: float, tick_s: float) -> Self:
        """Return limits for set-points that change at samples only: each change is played within one tick."""
        return self if self.ramp_A_per_s is None else replace(self, ramp_A_per_s=self.ramp_A_per_s * tick_s / dt_s)

    def wider_than(self, outer: "Limits") -> str | None:
        """Return the first limit in which these limits leave `outer`, as text; None if they nowhere do."""
        for name, unit in WINDOWS.items():
            (low, high), (outer_low, outer_high) = getattr(self, name), getattr(outer, name)
            if low < outer_low or high > outer_high:
                return f"{name} {low:g} to {high:g} {unit}, the bench allows {outer_low:g} to {outer_high:g}"
        if outer.ramp_A_per_s is not None and (self.ramp_A_per_s or math.inf) > outer.ramp_A_per_s:
            return f"ramp {self.ramp_A_per_s} A/s, the bench allows {outer.ramp_A_per_s:g} A/s"
        if self.duration_s > outer.duration_s:
            return f"duration {self.duration_s:g} s, the bench allows {outer.duration_s:g} s"
        return None
