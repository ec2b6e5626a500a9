"""What a kind of cell may and what it is like, from its data sheet: a file that benches name, part of a cell's record.

Single cells, with owner and history, are records of the store (`store.cells`); nothing here knows of them.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from bench_service.config.table import Positive, Table, Window

Text = Annotated[str, Field(min_length=1, max_length=200)]

_CAPACITY_SHARES = (0.5, 1.1)  # of the nominal capacity: an old cell, and a generous one


class CellTypeConfig(Table):
    """One kind of cell, or of cells in series that count as one.

    ``charge_A`` and ``discharge_A`` are the largest continuous currents, both positive; ``resistance_Ohm`` is the band
    in which its resistance lies over temperature, state of charge and age, within some 100 ms of a step; None: unknown.
    """

    maker: Text
    model: Text
    chemistry: Text
    capacity_Ah: Positive
    voltage_V: Window
    charge_A: Positive
    discharge_A: Positive
    temperature_degC: Window
    resistance_Ohm: Window | None = None
    source: Text

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.voltage_V[0] < 0.0:
            raise ValueError(f"voltage_V begins at {self.voltage_V[0]:g} V; a cell must not be reversed")
        if self.resistance_Ohm is not None and self.resistance_Ohm[0] <= 0.0:
            raise ValueError(f"resistance_Ohm begins at {self.resistance_Ohm[0]:g} Ohm; it must be above 0")
        return self

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Limits by the names that a bench has for them."""
        current_A = (-self.discharge_A, self.charge_A)
        return {"voltage_V": self.voltage_V, "current_A": current_A, "temperature_degC": self.temperature_degC}

    @property
    def title(self) -> str:
        """Maker and model."""
        return f"{self.maker} {self.model}"

    def refuses(self, capacity_Ah: float, limits: dict[str, tuple[float, float]]) -> str | None:
        """Say what of a bench such a cell does not allow; None where all is well."""
        name = self.title
        for key, (least, most) in self.limits.items():
            low, high = limits[key]
            if low < least or high > most:
                unit = key.rsplit("_", 1)[1]
                return (
                    f"limits.{key} {low:g} to {high:g} {unit} leave what the cell type {name} allows, {least:g} to "
                    f"{most:g} {unit} ({self.source}); narrow them"
                )
        least, most = (share * self.capacity_Ah for share in _CAPACITY_SHARES)
        if not least <= capacity_Ah <= most:
            return (
                f"capacity_Ah {capacity_Ah:g} Ah is not that of the cell type {name}, {self.capacity_Ah:g} Ah nominal "
                f"(allowed {least:g} to {most:g} Ah); correct one of them"
            )
        return None


def read_cell_type(path: Path) -> CellTypeConfig:
    """Read and check a cell-type file.

    Raises
    ------
    ValueError
        It is not there, not TOML, or not a cell type; the message names file, key and reason.
    """
    try:
        return CellTypeConfig.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file; a cell type is a TOML file, see docs/commissioning.md") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: not valid TOML: {error}") from error
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        reason = "unknown key" if first["type"] == "extra_forbidden" else first["msg"].removeprefix("Value error, ")
        raise ValueError(f"{path}: {f'{key}: ' if key else ''}{reason}") from error
