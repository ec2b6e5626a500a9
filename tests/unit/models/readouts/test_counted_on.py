from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.regression import CellContext
from models.readouts.counted_on import Counting, counted_anew, passed_before_Ah

# One hour of -1 A: half of a cell of 2 Ah.
RUN = to_grid(
    TimeSeries(np.arange(3601.0), np.full(3601, -1.0), np.full(3601, 3.5), np.full(3601, 25.0), name="one"), 1.0
)
CELL = CellContext(2.0)
BEFORE = Counting([RUN], [0.9], CELL)


def test_only_what_begins_where_a_run_has_ended_is_counted_anew() -> None:
    (end,) = counted_anew([0.4], BEFORE, Counting([RUN], [0.9], CellContext(1.0)))
    assert end == pytest.approx(-0.1, abs=1e-3)
    assert counted_anew([0.41, 0.9], BEFORE, Counting([RUN], [0.9], CellContext(1.0))) == [0.41, 0.9]


def test_where_the_counting_was_right_the_statement_stays_to_the_last_digit() -> None:
    assert counted_anew([0.40001], BEFORE, Counting([RUN], [0.9], CELL)) == [0.40001]


def test_a_start_that_was_wrong_moves_what_follows_as_well() -> None:
    assert counted_anew([0.4], BEFORE, Counting([RUN], [0.85], CELL)) == pytest.approx([0.35], abs=1e-3)


def test_a_current_that_was_read_wrong_moves_what_follows_too() -> None:
    more = replace(RUN, charge_Ah=1.1 * RUN.charge_Ah)
    assert counted_anew([0.4], BEFORE, Counting([more], [0.9], CELL)) == pytest.approx([0.35], abs=1e-3)


def test_what_had_passed_before_a_run_is_counted_through_those_that_it_follows() -> None:
    def passed(*soc: float) -> list[float]:
        return passed_before_Ah(Counting([RUN] * len(soc), list(soc), CELL))

    assert passed(0.9, 0.4, -0.1) == pytest.approx([0.0, 1.0, 2.0], abs=1e-3)
    # The second follows nothing that is there, the third the first.
    assert passed(0.9, 0.7, 0.4) == pytest.approx([0.0, 0.0, 1.0], abs=1e-3)
    # Nothing follows a run that comes after it.
    assert passed(0.4, 0.9) == [0.0, 0.0]
