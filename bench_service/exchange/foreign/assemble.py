"""Raw columns of a block to SI columns: units, times, the sign that a state column gives."""

from __future__ import annotations

from collections.abc import Mapping as Dictionary
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.arrow_numbers import floats
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.guess import QuestionError, state_of
from bench_service.exchange.foreign.mapping import Mapping, quantity_of
from bench_service.exchange.foreign.spool import Columns
from bench_service.exchange.foreign.times import DateOrder, TimeTextError, clock_s, durations_s, excel_s
from bench_service.exchange.foreign.units import CLOCK, DURATION, EXCEL, named_unit

if TYPE_CHECKING:
    import pyarrow as pa

# What loggers write where there is no value: the largest number of 32 bits, give or take its last digits.
_SENTINEL = 1e37
_TEXT_ROLES = ("state", "cell")
_MOST_CELLS = 256


@dataclass(frozen=True, slots=True)
class Wanted:
    """Positions of the columns that a mapping needs, those of numbers and those of text."""

    numbers: dict[str, int]
    texts: dict[str, int]

    @classmethod
    def of(cls, mapping: Mapping, names: tuple[str, ...], where: str) -> Wanted:
        """Find them; raises QuestionError where the table has no such column."""
        numbers: dict[str, int] = {}
        texts: dict[str, int] = {}
        for role, column in mapping.columns.items():
            if column.name not in names:
                there = ", ".join(map(repr, names[:20]))
                raise QuestionError(
                    f"{where}: there is no column {column.name!r} for {role}; name one with --column {role}=NAME, or "
                    f"--column {role}= where the file has none; it has {there}",
                    role,
                )
            textual = role in _TEXT_ROLES or column.unit in (DURATION, CLOCK)
            (texts if textual else numbers)[role] = names.index(column.name)
        return cls(numbers, texts)


@dataclass(slots=True)
class Cells:
    """How many rows each cell of the file has, where a column names one; none where the column counts rows."""

    rows: dict[str, int]
    counter: bool = False

    def add(self, values: NDArray[np.str_]) -> None:
        """Count another block."""
        if self.counter:
            return
        for value, n in zip(*np.unique(values, return_counts=True), strict=True):
            self.rows[str(value)] = self.rows.get(str(value), 0) + int(n)
        self.counter = len(self.rows) > _MOST_CELLS

    def several(self) -> list[str]:
        """Names of the cells where there are several."""
        total = sum(self.rows.values())
        if self.counter or len(self.rows) < 2 or len(self.rows) > 0.5 * total:
            return []
        return sorted(self.rows)


def assemble(
    block: Dictionary[int, pa.Array], wanted: Wanted, mapping: Mapping, where: str, first_row: int
) -> tuple[Columns, NDArray[np.str_] | None]:
    """Make SI columns of a block.

    Parameters
    ----------
    block : position -> column as read
    wanted, mapping : which column holds what
    where : name of the file for messages
    first_row : line of the block's first row

    Returns
    -------
    tuple
        Role -> (m,) in SI units, with "state" as +1 charge, -1 discharge, 0 rest; and the cells' names, or None.
    """
    columns: Columns = {}
    for role, position in wanted.numbers.items():
        values = _numbers(block[position])
        unit = mapping.columns[role].unit
        columns[role] = excel_s(values) if unit == EXCEL else _scaled(values, unit) if quantity_of(role) else values
    for role, position in wanted.texts.items():
        if role == "cell":
            continue
        if role == "state":
            columns["state"] = _states(block[position], mapping)
            continue
        try:
            columns[role] = _times(block[position], mapping, role)
        except TimeTextError as error:
            raise RunFileError(
                f"{where}: column {mapping.columns[role].name!r} holds {str(error)[:40]!r}, which is no "
                f"{mapping.columns[role].unit} as in the rows before{_date_hint(mapping, role)}"
            ) from error
    _signed(columns)
    return columns, _text(block[wanted.texts["cell"]]) if "cell" in wanted.texts else None


def _date_hint(mapping: Mapping, role: str) -> str:
    if mapping.columns[role].unit != CLOCK:
        return ""
    return f" (dates are read {mapping.date_order}; change that with --date-order)"


def _numbers(array: pa.Array) -> NDArray[np.float64]:
    values = floats(array)
    values[np.abs(values) >= _SENTINEL] = np.nan
    return values


def _scaled(values: NDArray[np.float64], unit: str | None) -> NDArray[np.float64]:
    if unit is None:
        return values
    known = named_unit(unit)
    if known.scale == 1.0 and known.offset == 0.0:
        return values
    if known.scale in (1e-3, 1e-6, 1e-9):  # a division rounds once: 2181 mA is 2.181 A to the bit
        return values / round(1.0 / known.scale)
    return values * known.scale + known.offset


def _times(array: pa.Array, mapping: Mapping, role: str) -> NDArray[np.float64]:
    if mapping.columns[role].unit == DURATION:
        return durations_s(array)
    order: DateOrder = "month-first" if mapping.date_order == "month-first" else "day-first"
    return clock_s(array, order)


def _text(array: pa.Array) -> NDArray[np.str_]:
    import pyarrow.compute as pc

    trimmed = pc.utf8_trim_whitespace(pc.fill_null(array, ""))  # pyright: ignore[reportAttributeAccessIssue]
    return np.asarray(trimmed.to_numpy(zero_copy_only=False), dtype=np.str_)


def _states(array: pa.Array, mapping: Mapping) -> NDArray[np.float64]:
    signs = {"charge": 1.0, "discharge": -1.0, "rest": 0.0}
    known = {word: signs[state] for state, words in mapping.states.items() for word in words}
    words, inverse = np.unique(_text(array), return_inverse=True)
    return np.array([known.get(str(word), signs[state_of(str(word))]) for word in words])[inverse]


def _signed(columns: Columns) -> None:
    """One current of two that are written apart, each without a sign."""
    if "charge_current_A" in columns or "discharge_current_A" in columns:
        charge = columns.pop("charge_current_A", None)
        discharge = columns.pop("discharge_current_A", None)
        signed = [(part, sign) for part, sign in ((charge, 1.0), (discharge, -1.0)) if part is not None]
        parts = [np.nan_to_num(np.abs(part)) * sign for part, sign in signed]
        unknown = [np.isnan(part) for part, _ in signed]
        columns["current_A"] = np.where(np.all(unknown, axis=0), np.nan, np.sum(parts, axis=0))
