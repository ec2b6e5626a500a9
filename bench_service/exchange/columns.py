"""Names of columns: Battery Data Format labels, their machine names, and this project's own.

Labels after the Battery Data Format ontology 1.3.0 and the package `batterydf` 0.1.0.
"""

from __future__ import annotations

from collections.abc import Iterable

from bench_service.exchange.errors import RunFileError
from bench_service.streams import cell_number

# own name -> (BDF label, BDF machine names)
BDF_NAMES: dict[str, tuple[str, tuple[str, ...]]] = {
    "time_s": ("Test Time / s", ("test_time_second",)),
    "current_A": ("Current / A", ("current_ampere",)),
    "voltage_V": ("Voltage / V", ("voltage_volt",)),
    "temperature_degC": ("Surface Temperature / degC", ("surface_temperature_celsius",)),
    "ambient_degC": ("Ambient Temperature / degC", ("ambient_temperature_celsius",)),
}
# The first of several sensors, as batterydf 0.1.0 and its examples name it: read where no cell temperature is.
SURFACE_1_3, FIRST_SENSOR_0_1 = BDF_NAMES["temperature_degC"][0], "Surface Temperature T1 / degC"
_FIRST_SENSOR = (
    FIRST_SENSOR_0_1,
    "surface_temperature_t1_celsius",
    "Temperature T1 / degC",
    "temperature_t1_celsius",
)
COUNT_NAMES = {"cycle_count": "Cycle Count / 1", "step_count": "Step Count / 1"}
UNIX_TIME_LABEL = "Unix Time / s"
OWN_NAMES = (*BDF_NAMES, "soc_ref")
REQUIRED = ("time_s", "current_A", "voltage_V")

_MEANING = {name: own for own, (label, machine) in BDF_NAMES.items() for name in (own, label, *machine)} | {
    "soc_ref": "soc_ref"
}


def cell_columns(file: str, names: Iterable[str]) -> list[str]:
    """Return the columns that hold voltages of a module's cells, in their order.

    Raises
    ------
    RunFileError
        One between the first and the last is absent.
    """
    numbers = sorted(number for number in map(cell_number, names) if number is not None)
    for wanted, number in enumerate(numbers, start=1):
        if number != wanted:
            raise RunFileError(f"{file}: there is a column v_cell{number}_V but no v_cell{wanted}_V; name all of them")
    return [f"v_cell{number}_V" for number in numbers]


def choose_columns(file: str, names: Iterable[str]) -> dict[str, str]:
    """Say which column of a file holds what.

    Parameters
    ----------
    file : name for messages
    names : the file's column names

    Returns
    -------
    dict
        Own name -> the file's name.

    Raises
    ------
    RunFileError
        A needed column is absent, or two columns mean the same.
    """
    names = list(names)
    chosen: dict[str, str] = {}
    for name in names:
        own = name if cell_number(name) is not None else _MEANING.get(name)
        if own is None:
            continue
        if own in chosen:
            raise RunFileError(f"{file}: columns {chosen[own]!r} and {name!r} both hold {own}; remove one")
        chosen[own] = name
    first_sensor = next((name for name in _FIRST_SENSOR if name in names), None)
    if first_sensor is not None:
        chosen.setdefault("temperature_degC", first_sensor)
    missing = [own for own in REQUIRED if own not in chosen]
    if "temperature_degC" not in chosen and "ambient_degC" not in chosen:
        missing.append("temperature_degC")
    if missing:
        wanted = ", ".join(f"{own} (or {BDF_NAMES[own][0]!r})" for own in missing)
        there = ", ".join(repr(name) for name in names[:12]) + (", ..." if len(names) > 12 else "")
        hint = "; an empty temperature column will do" if missing == ["temperature_degC"] else ""
        hint += " (a fit then uses --structure auto or minimal, which do without)" if hint else ""
        raise RunFileError(
            f"{file}: wrong columns: needs {wanted}{hint}; the file has {there}; "
            "what a cycler's program wrote becomes a run by 'bench-service import'"
        )
    return chosen


def unique_names(names: Iterable[str]) -> tuple[str, ...]:
    """Give each column a name of its own: "column 3" where the file names none, "x (2)" where it names two x."""
    seen: dict[str, int] = {}
    unique = []
    for k, name in enumerate(names):
        name = name or f"column {k + 1}"
        seen[name] = seen.get(name, 0) + 1
        unique.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return tuple(unique)
