"""What a control process knows about its bench's chamber."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from bench_service.protocol.program import ChamberWindow


@dataclass(frozen=True, slots=True)
class ChamberSettings:
    """One temperature chamber.

    Parameters
    ----------
    url, map : str
    temperature_degC : (low, high)
        Of its set points.
    tolerance_K : float
        How near to its set point its air counts as there.
    overshoot_K : float
        How far its air may be beyond the window before a run is ended.
    timeout_s : float
        Longest wait for one answer.
    lost_s : float
        How long a run goes on without an answer.
    at_end : str or float
        What becomes of it when nothing needs it any more: ``off``, ``keep``, or a set point in degC.
    """

    url: str
    map: str
    temperature_degC: tuple[float, float]
    tolerance_K: float = 1.0
    overshoot_K: float = 5.0
    timeout_s: float = 1.0
    lost_s: float = 30.0
    at_end: str | float = "off"

    @property
    def window(self) -> ChamberWindow:
        """What protocols may ask of it."""
        return ChamberWindow(self.temperature_degC, self.tolerance_K)

    @property
    def air_degC(self) -> tuple[float, float]:
        """Between which temperatures its air must be."""
        low, high = self.temperature_degC
        return low - self.overshoot_K, high + self.overshoot_K

    @classmethod
    def from_json(cls, data: Mapping[str, Any] | None) -> Self | None:
        """Read what ``dataclasses.asdict`` gave; raises `ValueError`."""
        try:
            return None if data is None else cls(**{**data, "temperature_degC": tuple(data["temperature_degC"])})
        except (KeyError, TypeError) as error:
            raise ValueError(f"chamber settings: {error}") from error
