"""Every form that an effect can take beside the model, and what one or two of them leave of the error.

All regressors are reduced by the model once; after that a pair of effects costs one small system of equations, so that
every pair can be tried. Forward selection alone would pick a third effect that is a mixture of two.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.evidence.candidates import Candidate, Comparison, lean_columns
from models.effects import Effect

# Keeps collinear regressors solvable, relative to their size.
_RIDGE = 1e-6
_TINY = 1e-150
# Error, relative to the effect, of a voltage that is simulated again with the model.
_INEXACT = 0.02


@dataclass(frozen=True)
class Form:
    """One form of one effect.

    Attributes
    ----------
    effect : whose
    columns : (n, k) regressors
    fixed_V : (n,) part of the voltage that goes with them; None: nothing (linear in its coefficients)
    size : number of parameters
    inexact : squared voltage that may remain because the model through which the effect is simulated is inexact, V^2
    """

    effect: Effect
    columns: FloatArray
    fixed_V: FloatArray | None
    size: int
    inexact: float = 0.0


@dataclass(frozen=True)
class Forms:
    """All forms of all effects against one comparison.

    Attributes
    ----------
    comparison : with the error
    forms : of every candidate: its full one, and its smallest for each shape
    """

    comparison: Comparison
    forms: tuple[Form, ...]

    @cached_property
    def _places(self) -> list[np.ndarray]:
        ends = np.cumsum([0, *(form.columns.shape[1] for form in self.forms)])
        return [np.arange(low, high) for low, high in zip(ends[:-1], ends[1:], strict=True)]

    @cached_property
    def _reduced(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Products, reduced by the model, of all columns, of those with what is fixed (the error first), of that."""
        error = self.comparison.evidence.error_V
        columns = np.hstack([form.columns for form in self.forms])
        columns = columns / (np.sqrt((columns**2).sum(axis=0)) + _TINY)
        fixed = [form.fixed_V if form.fixed_V is not None else np.zeros(0) for form in self.forms]
        extra = np.column_stack([error, *(each for each in fixed if len(each))])
        product = self.comparison.evidence.reduced(np.hstack([columns, extra]))
        n = columns.shape[1]
        weights = np.zeros((len(self.forms) + 1, product.shape[1]))
        weights[0, n] = 1.0
        place = n + 1
        for row, each in enumerate(fixed, start=1):
            if len(each):
                weights[row, place] = 1.0
                place += 1
        product[np.arange(n), np.arange(n)] += _RIDGE
        moved = weights @ product
        return product, moved, moved @ weights.T

    def cost(self, *numbers: int) -> float:
        """Remaining error with some forms together, V^2."""
        product, moved, squares = self._reduced
        rows = [1 + each for each in numbers if self.forms[each].fixed_V is not None]
        places = np.concatenate([self._places[each] for each in numbers])
        right = moved[0, places] - moved[rows][:, places].sum(axis=0)
        left = squares[0, 0] - 2.0 * squares[0, rows].sum() + squares[np.ix_(rows, rows)].sum()
        return float(left - right @ np.linalg.solve(product[np.ix_(places, places)], right))

    def judged(self, price: float, *numbers: int) -> float:
        """Remaining error less what is owed to an inexact model, with the price of the parameters, V^2."""
        return self._judged(price, *numbers)[0]

    def _judged(self, price: float, *numbers: int) -> tuple[float, float]:
        """The same, and the remaining error itself: an inexact model may leave several the same."""
        cost, least = self.cost(*numbers), len(self.comparison.evidence.error_V) * self.comparison.own_mse
        forms = [self.forms[number] for number in numbers]
        owed = sum(form.inexact for form in forms)
        return max(cost - owed, min(cost, least)) + price * sum(form.size for form in forms), cost

    def best(self, effect: Effect, price: float) -> int:
        """The form of an effect whose remaining error with the price of its parameters is the least."""
        own = [number for number, form in enumerate(self.forms) if form.effect is effect]
        return min(own, key=lambda number: self.judged(price, number))

    def imitates(self, other: Effect, named: Effect, price: float, worth: float) -> bool:
        """Whether an effect of plausible size that has the named one as its limit leaves hardly more than that does.

        Parameters
        ----------
        other, named : effects, `named` one of those that `other` contains
        price : of a parameter, V^2
        worth : what it may leave more, V^2
        """
        largest = None if other.lean is None else other.lean.largest
        if largest is None or named.name not in other.contains:
            return False
        most = self.cost(self.best(named, price)) + worth
        for number, form in enumerate(self.forms):
            alone = form.effect is other and form.columns.shape[1] == 1
            if alone and self.cost(number) <= most and abs(self._coefficient(number)) <= largest:
                return True
        return False

    def _coefficient(self, number: int) -> float:
        """Coefficient of a form with one linear column, alone."""
        product, moved, _ = self._reduced
        place = int(self._places[number][0])
        norm = float(np.sqrt((self.forms[number].columns ** 2).sum()))
        return float(moved[0, place] / product[place, place]) / norm

    def spent(self, effect: Effect, price: float) -> float:
        """Judged remaining error of an effect's best form, V^2."""
        return self.judged(price, self.best(effect, price))

    def best_pair(self, price: float, effects: Sequence[Effect] | None = None) -> tuple[int, int] | None:
        """Two forms of different effects, of some or of all, neither a part of the other, that leave least together."""
        pairs = [
            pair
            for pair in self._pairs()
            if effects is None or all(self.forms[each].effect in effects for each in pair)
        ]
        if not pairs:
            return None
        return min(pairs, key=lambda pair: self._judged(price, *pair))

    def _pairs(self) -> Iterator[tuple[int, int]]:
        for one, other in combinations(range(len(self.forms)), 2):
            first, second = self.forms[one].effect, self.forms[other].effect
            if first is not second and not nested(first, second) and first.twin != second.name:
                yield one, other


def nested(one: Effect, other: Effect) -> bool:
    """Whether one effect is a special case of the other."""
    return one.name in other.contains or other.name in one.contains


def forms_of(comparison: Comparison, candidates: list[Candidate]) -> Forms:
    """Collect the forms of all candidates."""
    forms = []
    for each in candidates:
        lean = each.effect.lean
        fixed_V = None if each.value is None else comparison.evidence.error_V - each.target_V
        inexact = 0.0 if fixed_V is None else _INEXACT**2 * float((each.contribution_V**2).sum())
        forms.append(Form(each.effect, each.columns, fixed_V, each.size, inexact))
        if lean is None:
            continue
        shapes = lean.shapes(comparison.runs.views[0])
        free = 1 if len(shapes) > 1 else 0
        for shape in shapes:
            x = lean_columns(comparison, lean, shape)
            forms += [Form(each.effect, x[:, :used], None, used + free) for used in sorted({1, x.shape[1]})]
    return Forms(comparison, tuple(forms))
