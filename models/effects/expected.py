"""How large a change of an effect is to be expected: columns of unit prior, and what a person is told of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.view import View


@dataclass(frozen=True)
class Told:
    """One figure that a person reads: a base plus a weighted sum of the sizes of the columns.

    Attributes
    ----------
    name, unit : of the parameter
    weights : (k,)
    base : value of no change
    """

    name: str
    unit: str
    weights: tuple[float, ...]
    base: float = 0.0


@dataclass(frozen=True)
class Form:
    """One shape that an effect may have.

    Attributes
    ----------
    columns : (m, k) V, each for a change of its usual size
    told : figures, the effect's first parameter first
    fixed : values of the shape, by name and unit
    least : smallest change that the first column can stand for, in units of its usual size: what is nothing already
        cannot become less
    dU_dT_V_per_K : (m, k) change of the entropic coefficient that a column is, which heats with the current; None: none
    of_model : whether it changes a part that the model has: the training runs say how large that was, and neither is it
        lacking nor does a little of it come and go
    untold : of such a one, the part of a usual change that the training runs leave open and no coefficient stands for
    """

    columns: FloatArray
    told: tuple[Told, ...]
    fixed: tuple[tuple[str, str, float], ...] = ()
    least: float = -np.inf
    dU_dT_V_per_K: FloatArray | None = None
    of_model: bool = False
    untold: float = 0.0


@dataclass(frozen=True)
class Expected:
    """What a change of an effect is expected to be like.

    Attributes
    ----------
    forms : view -> shapes, equally likely; None: it is simulated again by its `shift`, or does not show in the voltage
    width : view -> usual size of the shift's value
    starts : sizes in units of the width from which the search for a shift begins
    from_best : whether it begins from the best of these alone; else from each
    warmth : usual changes of the values of `warmth`, as many as it has
    furthest : sizes in units of the usual one beyond which none is looked for
    share : prior weight beside that of an effect with one shape; less where many shapes could pass for chance
    granted : view -> part of the usual size that is there in any log and no news
    learned : whether a little of it may be new in any run, by as much as the training runs show; not where another
        effect looks much like it, which stands for both wherever effects are not weighed against each other
    heat_shares : shares of its loss that may warm the cell, equally likely; none: all of it where it is a loss inside
    unseen : view -> shapes as they might have been in a run in which `forms` finds none, to say what would have shown
    found_from : view -> smallest size of its first figure that can be promised to be found in such a run, whatever its
        shape alone says; infinite: none can
    """

    forms: Callable[[View], tuple[Form, ...]] | None = None
    width: Callable[[View], float] | None = None
    starts: tuple[float, ...] = (-1.0, 0.0, 1.0)
    from_best: bool = False
    warmth: tuple[float, ...] = ()
    furthest: float = 8.0
    share: float = 1.0
    granted: Callable[[View], float] | None = None
    learned: bool = True
    heat_shares: tuple[float, ...] = ()
    unseen: Callable[[View], tuple[Form, ...]] | None = None
    found_from: Callable[[View], float] | None = None


def one_form(columns: FloatArray, name: str, unit: str, weight: float) -> tuple[Form, ...]:
    """A single shape, whose first column has a size of `weight` in the unit of the effect's first parameter."""
    weights = (weight, *(0.0 for _ in range(columns.shape[1] - 1)))
    return (Form(columns, (Told(name, unit, weights),)),)


def alike(knots: FloatArray, length: float) -> FloatArray:
    """(n, n) root of the covariance of a smooth curve of variance 1 at knots."""
    apart = (knots[:, None] - knots[None, :]) / length
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
    return vectors * np.sqrt(np.maximum(values, 0.0))
