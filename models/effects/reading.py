"""What sensors say and what a fit is told, and how an effect in either is put right."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

Values = dict[str, float]


class Reading(NamedTuple):
    """What sensors say: one sample or arrays of them, NaN where missing."""

    current_A: Any
    voltage_V: Any
    temperature_degC: Any
    ambient_degC: Any


def _anything(_values: Values) -> bool:
    return True


@dataclass(frozen=True)
class InputCorrection:
    """How an effect in the sensors is put right; every parameter of the effect is needed for it.

    Attributes
    ----------
    sample : (reading, values) -> reading without the effect, from the same sample alone; None: nothing to do there
    delay_s : values -> time by which the voltage comes after the other columns; None: at the same time
    needs_ambient : it cannot be done without the ambient temperature
    possible : values -> whether there is such a correction at all
    """

    sample: Callable[[Reading, Values], Reading] | None = None
    delay_s: Callable[[Values], float] | None = None
    needs_ambient: bool = False
    possible: Callable[[Values], bool] = _anything


@dataclass(frozen=True)
class Assumption:
    """How an effect in what a fit is told of cell and runs is put right.

    Attributes
    ----------
    capacity_Ah : values -> capacity that charge is counted on; None: as before
    soc_moved : (values, SoC at which the first run was thought to start) -> by how much more every run starts at; None:
        as before
    """

    capacity_Ah: Callable[[Values], float] | None = None
    soc_moved: Callable[[Values, float], float] | None = None
