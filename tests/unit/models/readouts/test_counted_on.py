import numpy as np
import pytest

from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.regression import CellContext
from models.readouts.counted_on import counted_anew

# One hour of -1 A: half of a cell of 2 Ah.
RUN = to_grid(
    TimeSeries(np.arange(3601.0), np.full(3601, -1.0), np.full(3601, 3.5), np.full(3601, 25.0), name="one"), 1.0
)
CELL = CellContext(2.0)


def test_only_what_begins_where_a_run_has_ended_is_counted_anew() -> None:
    (end,) = counted_anew([0.4], [RUN], ([0.9], [0.9]), (CELL, CellContext(1.0)))
    assert end == pytest.approx(-0.1, abs=1e-3)
    assert counted_anew([0.41, 0.9], [RUN], ([0.9], [0.9]), (CELL, CellContext(1.0))) == [0.41, 0.9]


def test_a_start_that_was_wrong_moves_what_follows_as_well() -> None:
    assert counted_anew([0.4], [RUN], ([0.9], [0.85]), (CELL, CELL)) == pytest.approx([0.35], abs=1e-3)
