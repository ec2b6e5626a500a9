"""Units as they stand in the names of columns: "Voltage(V)", "I/mA", "U[V]", "Test Time / s", "Strom in A"."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

ZERO_CELSIUS_K = 273.15


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: a value in it times `scale` plus `offset` is the value in the quantity's own unit (s, A, V, degC, Ah)."""

    name: str
    quantity: str
    scale: float = 1.0
    offset: float = 0.0


# Kinds of time that are not a number with a unit.
DURATION, CLOCK, EXCEL = "duration", "clock", "excel"

_SPELLINGS: tuple[tuple[Unit, str], ...] = (
    (Unit("s", "time"), "s sec secs second seconds sek sekunden"),
    (Unit("ms", "time", 1e-3), "ms msec millisecond milliseconds"),
    (Unit("min", "time", 60.0), "min mins minute minutes minuten"),
    (Unit("h", "time", 3600.0), "h hr hrs hour hours std stunden"),
    (Unit("d", "time", 86400.0), "d day days tage"),
    (Unit(DURATION, "time"), "hh:mm:ss h:mm:ss hh:mm:ss.sss h:mm:ss.sss hh:mm:ss.s hh:mm:ss,sss d.hh:mm:ss"),
    (Unit("A", "current"), "a amp amps ampere amperes"),
    (Unit("mA", "current", 1e-3), "ma milliamp milliamps milliampere"),
    (Unit("uA", "current", 1e-6), "ua microamp microampere"),
    (Unit("nA", "current", 1e-9), "na"),
    (Unit("kA", "current", 1e3), "ka"),
    (Unit("V", "voltage"), "v volt volts"),
    (Unit("mV", "voltage", 1e-3), "mv millivolt millivolts"),
    (Unit("uV", "voltage", 1e-6), "uv"),
    (Unit("kV", "voltage", 1e3), "kv"),
    (Unit("degC", "temperature"), "c degc celsius grad"),
    (Unit("K", "temperature", 1.0, -ZERO_CELSIUS_K), "k kelvin"),
    (Unit("degF", "temperature", 5.0 / 9.0, -160.0 / 9.0), "f degf fahrenheit"),
    (Unit("Ah", "charge"), "ah amp-hr a.h a·h ampere-hour"),
    (Unit("mAh", "charge", 1e-3), "mah ma.h ma·h"),
)
_OTHER = frozenset("wh mwh w.h kwh w mw ohm mohm psi % uf mah/g v/s a/h v/h".split())
_NO_UNIT = ("1", "#", "-")
# "(V)" or "[V]" at the end; "/ V" or "/V"; ", V"; "in V"; "_V"
_ENDS = (
    re.compile(r"^(?P<base>.*?)\s*[\(\[]\s*(?P<unit>[^()\[\]]+?)\s*[\)\]]\s*$"),
    re.compile(r"^(?P<base>.+?)\s*/\s*(?P<unit>[^/]+?)\s*$"),
    re.compile(r"^(?P<base>.+?)\s*,\s*(?P<unit>[^,]+?)\s*$"),
    re.compile(r"^(?P<base>.+?)\s+in\s+(?P<unit>\S+)\s*$"),
    re.compile(r"^(?P<base>.+?)_(?P<unit>[A-Za-z°µ.]+)$"),
)


@cache
def _known() -> dict[str, Unit]:
    return {spelling: unit for unit, spellings in _SPELLINGS for spelling in spellings.split()}


def find_unit(text: str) -> Unit | None:
    """Return the unit of a spelling, or None."""
    plain = text.strip().strip("[]()").strip().rstrip(".")
    # The degree sign as written by programs of any encoding, or as what a wrong one left of it.
    for sign in ("°", "º", "\ufffd", "?", "℃"):
        plain = plain.replace(sign, "deg" if sign != "℃" else "degC")
    plain = plain.replace("µ", "u").replace("μ", "u").replace(" ", "").lower()
    plain = plain.replace("degrees", "deg").replace("deg.", "deg")
    return _known().get(plain)


def named_unit(name: str) -> Unit:
    """Return the unit with one of our own names (``mA``, ``clock``); raises KeyError."""
    own = {unit.name: unit for unit, _ in _SPELLINGS} | {kind: Unit(kind, "time") for kind in (CLOCK, EXCEL)}
    return own[name]


def unit_names(quantity: str) -> tuple[str, ...]:
    """Our names of the units of a quantity, as `named_unit` takes them."""
    names = [unit.name for unit, _ in _SPELLINGS if unit.quantity == quantity]
    return (*names, CLOCK, EXCEL) if quantity == "time" else tuple(names)


def split_name(name: str) -> tuple[str, Unit | None, bool]:
    """Take a column's name apart.

    Returns
    -------
    tuple
        The name alone, normalised (lower case, one space between words); its unit, or None; and whether the name ends
        in a unit that is none of ours (a power, a resistance), so that the column is something else.
    """
    name = name.strip().strip("~#").strip()
    for pattern in _ENDS:
        match = pattern.match(name)
        if match is None:
            continue
        unit = find_unit(match["unit"])
        if unit is not None:
            return normalised(match["base"]), unit, False
        if match["unit"].strip() in _NO_UNIT:
            return normalised(match["base"]), None, False
        if match["unit"].strip().lower() in _OTHER and pattern is not _ENDS[4]:
            return normalised(match["base"]), None, True
    return normalised(name), None, False


def normalised(name: str) -> str:
    """Lower case letters and digits with one space between words: "Test_Time" and "test time" are one name."""
    return " ".join(re.findall(r"[^\W_]+", name.lower()))
