"""Times as text: durations ("1d 02:03:04.5", "26:03:04"), dates with a clock, Excel's day numbers; to seconds."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.arrow_numbers import floats

if TYPE_CHECKING:
    import pyarrow as pa

DateOrder = Literal["day-first", "month-first"]

_DURATION = (
    r"^\s*(?P<sign>-)?(?:(?P<d>\d+)(?:\s*[dD](?:ays?)?[ ,]*|\.| +))?(?P<h>\d+):(?P<m>\d{1,2})"
    r"(?::(?P<s>\d{1,2}(?:[.,:]\d+)?))?\s*$"
)
_CLOCK_PART = r"(?:[T\s,]+(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{1,2}(?:[.,]\d+)?))?\s*(?P<pm>[AaPp])?\.?[Mm]?\.?)?"
_ZONE = r"\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?\s*$"
_ISO = r"^\s*(?P<y>\d{4})[-/.](?P<mo>\d{1,2})[-/.](?P<d>\d{1,2})" + _CLOCK_PART + _ZONE
_TEXT_MONTH = r"^\s*(?P<d>\d{1,2})[-/. ](?P<mo>[A-Za-z]{3,9})[-/. ,]+(?P<y>\d{2,4})" + _CLOCK_PART + _ZONE
_NUMBERS = r"^\s*(?P<one>\d{1,2})[-/.](?P<two>\d{1,2})[-/.](?P<y>\d{2,4})" + _CLOCK_PART + _ZONE
_MONTHS = {
    name: k + 1
    for k, names in enumerate(
        "jan januar|feb februar|mar mrz maerz|apr april|may mai|jun juni|jul juli|aug august|sep sept september|"
        "oct okt october|nov november|dec dez december".split("|")
    )
    for name in names.split()
} | {"january": 1, "february": 2, "march": 3, "june": 6, "july": 7, "oktober": 10, "dezember": 12, "märz": 3}
# Day numbers of Excel for the years 1990 to 2099; day 0 is 1899-12-30, for its leap year of 1900 that was none.
EXCEL_DAYS = (32874.0, 73050.0)
_EXCEL_UNIX_DAYS = 25569.0


class TimeTextError(Exception):
    """A text that is no such time; the argument is the text."""


def kind_of_times(cells: Iterable[str]) -> str | None:
    """Tell ``number``, ``duration`` or ``clock`` from the first cells of a column; None where it is none of them."""
    kinds = set()
    for cell in cells:
        if not cell.strip():
            continue
        if re.fullmatch(r"\s*[+-]?(\d+([.,]\d*)?|[.,]\d+|\d{1,3}([,.' ]\d{3})+[.,]\d+)([eE][+-]?\d+)?\s*", cell):
            kinds.add("number")
        elif re.match(_DURATION.replace("(?P<sign>-)", "-"), cell):
            kinds.add("duration")
        elif any(re.match(pattern, cell) for pattern in (_ISO, _TEXT_MONTH, _NUMBERS)):
            kinds.add("clock")
        else:
            return None
    return kinds.pop() if len(kinds) == 1 else None


def date_order(cells: Iterable[str]) -> DateOrder | None:
    """Tell which number of a date such as 03/04/2024 is the day; None where the cells do not tell."""
    for cell in cells:
        if re.match(_ISO, cell) or re.match(_TEXT_MONTH, cell):
            return "day-first"
        match = re.match(_NUMBERS, cell)
        if match is None:
            continue
        if int(match["one"]) > 12 or re.match(r"\s*\d{1,2}\.", cell):  # with dots: as in German, Russian, Finnish
            return "day-first"
        if int(match["two"]) > 12:
            return "month-first"
    return None


def has_zone(cells: Iterable[str]) -> bool:
    """Whether dates name their offset from UTC."""
    patterns = (_ISO, _TEXT_MONTH, _NUMBERS)
    return any((match := re.match(each, cell)) is not None and match["zone"] for cell in cells for each in patterns)


def durations_s(array: pa.Array) -> NDArray[np.float64]:
    """(n,) seconds of durations as text; NaN where empty.

    Raises
    ------
    TimeTextError
        With the first text that is no duration.
    """
    found = _extract(array, _DURATION)
    seconds = _number(found, "d", 0.0) * 86400.0 + _number(found, "h") * 3600.0 + _number(found, "m") * 60.0
    seconds += _number(found, "s", 0.0)
    return np.where(_text(found, "sign") == "-", -seconds, seconds)


def clock_s(array: pa.Array, order: DateOrder) -> NDArray[np.float64]:
    """(n,) seconds since 1970-01-01 of dates with a clock as text, UTC where they name an offset; NaN where empty.

    Raises
    ------
    TimeTextError
        With the first text that is no date.
    """
    first = next((each for each in array.slice(0, 1000).to_pylist() if each and each.strip()), "")
    if re.match(_ISO, first):
        found = _extract(array, _ISO)
        year, month, day = _number(found, "y"), _number(found, "mo"), _number(found, "d")
    elif re.match(_TEXT_MONTH, first):
        found = _extract(array, _TEXT_MONTH)
        names = np.char.lower(_text(found, "mo"))
        month = np.array([_MONTHS.get(str(name), np.nan) for name in np.unique(names)])[
            np.unique(names, return_inverse=True)[1]
        ]
        year, day = _number(found, "y"), _number(found, "d")
    else:
        found = _extract(array, _NUMBERS)
        year = _number(found, "y")
        one, two = _number(found, "one"), _number(found, "two")
        day, month = (one, two) if order == "day-first" else (two, one)
    wrong = np.isfinite(year) & ~((month >= 1) & (month <= 12) & (day >= 1) & (day <= 31))
    if wrong.any():
        raise TimeTextError(str(array[int(np.argmax(wrong))]))
    year = np.where(year < 100, year + 2000, year)
    hour = _number(found, "h", 0.0)
    half = np.char.lower(_text(found, "pm"))
    hour = np.where(half == "p", np.where(hour < 12, hour + 12, hour), np.where((half == "a") & (hour == 12), 0, hour))
    seconds = _days(year, month, day) * 86400.0 + hour * 3600.0
    return seconds + _number(found, "m", 0.0) * 60.0 + _number(found, "s", 0.0) - _offset_s(found)


def excel_s(days: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) seconds since 1970-01-01 of Excel's day numbers, rounded to 0.1 ms: a double holds no more of them."""
    return np.round((days - _EXCEL_UNIX_DAYS) * 86400.0, 4)


def _extract(array: pa.Array, pattern: str) -> pa.StructArray:
    import pyarrow as pa
    import pyarrow.compute as pc

    missing = pc.or_kleene(pc.is_null(array), pc.equal(pc.utf8_trim_whitespace(array), ""))  # pyright: ignore[reportAttributeAccessIssue]
    found = pc.extract_regex(array, pattern=pattern)  # pyright: ignore[reportAttributeAccessIssue]
    if isinstance(found, pa.ChunkedArray):
        found = found.combine_chunks()
    bad = pc.and_(pc.is_null(found), pc.invert(missing))  # pyright: ignore[reportAttributeAccessIssue]
    if pc.any(bad).as_py():  # pyright: ignore[reportAttributeAccessIssue]
        raise TimeTextError(str(array[pc.index(bad, True).as_py()]))  # pyright: ignore[reportAttributeAccessIssue]
    return found


def _text(found: pa.StructArray, name: str) -> NDArray[np.str_]:
    import pyarrow.compute as pc

    part = pc.struct_field(found, name)  # pyright: ignore[reportAttributeAccessIssue]
    return np.asarray(pc.fill_null(part, "").to_numpy(zero_copy_only=False), dtype=np.str_)


def _number(found: pa.StructArray, name: str, empty: float = np.nan) -> NDArray[np.float64]:
    """Numbers of a part; NaN where the whole is missing, `empty` where the part is."""
    import pyarrow.compute as pc

    part = pc.struct_field(found, name)  # pyright: ignore[reportAttributeAccessIssue]
    part = pc.replace_substring_regex(part, pattern="[,:]", replacement=".")  # pyright: ignore[reportAttributeAccessIssue]
    part = pc.if_else(pc.equal(part, ""), str(empty), part)  # pyright: ignore[reportAttributeAccessIssue]
    values = floats(part)
    return np.where(np.asarray(found.is_null()), np.nan, values)


def _days(year: NDArray[np.float64], month: NDArray[np.float64], day: NDArray[np.float64]) -> NDArray[np.float64]:
    """Days from 1970-01-01 in the Gregorian calendar (H. Hinnant, days_from_civil)."""
    y = year - (month <= 2)
    era = np.floor(y / 400)
    of_era = y - era * 400
    of_year = np.floor((153 * (month + np.where(month > 2, -3, 9)) + 2) / 5) + day - 1
    return era * 146097 + of_era * 365 + np.floor(of_era / 4) - np.floor(of_era / 100) + of_year - 719468


def _offset_s(found: pa.StructArray) -> NDArray[np.float64]:
    zones = _text(found, "zone")
    unique, inverse = np.unique(zones, return_inverse=True)
    return np.array([_zone_s(str(zone)) for zone in unique])[inverse]


def _zone_s(zone: str) -> float:
    if zone in ("", "Z"):
        return 0.0
    digits = zone[1:].replace(":", "")
    return (-1.0 if zone[0] == "-" else 1.0) * (int(digits[:2]) * 3600.0 + int(digits[2:]) * 60.0)
