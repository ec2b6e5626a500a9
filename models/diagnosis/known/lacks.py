"""What a known cell may lack: effects that its training runs do not tell from their starts and from its coefficients.

A loop or a slow branch that the starts of the training runs stood for is missing in the cell as it was, and would look
new in every later run. What the training runs say against it is a regression with starts and coefficients free to
follow; what they leave open of it is no news.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.known.left import Left
from models.diagnosis.known.scaled import solve_scaled
from models.diagnosis.known.thresholds import KNOWN

# Of what is open beforehand, below which nothing is open.
_NOTHING = 0.02


@dataclass(frozen=True)
class Lacks:
    """What is open of effects, alike in every run.

    Attributes
    ----------
    effects : (E,) name of the effect of each column
    root : (E, r) columns' sizes, in units of the usual ones, of r independent directions of variance 1
    follow : (P, E) by how much the cell's coefficients follow each, V
    """

    effects: tuple[str, ...]
    root: FloatArray
    follow: FloatArray

    def columns(self, own: Mapping[str, FloatArray], rows: FloatArray) -> FloatArray:
        """(m, r) V of one standard deviation in each direction, of the effects that are asked about alone.

        Parameters
        ----------
        own : by effect, (m, k) V of usual sizes at samples of a run
        rows : (m, P) derivatives of the voltage to the cell's coefficients there
        """
        out, names = np.zeros((len(rows), self.root.shape[1])), np.array(self.effects)
        for name, columns in own.items():
            places = np.flatnonzero(names == name)
            if len(places) == columns.shape[1]:
                out += (columns + rows @ self.follow[:, places]) @ self.root[places]
        return out


NOTHING_LACKS = Lacks((), np.zeros((0, 0)), np.zeros((0, 0)))


def lacks_of(left: Left, size: int, own: Mapping[str, FloatArray]) -> Lacks:
    """What training runs leave open of effects.

    Parameters
    ----------
    left : points of the training runs
    size : number P of the cell's coefficients
    own : by effect, (m, k) V of usual sizes at these points
    """
    if not own:
        return NOTHING_LACKS
    columns = np.hstack(list(own.values()))
    across = left.rows.T @ columns / left.point_V2
    follow = -solve_scaled(left.information, across)
    information = columns.T @ columns / left.point_V2 + across.T @ follow
    informed, axes = np.linalg.eigh(0.5 * (information + information.T))
    std = 1.0 / np.sqrt(np.maximum(informed, 0.0) + KNOWN.lacking**-2)
    kept = std > _NOTHING * KNOWN.lacking
    names = tuple(name for name, each in own.items() for _ in range(each.shape[1]))
    return Lacks(names, axes[:, kept] * std[kept], follow[:size])
