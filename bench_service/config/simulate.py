"""A simulated bench: which cell and cycler are started in place of hardware, and what such a cell allows."""

from __future__ import annotations

import re
from typing import Any, Literal

from pydantic import Field

from bench_service.config.table import Fraction, Number, Positive, Table

_MODULE = r"^([1-9][0-9]?)x([1-9][0-9]?)$"


class SimulateConfig(Table):
    """A simulated cycler and cell, started by the service as a process of its own.

    ``speed`` counts simulated seconds per second and has a meaning only on the wall clock
    (``lock_step = false``). ``capacity_Ah`` replaces the true capacity of the simulated cell; ``baud`` is
    the pace of a simulated serial line, ``faults`` a script of what goes wrong when (docs/cyclers.md).
    ``module`` puts S cells in series and P in parallel, written SxP, in place of one; effects and ``capacity_Ah`` stay
    those of a cell. ``hidden_effect`` names one more effect, or "random", whose size the seed draws; both stay sealed
    until the bench's seal is opened.
    """

    protocol: Literal["modbus-tcp", "modbus-rtu", "can"] = "modbus-tcp"
    baud: int = Field(default=115200, ge=300, le=4_000_000, strict=True)
    cell: Literal["nmc", "lfp", "nimh"] = "nmc"
    effects: dict[str, Number] = {}
    hidden_effect: str | None = None
    module: str | None = Field(default=None, pattern=_MODULE)
    faults: str = ""
    seed: int = Field(default=1, ge=0, strict=True)
    lock_step: bool = Field(default=True, strict=True)
    speed: Positive = 1.0
    initial_soc: Fraction = 0.5
    ambient_degC: Number = 25.0
    capacity_Ah: Positive | None = None


# What the data sheets of the simulated cells allow; a test compares with the simulator's own catalogue.
_ROOM_degC = (-20.0, 60.0)
SIMULATED_CELLS: dict[str, dict[str, Any]] = {
    "nmc": {"capacity_Ah": 2.5, "voltage_V": (2.5, 4.2), "current_A": (-10.0, 5.0), "temperature_degC": _ROOM_degC},
    "lfp": {"capacity_Ah": 2.5, "voltage_V": (2.0, 3.65), "current_A": (-25.0, 10.0), "temperature_degC": _ROOM_degC},
    "nimh": {"capacity_Ah": 2.0, "voltage_V": (0.9, 1.6), "current_A": (-6.0, 2.0), "temperature_degC": (-10.0, 50.0)},
}


def cells_of_module(module: object) -> tuple[int, int]:
    """Cells in series and in parallel of what stands under ``module``; one cell where that says nothing."""
    found = re.match(_MODULE, module) if isinstance(module, str) else None
    return (int(found[1]), int(found[2])) if found else (1, 1)
