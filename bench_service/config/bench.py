"""One bench: a cycler channel with a cell on it, and its limits."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from bench_service.config.cell_type import CellTypeConfig, read_cell_type
from bench_service.config.chamber import ChamberConfig
from bench_service.config.simulate import SIMULATED_CELLS, SimulateConfig, cells_of_module
from bench_service.config.table import NotNegative, Positive, Table, Window
from drivers.address import parse_address
from drivers.errors import CyclerConnectionError

LONGEST_DEVICE_WATCHDOG_S = 2.0
_STATED_FOR_HARDWARE = ("voltage_V", "current_A", "temperature_degC")


class LimitsConfig(Table):
    """Limits that no run on the bench may leave; a run may only narrow them.

    Units are in the names; windows are ``(low, high)``.
    """

    voltage_V: Window = (2.5, 4.2)
    current_A: Window = (-10.0, 5.0)
    temperature_degC: Window = (-20.0, 60.0)
    soc: Window = (0.0, 1.0)
    ramp_A_per_s: Positive | None = None
    duration_s: Positive = 14 * 86400.0

    @field_validator("soc")
    @classmethod
    def _within_zero_and_one(cls, soc: tuple[float, float]) -> tuple[float, float]:
        if soc[0] < 0 or soc[1] > 1:
            raise ValueError("state of charge is a fraction between 0 and 1")
        return soc


class BenchConfig(Table):
    """One bench: a cycler channel with a cell on it.

    Exactly one of ``url`` (see `drivers.address`) and ``simulate`` is given. ``cell_type`` names the file of a cell
    type, from the folder of the configuration. The defaults of capacity and limits are those of the cell type, else of
    the simulated cell; for another cell they must be stated.
    """

    url: str | None = None
    simulate: SimulateConfig | None = None
    map: str = "generic"
    cell_type: CellTypeConfig | None = None
    capacity_Ah: Positive = 2.5
    limits: LimitsConfig = LimitsConfig()
    watchdog_s: Positive = 1.0
    external_interlock: bool = Field(default=False, strict=True)
    timeout_s: Positive = 0.5
    settle_s: NotNegative = 1.0
    chamber: ChamberConfig | None = None
    # Of the observers that run live; absent: as the model has it.
    observer_gain: Literal["kalman", "steady"] | None = None

    @model_validator(mode="before")
    @classmethod
    def _filled_in(cls, table: Any, info: ValidationInfo) -> Any:
        """Fill in what nobody has stated; values of a wrong type are left for the fields to refuse."""
        return _as_simulated(_of_cell_type(table, Path((info.context or {}).get("folder", "."))))

    @model_validator(mode="after")
    def _within_cell(self) -> Self:
        if self.cell_type is not None:
            limits = {name: getattr(self.limits, name) for name in _STATED_FOR_HARDWARE}
            if (refused := self.cell_type.refuses(self.capacity_Ah, limits)) is not None:
                raise ValueError(refused)
        return self

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.url is None) == (self.simulate is None):
            raise ValueError("give exactly one of 'url' (a cycler) and 'simulate' (a simulator)")
        return self

    @model_validator(mode="after")
    def _stated(self) -> Self:
        if self.url is not None:
            missing = [f"limits.{name}" for name in _STATED_FOR_HARDWARE if name not in self.limits.model_fields_set]
            if "capacity_Ah" not in self.model_fields_set:
                missing.append("capacity_Ah")
            if missing:
                raise ValueError(f"a real cell has no default {', '.join(missing)}; state what its data sheet allows")
        return self

    @model_validator(mode="after")
    def _watched(self) -> Self:
        if self.watchdog_s > LONGEST_DEVICE_WATCHDOG_S and not self.external_interlock:
            raise ValueError(
                f"watchdog_s is {self.watchdog_s:g} s; above {LONGEST_DEVICE_WATCHDOG_S:g} s the bench needs "
                "'external_interlock = true', a declaration that hardware of its own cuts the cell off"
            )
        return self

    @model_validator(mode="after")
    def _chamber_fits(self) -> Self:
        simulate = self.simulate
        kind = {"simulated": simulate is not None, "lock_step": simulate is not None and simulate.lock_step}
        if self.chamber is not None:
            refused = self.chamber.refuses(self.limits.temperature_degC, **kind)
            if refused is not None:
                raise ValueError(refused)
        return self

    @property
    def chamber_degC(self) -> tuple[float, float] | None:
        """Window of the chamber's set points; None where there is no chamber."""
        return None if self.chamber is None else self.chamber.temperature_degC or self.limits.temperature_degC

    @field_validator("url")
    @classmethod
    def _known_transport(cls, url: str | None) -> str | None:
        if url is None:
            return None
        try:
            parse_address(url)
        except CyclerConnectionError as error:
            raise ValueError(str(error)) from error
        return url


def _of_cell_type(table: Any, folder: Path) -> Any:
    """Read the file that a bench names, and take from it what the bench does not state."""
    named = table.get("cell_type") if isinstance(table, dict) else None
    limits = table.get("limits", {}) if isinstance(table, dict) else None
    if not isinstance(named, str) or not isinstance(limits, dict):
        return table
    cell = read_cell_type(folder / named)
    return {"capacity_Ah": cell.capacity_Ah} | table | {"cell_type": cell, "limits": cell.limits | limits}


def _as_simulated(table: Any) -> Any:
    """Take what nobody has stated from the simulated cell."""
    simulate = table.get("simulate") if isinstance(table, dict) else None
    if isinstance(simulate, SimulateConfig):
        simulate = simulate.model_dump()
    limits = table.get("limits", {}) if isinstance(table, dict) else None
    if not isinstance(simulate, dict) or not isinstance(limits, dict):
        return table
    known = dict(SIMULATED_CELLS.get(str(simulate.get("cell", "nmc")), SIMULATED_CELLS["nmc"]))
    capacity_Ah = known.pop("capacity_Ah")
    if simulate.get("capacity_Ah") is not None:
        capacity_Ah = simulate["capacity_Ah"]
    series, parallel = cells_of_module(simulate.get("module"))
    known["voltage_V"] = tuple(series * limit_V for limit_V in known["voltage_V"])
    known["current_A"] = tuple(parallel * limit_A for limit_A in known["current_A"])
    return {"capacity_Ah": parallel * capacity_Ah} | table | {"limits": known | limits}
