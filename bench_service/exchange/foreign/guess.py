"""Guess which column of a table holds what, and say why."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.cyclers import GENERIC, CyclerMap, cycler_maps
from bench_service.exchange.foreign.decimals import group_marks, grouped
from bench_service.exchange.foreign.mapping import ROLES, Column, Mapping, check_column, quantity_of
from bench_service.exchange.foreign.times import EXCEL_DAYS, date_order, kind_of_times
from bench_service.exchange.foreign.units import CLOCK, DURATION, EXCEL, Unit, find_unit, split_name
from bench_service.streams import cell_number

_DEFAULT_UNITS = {"time": "s", "voltage": "V", "current": "A", "temperature": "degC"}
# A cell in mV reads more than that, a module in V less.
_SURELY_MILLIVOLT = 1000.0
# A file whose rows are closer than that, in s, is in days: a cycler logs 10 kHz in bursts only.
_SURELY_DAYS = 2e-4
_UNIX_S, _UNIX_MS = 5e8, 5e11
_DISCHARGE = re.compile(r"dchg|dischar|d_?cha|entlad|décharg|descarg", re.IGNORECASE)
_CHARGE = re.compile(r"chg|char|lad|carg", re.IGNORECASE)


class Table(Protocol):
    """What a guess needs of a table: its columns' names, units in a row of their own, and its first rows as text."""

    @property
    def names(self) -> tuple[str, ...]:
        """Every column's name."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """Units from a row of their own, or fewer than there are columns."""
        ...

    @property
    def decimal(self) -> str:
        """Mark of the decimals."""
        ...

    @property
    def sample(self) -> tuple[tuple[str, ...], ...]:
        """First rows."""
        ...


class QuestionError(RunFileError):
    """Something only a person can settle: one line with the option that answers it.

    Parameters
    ----------
    message : the line
    asks : what is asked for: a role of a column ("current_A"), or an option ("current_sign", "cell", "date_order")
    """

    code = "needs_answer"

    def __init__(self, message: str, asks: str) -> None:
        super().__init__(message)
        self.asks = asks
        self.mapping: Mapping | None = None  # as far as it was guessed


def guess(table: Table, known: CyclerMap, where: str, settled: Sequence[str] = ()) -> Mapping:
    """Guess the mapping of a table.

    Parameters
    ----------
    table : the table
    known : the cycler's map, or the generic one
    where : name of the file for messages
    settled : roles that a person has answered, about which nothing is asked

    Raises
    ------
    QuestionError
        Two columns fit equally.
    """
    generic = cycler_maps()[GENERIC]
    columns: dict[str, Column] = {}
    for role in ROLES:
        if role in settled:
            continue
        of_map = f"as {known.title.split(',')[0]} writes it" if known is not generic else "by its name"
        found = _find(table, role, known.columns.get(role, ()), known, of_map, where)
        if found is None and known is not generic and role not in ("cell", "state"):
            found = _find(table, role, generic.columns.get(role, ()), known, "by its name", where)
        if found is not None and found.name not in {each.name for each in columns.values()}:
            columns[role] = found
    cells = [name for name in table.names if cell_number(name) is not None and name not in settled]
    columns |= {name: Column(name, "V", "by its name") for name in cells}
    _settle_clock(table, columns)
    states = known.states or _guess_states(table, columns)
    if not states:
        columns.pop("state", None)
    if "current_A" in columns:
        columns.pop("charge_current_A", None)
        columns.pop("discharge_current_A", None)
    dates = cells_of(table, columns["clock"].name) if "clock" in columns else ()
    return Mapping(
        name=known.name,
        title=known.title,
        columns=columns,
        sign_convention=known.sign_convention,
        states=states,
        date_order=date_order(dates) or known.date_order,
    )


def resolve(table: Table, role: str, column: Column, where: str) -> Column:
    """Fill in what a person left out of a choice: the unit, from the name or the cells.

    Raises
    ------
    QuestionError
        There is no such column, or its cells are not what the role needs.
    """
    check_column(role, column, where)
    if column.name not in table.names:
        there = ", ".join(map(repr, table.names[:20]))
        raise QuestionError(f"{where}: there is no column {column.name!r}; the file has {there}", role)
    if column.unit is not None or quantity_of(role) is None:
        return Column(column.name, column.unit, "chosen")
    _, unit, _ = _split(table, column.name)
    if unit is not None and unit.quantity != quantity_of(role):
        unit = None
    found = _column(table, role, column.name, unit, cycler_maps()[GENERIC], "chosen")
    if found is None:
        raise QuestionError(f"{where}: column {column.name!r} holds nothing that can be {role}", role)
    return found


def cells_of(table: Table, name: str) -> list[str]:
    """First cells of a column, empty ones left out."""
    k = table.names.index(name)
    return [cell for row in table.sample if k < len(row) and (cell := row[k].strip())]


def numbers_of(table: Table, name: str) -> np.ndarray:
    """(n,) first numbers of a column; what is none is left out."""
    values, groups = [], re.compile(grouped(table.decimal))
    for cell in cells_of(table, name):
        bare = re.sub(group_marks(table.decimal), "", cell) if groups.match(cell) else cell
        try:
            values.append(float(bare.replace(",", ".")))
        except ValueError:
            continue
    return np.array(values)


def _find(table: Table, role: str, wanted: Sequence[str], known: CyclerMap, why: str, where: str) -> Column | None:
    quantity = quantity_of(role)
    for name in wanted:
        fitting = []
        for title in table.names:
            base, unit, other = _split(table, title)
            if base == name and not other and (unit is None or unit.quantity == quantity):
                fitting.append((title, unit))
        if len(fitting) > 1 and role in ("voltage_V", "current_A", "time_s"):
            both = " and ".join(repr(title) for title, _ in fitting[:3])
            raise QuestionError(
                f"{where}: columns {both} may all hold {role}: say which with --column {role}=NAME", role
            )
        if fitting:
            title, unit = fitting[0]
            if (column := _column(table, role, title, unit, known, why)) is not None:
                return column
    return None


def _split(table: Table, title: str) -> tuple[str, Unit | None, bool]:
    """Take a column's name apart as `split_name` does; a unit that stands apart from the name counts too."""
    base, unit, other = split_name(_without_count(title, table))
    k = table.names.index(title)
    if unit is None and k < len(table.units):
        unit = find_unit(table.units[k])
    return base, unit, other


def _without_count(title: str, table: Table) -> str:
    """A name without the number that tells it from another column of the same name."""
    name, _, count = title.rpartition(" (")
    return name if count.rstrip(")").isdigit() and name in table.names else title


def _column(table: Table, role: str, title: str, unit: Unit | None, known: CyclerMap, why: str) -> Column | None:
    """The column with its unit, or None where its cells are not what the role needs."""
    quantity = quantity_of(role)
    if role in ("state", "cell"):
        return Column(title, None, why)
    cells = cells_of(table, title)
    if quantity == "time":
        return _time_column(table, role, title, unit, known, why)
    if cells and not len(numbers_of(table, title)):
        return None
    if quantity is None:
        return Column(title, None, why)
    if unit is not None:
        return Column(title, unit.name, f"{why}; unit {unit.name} from its name")
    if role in known.units:
        return Column(title, known.units[role], f"{why}; that is in {known.units[role]}")
    values = np.abs(numbers_of(table, title))
    if quantity == "voltage" and len(values) and np.median(values) > _SURELY_MILLIVOLT:
        return Column(title, "mV", f"{why}; no unit is named, {np.median(values):.4g} can only be mV")
    default = _DEFAULT_UNITS[quantity]
    return Column(title, default, f"{why}; no unit is named: taken as {default}")


def _time_column(table: Table, role: str, title: str, unit: Unit | None, known: CyclerMap, why: str) -> Column | None:
    kind = kind_of_times(cells_of(table, title)[:200])
    if kind == "duration":
        return Column(title, DURATION, f"{why}; written as hours:minutes:seconds")
    if kind == "clock":
        return Column(title, CLOCK, f"{why}; written as dates")
    if kind is None:
        return None
    values = numbers_of(table, title)
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    if (
        unit is None
        and EXCEL_DAYS[0] <= low
        and high <= EXCEL_DAYS[1]
        and high - low < 366
        and (role == "clock" or np.any(values % 1.0))
    ):
        return Column(title, EXCEL, f"{why}; day numbers of Excel ({low:.6g})")
    if role == "clock":
        unix = "ms" if low > _UNIX_MS else "s"
        return Column(title, unix, f"{why}; seconds since 1970") if low > _UNIX_S else None
    if unit is not None:
        return Column(title, unit.name, f"{why}; unit {unit.name} from its name")
    if role in known.units:
        return Column(title, known.units[role], f"{why}; that is in {known.units[role]}")
    steps = np.diff(values)
    if len(steps) > 3 and 0.0 < float(np.median(steps)) < _SURELY_DAYS:
        return Column(title, "d", f"{why}; no unit is named, rows {np.median(steps):.2g} apart can only be days")
    return Column(title, "s", f"{why}; no unit is named: taken as s")


def _settle_clock(table: Table, columns: dict[str, Column]) -> None:
    """A column of dates that is called time is the clock, not the test time."""
    time = columns.get("time_s")
    if time is None or time.unit not in (CLOCK, EXCEL):
        return
    del columns["time_s"]
    columns["clock"] = time


def _guess_states(table: Table, columns: dict[str, Column]) -> dict[str, tuple[str, ...]]:
    """Words of a state column that mean charge and discharge; none where none does."""
    if "state" not in columns:
        return {}
    states: dict[str, set[str]] = {"charge": set(), "discharge": set(), "rest": set()}
    for word in set(cells_of(table, columns["state"].name)):
        states[state_of(word)].add(word)
    if not states["charge"] and not states["discharge"]:
        return {}
    # What the first rows do not show is told by the same rule when it comes.
    return {state: tuple(sorted(words)) for state, words in states.items()}


def state_of(word: str) -> str:
    """Tell charge, discharge and rest from a word such as "CC_DChg", "D", "Laden"."""
    plain = word.strip()
    if plain.upper() == "D" or _DISCHARGE.search(plain):
        return "discharge"
    if plain.upper() == "C" or _CHARGE.search(plain):
        return "charge"
    return "rest"
