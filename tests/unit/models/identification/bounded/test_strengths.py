"""Which strengths the folds choose."""

from dataclasses import replace

import numpy as np
import pytest

from models.identification.bounded.problem import Sums
from models.identification.bounded.strengths import START, HeldOut
from models.identification.bounded.variants import Trials, Variant
from tests.unit.models.identification.bounded.bank import bank


class OneKnee(HeldOut):
    """Four folds that know all of the curve, one that has a knee to itself, by how strongly the curve is held."""

    def _of_fold(self, logs: tuple[float, ...], fold: int) -> float:
        stronger = abs(logs[0] - START[0])
        return (0.055 - 2.6e-3 * stronger if fold == 4 else 1e-3 + 0.7e-3 * stronger) ** 2


@pytest.fixture(scope="module")
def sums() -> Sums:
    return Trials(bank(n=1500)).held_out(Variant(), 1).sums


def test_a_fold_that_has_a_knee_to_itself_does_not_decide_for_all(sums: Sums) -> None:
    knee = OneKnee(replace(sums, count=np.ones(5)))
    assert knee.best()[0] > START[0] + 3.0
    assert knee.even(START)[0] == START[0]
    assert knee.even((3.0, *START[1:]), START)[0] == START[0]


def test_the_typical_error_counts_each_fold_by_its_samples(sums: Sums) -> None:
    held = HeldOut(sums)
    expected = np.average(np.sqrt(np.sqrt(held.mse(START))), weights=sums.count) ** 2
    assert held.typical_V(START) == pytest.approx(expected)
    assert held.typical_V(held.even(START)) <= held.typical_V(START)
    assert held.typical_V(held.even(START, held.best())) <= held.typical_V(held.best())
