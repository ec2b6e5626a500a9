"""A module's run as it was measured: the whole of it, and where there are sense leads the groups in series too."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray, TimeSeries

# A sense lead that gives fewer samples of a run than this is broken.
LEAST_SAMPLES = 20


@dataclass(frozen=True)
class ModuleLog:
    """One run of a module.

    Attributes
    ----------
    run : current and voltage of the whole module
    groups_V : (n, series) voltage of each group of parallel cells, NaN where missing; None where none was measured
    """

    run: TimeSeries
    groups_V: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check the shape."""
        if self.groups_V is not None and (self.groups_V.ndim != 2 or len(self.groups_V) != len(self.run)):
            raise ModelError(
                f"{self.run.name}: voltages of cells have shape {self.groups_V.shape}; the run has {len(self.run)} "
                "samples; give one row for each"
            )

    @property
    def sensed(self) -> np.ndarray:
        """(series,) True where a group's voltage was measured in this run; none where no group's was."""
        if self.groups_V is None:
            return np.zeros(0, dtype=bool)
        return np.isfinite(self.groups_V).sum(axis=0) >= min(LEAST_SAMPLES, len(self.run))

    def mean_cell(self, in_series: int, parallel: int) -> TimeSeries:
        """Return the run as the mean cell sees it: of the groups' own voltages where all are there, else of the whole.

        A lead that is broken in all of the run makes it one of the whole: no sample has all groups' voltages.
        What is between the groups, contacts and cables, is not in the groups' voltages.
        """
        voltage_V = self.run.voltage_V / in_series
        if self.groups_V is not None and self.sensed.all():
            voltage_V = np.mean(self.groups_V, axis=1)
        return replace(self.run, current_A=self.run.current_A / parallel, voltage_V=voltage_V)

    def of_group(self, number: int, parallel: int) -> TimeSeries:
        """Return the run as one cell of a group sees it; groups count from 0."""
        if self.groups_V is None:
            raise ModelError(f"{self.run.name}: no voltage of single groups was measured")
        voltage_V = self.groups_V[:, number]
        return replace(self.run, current_A=self.run.current_A / parallel, voltage_V=voltage_V)


def series_of(logs: list[ModuleLog], stated: int | None = None) -> int:
    """Return how many groups are in series: as stated, else as many as have a voltage.

    Raises
    ------
    ModelError
        Nobody says, or runs and statement contradict each other.
    """
    known = {log.groups_V.shape[1]: log.run.name for log in logs if log.groups_V is not None}
    if len(known) > 1 or (stated is not None and set(known) - {stated}):
        told = ", ".join(f"{name} has voltages of {n} cells" for n, name in known.items())
        layout = "" if stated is None else f", the layout says {stated} in series"
        raise ModelError(f"the module's layout is unclear: {told}{layout}")
    if stated is None and not known:
        raise ModelError("how many cells are in series is not known: state the layout, such as 6x2")
    return stated if stated is not None else next(iter(known))
