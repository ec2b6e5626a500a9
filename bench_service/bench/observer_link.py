"""The live observer as the run loop sees it. Its state of charge is shown and stored; no limit uses it."""

import math
from typing import NamedTuple, Protocol


class ObserverError(Exception):
    """The observer cannot be built, has raised, or has diverged."""


class ObserverRow(NamedTuple):
    """One row of the stream ``observer`` without its time."""

    soc: float
    soc_std: float
    model_voltage_V: float
    innovation_V: float


NO_ESTIMATE = ObserverRow(math.nan, math.nan, math.nan, math.nan)


class ObserverLink(Protocol):
    """Steps once per recorded sample."""

    def step(
        self, current_A: float, voltage_V: float, temperature_degC: float, ambient_degC: float = math.nan
    ) -> ObserverRow:
        """Return the estimate after one sample.

        Raises
        ------
        ObserverError
            It has raised or diverged; it is not to be used any more.
        """
        ...

    def new_alarms(self) -> list[str]:
        """Return what is wrong since the last sample and was not before, in words."""
        ...
