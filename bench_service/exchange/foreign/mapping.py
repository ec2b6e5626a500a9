"""Which column of a file holds what: guessed, corrected by a person, remembered by name as a small JSON file."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.units import unit_names
from bench_service.streams import cell_number

SCHEMA = 1
FOLDER = "mappings"  # below the data directory
# What a column can hold, and the quantity of its unit.
ROLES: dict[str, str | None] = {
    "time_s": "time",
    "clock": "time",
    "voltage_V": "voltage",
    "current_A": "current",
    "charge_current_A": "current",
    "discharge_current_A": "current",
    "temperature_degC": "temperature",
    "ambient_degC": "temperature",
    "cycle_count": None,
    "step_count": None,
    "state": None,
    "cell": None,
    "soc_ref": None,
}
SIGNS = ("charge-positive", "discharge-positive")
_STATES = ("charge", "discharge", "rest")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


@dataclass(frozen=True, slots=True)
class Column:
    """Where one quantity comes from.

    Attributes
    ----------
    name : of the column, as in the file
    unit : one of `units.unit_names`, or None where the quantity has none
    why : what speaks for it, for a person
    """

    name: str
    unit: str | None = None
    why: str = ""


@dataclass(frozen=True, slots=True)
class Mapping:
    """Which column holds what.

    Attributes
    ----------
    name : what the laboratory calls it, or the cycler's map it came from
    title : for a person
    columns : role (`ROLES`) -> column
    current_sign : which sign charges in the file, settled by a person; None: the voltage is asked
    sign_convention : what the cycler's maker does, believed where the voltage does not tell
    states : "charge", "discharge", "rest" -> words of the state column (it gives the sign of a current without one)
    date_order : "day-first" or "month-first", for dates such as 03/04/2024; None: the dates are asked
    time_zone : name of the zone of the file's clock, as "Europe/Oslo"; None: not known
    """

    name: str
    title: str
    columns: dict[str, Column] = field(default_factory=dict)
    current_sign: str | None = None
    sign_convention: str | None = None
    states: dict[str, tuple[str, ...]] = field(default_factory=dict)
    date_order: str | None = None
    time_zone: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return what is stored and sent."""
        return {
            "schema": SCHEMA,
            "name": self.name,
            "title": self.title,
            "columns": {
                role: {"column": each.name, "unit": each.unit, "why": each.why} for role, each in self.columns.items()
            },
            "current_sign": self.current_sign,
            "sign_convention": self.sign_convention,
            "states": {state: list(words) for state, words in self.states.items()},
            "date_order": self.date_order,
            "time_zone": self.time_zone,
        }

    @classmethod
    def from_json(cls, document: Any, where: str) -> Mapping:
        """Check and build; raises RunFileError naming the offending part."""
        if not isinstance(document, dict):
            raise RunFileError(f"{where}: a mapping is a JSON object")
        known = set(cls("any", "").to_json())
        if unknown := sorted(set(document) - known):
            raise RunFileError(f"{where}: unknown key {unknown[0]!r}; a mapping has {', '.join(sorted(known))}")
        if document.get("schema") != SCHEMA:
            raise RunFileError(f"{where}: schema is {document.get('schema')!r}, this program reads {SCHEMA}")
        columns = document.get("columns")
        if not isinstance(columns, dict):
            raise RunFileError(f"{where}: columns must be an object of role -> {{column, unit}}")
        mapping = cls(
            name=check_name(str(document.get("name", "")), where),
            title=str(document.get("title", "")),
            columns={role: _column(role, each, where) for role, each in columns.items()},
            current_sign=document.get("current_sign"),
            sign_convention=document.get("sign_convention"),
            states=_states(document.get("states") or {}, where),
            date_order=document.get("date_order"),
            time_zone=document.get("time_zone"),
        )
        _check_choice(mapping.current_sign, SIGNS, "current_sign", where)
        _check_choice(mapping.sign_convention, SIGNS, "sign_convention", where)
        _check_choice(mapping.date_order, ("day-first", "month-first"), "date_order", where)
        check_zone(mapping.time_zone, where)
        return mapping

    def corrected(self, columns: dict[str, Column], **others: str | None) -> Mapping:
        """Return it with a person's choices in place of the guessed ones."""
        merged = dict(self.columns)
        for role, column in columns.items():
            if column.name == "":  # the role is not in the file
                merged.pop(role, None)
                continue
            merged[role] = column
            if role == "current_A":
                merged.pop("charge_current_A", None)
                merged.pop("discharge_current_A", None)
        if "charge_current_A" in columns and "discharge_current_A" in columns:
            merged.pop("current_A", None)
        return replace(self, columns=merged, **{name: value for name, value in others.items() if value is not None})


def check_name(name: str, where: str) -> str:
    """Return a mapping's name, which is a file's name too; raises RunFileError."""
    if not _NAME.fullmatch(name):
        raise RunFileError(f"{where}: mapping name {name!r}: use letters, digits, . _ and -, at most 64")
    return name


def check_zone(name: Any, where: str) -> None:
    """Refuse a time zone that the machine does not know."""
    # Lazy: rarely used.
    import zoneinfo

    if name is None:
        return
    try:
        if not isinstance(name, str):
            raise ValueError("no text")
        zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise RunFileError(f"{where}: time zone {name!r} is not known; write one such as Europe/Oslo or UTC") from error


def quantity_of(role: str) -> str | None:
    """Quantity of what a column can hold; of a module's cells there are as many roles as there are cells."""
    return "voltage" if cell_number(role) is not None else ROLES[role]


def check_column(role: str, column: Column, where: str) -> Column:
    """Return the column where role and unit can be; raises RunFileError."""
    if role not in ROLES and cell_number(role) is None:
        raise RunFileError(f"{where}: {role!r} is nothing a column is read as; choose from {', '.join(ROLES)}")
    quantity = quantity_of(role)
    allowed = unit_names(quantity) if quantity is not None else ()
    if column.unit is not None and column.unit not in allowed:
        units = f"one of {', '.join(allowed)}" if allowed else "none"
        raise RunFileError(f"{where}: unit {column.unit!r} of {role}: must be {units}")
    return column


def _column(role: str, each: Any, where: str) -> Column:
    if not isinstance(each, dict) or not isinstance(each.get("column"), str):
        raise RunFileError(f"{where}: columns.{role} must be an object with column and unit")
    if unknown := sorted(set(each) - {"column", "unit", "why"}):
        raise RunFileError(f"{where}: columns.{role}: unknown key {unknown[0]!r}")
    return check_column(role, Column(each["column"], each.get("unit"), str(each.get("why", ""))), where)


def _states(given: Any, where: str) -> dict[str, tuple[str, ...]]:
    if not isinstance(given, dict) or set(given) - set(_STATES):
        raise RunFileError(f"{where}: states must be an object with {', '.join(_STATES)}")
    for state, words in given.items():
        if not isinstance(words, list) or not all(isinstance(word, str) for word in words):
            raise RunFileError(f"{where}: states.{state} must be an array of the words that mean it")
    return {state: tuple(words) for state, words in given.items()}


def _check_choice(value: Any, choices: tuple[str, ...], key: str, where: str) -> None:
    if value is not None and value not in choices:
        raise RunFileError(f"{where}: {key} is {value!r}; must be one of {', '.join(choices)} or null")


def load_mapping(directory: Path, name: str) -> Mapping:
    """Read a remembered mapping; raises RunFileError naming those there are."""
    check_name(name, "--mapping")
    path = directory / f"{name}.json"
    try:
        document = json.loads(path.read_bytes())
    except FileNotFoundError as error:
        there = ", ".join(mapping_names(directory)) or "none yet; keep one with --save-mapping NAME"
        raise RunFileError(f"mapping {name!r} is not known; there is {there}") from error
    except (OSError, ValueError) as error:
        raise RunFileError(f"{path}: is not a readable mapping: {error}") from error
    return Mapping.from_json(document, str(path))


def save_mapping(directory: Path, mapping: Mapping) -> Path:
    """Remember a mapping by its name; an older one of that name is replaced."""
    # Lazy: below this room's door.
    from bench_service.exchange.atomic import write_atomically

    check_name(mapping.name, "mapping")
    directory.mkdir(parents=True, exist_ok=True)
    path = directory / f"{mapping.name}.json"
    write_atomically(path, (json.dumps(mapping.to_json(), indent=2, ensure_ascii=False) + "\n").encode())
    return path


def mapping_names(directory: Path) -> list[str]:
    """Names of the mappings that are remembered."""
    return sorted(path.stem for path in directory.glob("*.json")) if directory.is_dir() else []
