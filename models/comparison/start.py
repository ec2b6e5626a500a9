"""Where a run begins: its state of charge, and what flowed before its first sample."""

from __future__ import annotations

from dataclasses import dataclass

from models.data.history import PlacedRun, StartHistory, placed
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.cell_model import CellModel
from models.network.free_run import free_run_V


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
