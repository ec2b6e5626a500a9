"""A current profile: values held forward from their time to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.data.errors import ModelError
from models.data.timeseries import FloatArray

# Of a test at its end, and at most: the slow part of the relaxation shows nowhere else, and the next run begins with a
# cell that has forgotten most of what was done to it.
_FINAL_REST_SHARE, _FINAL_REST_S = 0.12, 1800.0


@dataclass(frozen=True)
class Profile:
    """What a bench plays; the last row ends it.

    Attributes
    ----------
    time_s : (n,) from 0, strictly increasing
    current_A : (n,) positive charges; `current_A[i]` holds from `time_s[i]` to `time_s[i + 1]`
    """

    time_s: NDArray[np.float64]
    current_A: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the form."""
        if len(self.time_s) != len(self.current_A) or len(self.time_s) < 2:
            raise ModelError("a profile needs at least two rows of time and current")
        finite = np.isfinite(self.time_s).all() and np.isfinite(self.current_A).all()
        if not finite or self.time_s[0] != 0.0 or (np.diff(self.time_s) <= 0.0).any():
            raise ModelError("a profile's time must start at 0 s and rise, and all its values must be finite")

    @property
    def duration_s(self) -> float:
        """Time of the last row in s."""
        return float(self.time_s[-1])

    def soc(self, initial_soc: float, capacity_Ah: float) -> FloatArray:
        """Planned state of charge at each row."""
        charge_As = np.concatenate([[0.0], np.cumsum(self.current_A[:-1] * np.diff(self.time_s))])
        return initial_soc + charge_As / (3600.0 * capacity_Ah)


def final_rest_s(duration_s: float) -> float:
    """Rest at the end of a test of a given duration."""
    return min(_FINAL_REST_S, _FINAL_REST_SHARE * duration_s)
