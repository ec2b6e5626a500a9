"""Free parameters that stand at some of a network's knots only, and what they are at all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.timeseries import FloatArray


@dataclass(frozen=True)
class Expansion:
    """Parameters of hats: each column of theta is given at some knots and straight in between.

    Attributes
    ----------
    centres : (M,) knots on the partition axis, the outermost two far out
    places : for each of the p columns of theta, the knots at which it is free; held beyond them, but for the last
        column, the open-circuit curve, which goes on as it ended
    """

    centres: FloatArray
    places: tuple[tuple[int, ...], ...]

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return sum(len(each) for each in self.places)

    def matrix(self) -> FloatArray:
        """(M p, P) how `theta.ravel()` follows from the free parameters, column after column."""
        n_models, p = len(self.centres), len(self.places)
        out = np.zeros((n_models, p, self.size))
        first = 0
        for column, each in enumerate(self.places):
            at = self.centres[list(each)]
            hat = np.eye(len(each))
            weights = np.column_stack([np.interp(self.centres, at, row) for row in hat])
            if column == p - 1 and len(each) > 1:
                for end, (near, next_one) in ((0, (0, 1)), (n_models - 1, (-1, -2))):
                    share = (self.centres[end] - at[near]) / (at[next_one] - at[near])
                    weights[end] = (1.0 - share) * hat[near] + share * hat[next_one]
            out[:, column, first : first + len(each)] = weights
            first += len(each)
        return out.reshape(n_models * p, self.size)

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {"centres": self.centres.tolist(), "places": [list(each) for each in self.places]}

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Expansion:
        """Read what `to_json` wrote; a damaged one raises what a damaged document does."""
        places = tuple(tuple(int(k) for k in each) for each in document["places"])
        return cls(np.array(document["centres"], dtype=np.float64), places)
