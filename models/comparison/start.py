"""Where a run begins: its state of charge, and what flowed before its first sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.history import PlacedRun, StartHistory, placed
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.cell_model import CellModel
from models.network.free_run import free_run_V

# What flowed before dies out. A start that later makes more than so many times what it made in the minute that it was
# found by, and more than so much, is none: slow states that cancel there (tens of mV there and volts later, in measured
# drive cycles at -10 degC).
_GROWN, _GROWN_V = 5.0, 0.1


@dataclass(frozen=True)
class Start:
    """Where a run begins.

    Attributes
    ----------
    initial_soc : fraction at its first sample
    soc_std : its standard deviation; None: nobody said, and nothing was estimated
    history : what flowed before; None: the run begins at rest
    """

    initial_soc: float
    soc_std: float | None = None
    history: StartHistory | None = None

    def to_json(self) -> dict[str, float | None]:
        """Return the `initial_soc` object of the public contract."""
        return {"value": self.initial_soc, "std": self.soc_std}


def put_in_front(model: CellModel, run: GridRun, start: Start) -> PlacedRun:
    """The run with its history in front, or as it is where it has none."""
    if start.history is None:
        return PlacedRun(run, start.initial_soc, 0)
    return placed(
        run,
        start.initial_soc,
        start.history,
        capacity_Ah=model.cell.capacity_Ah,
        efficiency=model.cell.efficiency,
        soc_range=model.record.domain.get("soc", (0.0, 1.0)),
    )


def free_run_from_V(model: CellModel, run: GridRun, start: Start) -> FloatArray:
    """(n,) free run of a run from its start, in V; see `free_run_V`."""
    found = put_in_front(model, run, start)
    return free_run_V(model, found.run, found.initial_soc)[found.n_before :]


def simulates(model: CellModel, run: GridRun, start: Start) -> bool:
    """Whether there is a voltage wherever one was measured; a missing temperature may leave none."""
    return bool(np.isfinite(free_run_from_V(model, run, start)[run.measured]).all())


def dies_out(model: CellModel, run: GridRun, starts: tuple[Start, Start], found_by_s: float) -> bool:
    """Whether what a start does to the voltage is never much more than at first.

    Parameters
    ----------
    model : simulates the run
    run : on its grid
    starts : as stated, and as found
    found_by_s : time from the first sample that the latter was found by
    """
    if starts[1].history is None:
        return True
    stated_V, found_V = (free_run_from_V(model, run, each) for each in starts)
    moved_V = np.abs(found_V - stated_V)
    first_V = float(np.nanmax(moved_V[: 1 + int(found_by_s / run.dt_s)]))
    return bool(np.nanmax(moved_V) <= max(_GROWN * first_V, _GROWN_V))
