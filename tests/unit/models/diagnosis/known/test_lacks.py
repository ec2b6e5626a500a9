"""What training runs leave open of effects is no news in a later run; what they tell is."""

import numpy as np
import pytest

from models.diagnosis.known.lacks import NOTHING_LACKS, Lacks, lacks_of
from models.diagnosis.known.left import Left
from models.diagnosis.known.thresholds import KNOWN

N = 400
RNG = np.random.default_rng(11)
GAIN, BEGUN, OTHER, LATER = (RNG.standard_normal((N, 1)) for _ in range(4))
POINT_V2 = 0.1
NONE = np.zeros(0)


def left(prior: float = 1.0) -> Left:
    """Points with one coefficient, of which nothing is known beforehand, and one state at the start."""
    rows = np.hstack([GAIN, 5.0 * BEGUN])
    information = np.diag([1e-9, prior]) + rows.T @ rows / POINT_V2
    return Left(NONE, NONE, NONE, NONE, NONE, rows, information, POINT_V2)


def std(lacks: Lacks, name: str, columns: np.ndarray, rows: np.ndarray) -> float:
    """Of what a run whose coefficient has `rows` may show, the effect making `columns` of it."""
    return float(np.sqrt(np.mean(np.sum(lacks.columns({name: columns}, rows) ** 2, axis=1))))


def test_what_training_runs_show_for_themselves_is_known() -> None:
    found = lacks_of(left(), 1, {"hysteresis": OTHER})
    assert std(found, "hysteresis", OTHER, GAIN) < 0.1 * KNOWN.lacking


def test_what_a_start_stood_for_is_open() -> None:
    """Only the usual size of a start speaks against it."""
    found = lacks_of(left(prior=0.01), 1, {"hysteresis": BEGUN})
    assert std(found, "hysteresis", LATER, GAIN) == pytest.approx(KNOWN.lacking, rel=0.1)


def test_what_the_cell_has_by_another_name_makes_no_difference() -> None:
    """Nobody knows how much of it is the coefficient's, and the two make the same of a later run."""
    found = lacks_of(left(), 1, {"series_resistance": GAIN})
    assert std(found, "series_resistance", GAIN, GAIN) < 0.1 * KNOWN.lacking
    # Where the coefficient makes something else of it, it does.
    assert std(found, "series_resistance", GAIN, 2.0 * GAIN) > 0.9 * KNOWN.lacking


def test_what_is_not_asked_about_is_left_out() -> None:
    """The coefficients would follow what nobody puts in its place."""
    found = lacks_of(left(), 1, {"series_resistance": GAIN, "hysteresis": OTHER})
    assert not found.columns({}, GAIN).any()
    assert std(found, "hysteresis", OTHER, GAIN) < 0.1 * KNOWN.lacking


def test_no_effects_no_lack() -> None:
    assert lacks_of(left(), 1, {}) is NOTHING_LACKS
