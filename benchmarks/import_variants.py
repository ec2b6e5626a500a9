"""One record written in many ways, right and mutilated: what a reader of cyclers' files must make of each.

`TABLE_VARIANTS` can be made of any table of text, so of a real cycler's file too; `RECORD_VARIANTS` write a record of
our own with other columns. Each says what must come of it: the record (`right`), its first rows (`part`), one clear
question about something (`asks`), or one clear line of refusal (`refused`).
"""

from __future__ import annotations

import gzip
import random
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.foreign.mapping import Column

_PLAIN = "Test Time (s)|Current (A)|Voltage (V)|Temperature (°C)|Cycle|Step"
Arrays = dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Table:
    """A table of text; `signed` are the positions of time, current and voltage."""

    names: list[str]
    rows: list[list[str]]
    time: int = 0
    current: int = 1
    voltage: int = 2
    above: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Variant:
    """How a table is written, what must come of it, and what a person chooses."""

    write: Callable[[Table], bytes]
    expect: str = "right"
    asks: str = ""
    choices: dict[str, Any] = field(default_factory=dict)
    remark: str = ""


def record(n: int = 400) -> Arrays:
    """Rest, charge, held voltage, rest, discharge and pulses of a 3 Ah cell of 30 mOhm, one row each 10 s."""
    k = np.arange(n)
    time_s = 10.0 * k.astype(np.float64)
    current_A = np.zeros(n)
    current_A[20:140] = 2.0
    current_A[140:200] = 2.0 * np.exp(-(k[140:200] - 140) / 20.0)
    current_A[220:300] = -1.5
    current_A[320:] = np.where((k[320:] // 8) % 2 == 0, 1.0, -1.0)
    charge_Ah = np.cumsum(current_A) * 10.0 / 3600.0
    voltage_V = 3.6 + 0.25 * charge_Ah + 0.03 * current_A + 0.0002 * np.sin(7.0 * k)
    voltage_V[140:200] = voltage_V[139] + 0.0001 * np.sin(3.0 * k[140:200])
    step = np.cumsum(np.isin(k, (20, 140, 200, 220, 300, 320))) + 1.0
    columns = {
        "time_s": time_s,
        "current_A": np.round(current_A, 4),
        "voltage_V": np.round(voltage_V, 4),
        "temperature_degC": np.round(25.0 + np.abs(current_A), 2),
        "cycle_count": np.ones(n),
        "step_count": step,
    }
    return {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}


def table_of(
    arrays: Arrays,
    names: str = _PLAIN,
    columns: dict[str, list[str]] | None = None,
) -> Table:
    """Write a record as a table; `columns` replaces what stands in some of them."""
    cells = {name: [f"{value:.10g}" for value in values] for name, values in arrays.items()} | (columns or {})
    return Table(names.split("|"), [list(row) for row in zip(*cells.values(), strict=True)])


def joined(table: Table, separator: str = ",", end: str = "\n") -> str:
    """Text of a table."""
    lines = [*table.above, separator.join(table.names), *(separator.join(row) for row in table.rows)]
    return end.join(lines) + end


def commas(table: Table, quoted: bool = False) -> Table:
    """The table with decimal commas."""
    mark = '"' if quoted else ""
    rows = [
        [f"{mark}{cell.replace('.', ',')}{mark}" if _is_number(cell) else cell for cell in row] for row in table.rows
    ]
    return replace(table, rows=rows)


def swapped(table: Table) -> Table:
    """The table with the other sign of the current."""
    at = table.current
    rows = [[*row[:at], f"{-float(row[at]):.10g}", *row[at + 1 :]] for row in table.rows]
    return replace(table, rows=rows)


def renamed(table: Table, names: dict[int, str]) -> Table:
    """The table with other names at some positions."""
    return replace(table, names=[names.get(k, name) for k, name in enumerate(table.names)])


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _text(
    change: Callable[[Table], Table] = lambda table: table, separator: str = ",", end: str = "\n", codec: str = "utf-8"
) -> Callable[[Table], bytes]:
    return lambda table: joined(change(table), separator, end).encode(codec, "replace")


def _shuffled(table: Table) -> Table:
    order = list(range(len(table.names)))
    random.Random(1).shuffle(order)
    rows = [[row[k] for k in order] for row in table.rows]
    return Table([table.names[k] for k in order], rows)


def _cut(share: float) -> Callable[[Table], bytes]:
    def write(table: Table) -> bytes:
        whole = joined(table).encode()
        start = whole.index(b"\n", whole.index(table.names[0].encode())) + 1
        at = start + int(share * (len(whole) - start))
        line = whole.rindex(b"\n", 0, at) + 1
        # In the middle of a row: after its second separator.
        second = whole.index(b",", whole.index(b",", line) + 1)
        return whole[:second]

    return write


def _block_twice(table: Table) -> Table:
    third = len(table.rows) // 3
    return replace(table, rows=table.rows[: 2 * third] + table.rows[third:])


def _header_again(share: float) -> Callable[[Table], Table]:
    """The table as two that were joined, each with its line of names."""

    def change(table: Table) -> Table:
        k = int(share * len(table.rows))
        return replace(table, rows=[*table.rows[:k], table.names, *table.rows[k:]])

    return change


def _time_bug(table: Table) -> Table:
    rows: list[list[str]] = []
    for k, row in enumerate(table.rows):
        if k and k % max(2, len(table.rows) // 5) == 0:
            rows.append([*row[: table.time], "0", *row[table.time + 1 :]])
        rows.append(row)
    return replace(table, rows=rows)


def _header_lines(table: Table) -> Table:
    above = ["Test report", "", "Operator: N.N.", "Cell, 3 Ah, 3.6 V", "limits;2.5;4.2", "Start: 01.02.2024 10:00:00"]
    return replace(table, above=above + [f"note {k}: free text, with a comma and {k} numbers" for k in range(20)])


def _with(rows: Callable[[list[list[str]]], list[list[str]]]) -> Callable[[Table], Table]:
    return lambda table: replace(table, rows=rows(table.rows))


def _damaged(table: Table, cells: Callable[[list[str]], list[str]]) -> Table:
    k = len(table.rows) // 2
    return replace(table, rows=[*table.rows[:k], cells(table.rows[k]), *table.rows[k + 1 :]])


def _no_number(table: Table) -> Table:
    return _damaged(table, lambda row: [*row[: table.voltage], "abc", *row[table.voltage + 1 :]])


def _unknown(table: Table) -> Table:
    return renamed(table, {table.time: "alpha", table.current: "beta", table.voltage: "gamma"})


_NAMED_AGAIN = {"columns": {"time_s": Column("alpha"), "current_A": Column("beta"), "voltage_V": Column("gamma")}}
DISCHARGE_POSITIVE = {"current_sign": "discharge-positive"}

TABLE_VARIANTS: dict[str, Variant] = {
    "as it is": Variant(_text()),
    "; between columns": Variant(_text(separator=";")),
    "tab between columns": Variant(_text(separator="\t")),
    "| between columns": Variant(_text(separator="|")),
    "; and decimal comma": Variant(_text(commas, ";")),
    "tab and decimal comma": Variant(_text(commas, "\t")),
    "decimal comma in quotation marks": Variant(_text(lambda table: commas(table, quoted=True))),
    "decimal comma between commas": Variant(_text(commas), "refused"),
    "UTF-8 with its mark": Variant(_text(codec="utf-8-sig")),
    "UTF-16 with its mark": Variant(_text(codec="utf-16")),
    "UTF-16 LE without": Variant(_text(codec="utf-16-le")),
    "UTF-16 BE without": Variant(_text(codec="utf-16-be")),
    "Latin-1": Variant(_text(codec="latin-1")),
    "Windows 1252": Variant(_text(codec="cp1252")),
    "Windows line ends": Variant(_text(end="\r\n")),
    "old Macintosh line ends": Variant(_text(end="\r")),
    "no end of the last line": Variant(lambda table: joined(table).rstrip("\n").encode()),
    "gzipped": Variant(lambda table: gzip.compress(joined(table).encode(), 1)),
    "lines above the table": Variant(_text(_header_lines)),
    "lines above the table, ;": Variant(_text(_header_lines, ";")),
    "columns in another order": Variant(_text(_shuffled)),
    "a separator ends each row": Variant(_text(_with(lambda rows: [[*row, ""] for row in rows]))),
    "names in capitals": Variant(_text(lambda table: replace(table, names=[_loud(name) for name in table.names]))),
    "blanks around cells": Variant(_text(_with(lambda rows: [[f" {cell} " for cell in row] for row in rows]))),
    "blank lines between": Variant(lambda table: joined(table).replace("\n", "\n\n").encode()),
    "unknown names": Variant(_text(_unknown), "asks"),
    "swapped sign": Variant(_text(swapped), "asks", "current_sign"),
    "swapped sign, told": Variant(_text(swapped), choices=DISCHARGE_POSITIVE),
    "each row twice": Variant(_text(_with(lambda rows: [row for row in rows for _ in (0, 1)])), remark="repeated word"),
    "a third twice": Variant(_text(_block_twice), "asks", "bad_times"),
    "a third twice, told": Variant(_text(_block_twice), choices={"leave_out": True}),
    "clock falls back": Variant(_text(_time_bug), remark="a fault of the time stamps"),
    "cut in its last line": Variant(_cut(0.999), "part", remark="cut off"),
    "cut in half": Variant(_cut(0.5), "part", remark="cut off"),
    "header cut off": Variant(lambda table: joined(table).split("\n", 1)[1].encode(), "asks"),
    "gzip cut off": Variant(lambda table: gzip.compress(joined(table).encode())[:-40], "refused"),
    "no rows": Variant(lambda table: joined(replace(table, rows=[])).encode(), "refused"),
    "names again, most rows below": Variant(_text(_header_again(0.3)), "refused"),
    "names again below one row": Variant(_text(_header_again(0.003)), "refused"),
    "names again, most rows above": Variant(_text(_header_again(0.7)), "refused"),
    "a row too short": Variant(_text(lambda table: _damaged(table, lambda row: row[:2])), "refused"),
    "a cell without a number": Variant(_text(_no_number), "refused"),
    "zeros of a dead disk": Variant(lambda table: b"\0" * 5000, "refused"),
    "a picture": Variant(lambda table: b"\x89PNG\r\n\x1a\n" + bytes(range(256)), "refused"),
}


def _loud(name: str) -> str:
    """A name in capitals, its unit as it was."""
    for mark in ("(", "[", "/"):
        if mark in name:
            head, rest = name.split(mark, 1)
            return head.upper() + mark + rest
    return name if "_" in name else name.upper()


def _clock(arrays: Arrays, form: str) -> list[str]:
    start = datetime(2024, 2, 27, 22, 30, tzinfo=UTC)
    return [(start + timedelta(seconds=float(s))).strftime(form) for s in arrays["time_s"]]


def _clocked(arrays: Arrays, name: str, cells: list[str]) -> Table:
    return table_of(arrays, f"{name}|Current (A)|Voltage (V)|Temperature (°C)|Cycle|Step", {"time_s": cells})


def _hms(seconds: float, days: bool) -> str:
    if days:
        return f"{int(seconds // 86400) + 1}d {_hms(seconds % 86400, False)}"
    return f"{int(seconds // 3600)}:{int(seconds // 60) % 60:02d}:{seconds % 60:06.3f}"


def record_variants(arrays: Arrays) -> dict[str, tuple[Table, Variant]]:
    """The record with other columns: units, kinds of time, ways to write the sign, several cells."""
    as_is = Variant(_text())
    return {
        "units in a row of their own": (_unit_row(arrays), as_is),
        "units in square brackets": (table_of(arrays, "~Time[s]|I[A]|U[V]|T1[°C]|Cyc-Count|Line"), as_is),
        "units after a stroke": (table_of(arrays, "time/s|I/A|Ecell/V|Temperature/°C|cycle number|Ns"), as_is),
        "units after a comma": (
            table_of(arrays, "Time, s|Current, A|Voltage, V|Temperature, C|Cycle|Step"),
            Variant(_text(separator=";")),
        ),
        "German": (
            table_of(arrays, "Zeit in s|Strom in A|Spannung in V|Temperatur in °C|Zyklus|Schritt"),
            Variant(_text(commas, ";", codec="cp1252")),
        ),
        "blanks between columns": (
            table_of(arrays, "time_s|current_A|voltage_V|temperature_degC|cycle|step"),
            Variant(lambda table: joined(table, "   ").encode()),
        ),
        "unknown names, told": (_unknown(table_of(arrays)), Variant(_text(), choices=_NAMED_AGAIN)),
        "two voltages": (
            table_of(arrays, _PLAIN.replace("Temperature (°C)", "Voltage (V)")),
            Variant(_text(), "asks", "voltage_V"),
        ),
        **_unit_variants(arrays),
        **_time_variants(arrays),
        **_sign_variants(arrays),
    }


def _unit_variants(arrays: Arrays) -> dict[str, tuple[Table, Variant]]:
    milliampere = {"current_A": _times(arrays["current_A"], 1e3)}
    millivolt = {"voltage_V": _times(arrays["voltage_V"], 1e3)}
    small = _PLAIN.replace("(A", "(mA").replace("(V", "(mV")
    no_ampere, as_is = _PLAIN.replace(" (A)", ""), Variant(_text())
    told = Variant(_text(), choices={"columns": {"current_A": Column("Current", "mA")}})
    kelvin = {"temperature_degC": _times(arrays["temperature_degC"], 1.0, 273.15)}
    grouped = {"time_s": [f'"{x:,.1f}"' for x in arrays["time_s"]]}
    return {
        "mA and mV": (table_of(arrays, small, milliampere | millivolt), as_is),
        "mV unnamed": (table_of(arrays, _PLAIN.replace(" (V)", ""), millivolt), as_is),
        "mA unnamed": (table_of(arrays, no_ampere, milliampere), Variant(_text(), "asks", "current_A")),
        "mA unnamed, told": (table_of(arrays, no_ampere, milliampere), told),
        "kelvin": (table_of(arrays, _PLAIN.replace("°C", "K"), kelvin), as_is),
        "thousands in groups": (table_of(arrays, _PLAIN, grouped), as_is),
    }


def _time_variants(arrays: Arrays) -> dict[str, tuple[Table, Variant]]:
    as_is, time_s = Variant(_text()), arrays["time_s"]
    inside = np.concatenate([10.0 * np.arange(n) for n in np.unique(arrays["step_count"], return_counts=True)[1]])
    in_step = {**arrays, "time_s": inside}
    unclear = [text.replace("27/", "03/").replace("28/", "04/") for text in _clock(arrays, "%d/%m/%Y %H:%M:%S")]
    later = {**arrays, "time_s": time_s + 5000.0 * (np.arange(len(time_s)) > 217)}
    unlogged = {name: np.delete(values, slice(202, 218)) for name, values in later.items()}
    asks_time = Variant(_text(), "asks", "time_s")
    return {
        "hours": (table_of(arrays, _PLAIN.replace("(s)", "(h)"), {"time_s": _times(time_s, 1.0 / 3600.0)}), as_is),
        "h:mm:ss": (_clocked(arrays, "Test Time", [_hms(s, False) for s in time_s]), as_is),
        "days and h:mm:ss": (
            _clocked(arrays, "Test Time", [_hms(s, True) for s in time_s]),
            Variant(_text(), choices={"days": 1}),
        ),
        "ISO dates": (_clocked(arrays, "Date", _clock(arrays, "%Y-%m-%dT%H:%M:%S")), as_is),
        "dates with dots": (_clocked(arrays, "Datum", _clock(arrays, "%d.%m.%Y %H:%M:%S")), as_is),
        "American dates": (_clocked(arrays, "Date Time", _clock(arrays, "%m/%d/%Y %I:%M:%S %p")), as_is),
        "dates with words": (_clocked(arrays, "DPT Time", _clock(arrays, "%d-%b-%y %H:%M:%S")), as_is),
        "unclear dates": (_clocked(arrays, "Date", unclear), Variant(_text(), "asks", "date_order")),
        "Excel's day numbers": (
            _clocked(arrays, "Date", [f"{45349.9375 + s / 86400.0:.10f}" for s in time_s]),
            as_is,
        ),
        "only the time in the step": (table_of(in_step, _PLAIN.replace("Test Time", "Step Time")), asks_time),
        "the time in the step, called time": (table_of(in_step), asks_time),
        "the time in the step, with a date": (
            table_of(in_step, _PLAIN + "|Date", {"date": _clock(arrays, "%Y-%m-%d %H:%M:%S")}),
            Variant(_text(), remark="begins anew with each step"),
        ),
        "a rest that nobody logged": (table_of(unlogged), Variant(_text(), "rest", remark="not logged")),
    }


def _sign_variants(arrays: Arrays) -> dict[str, tuple[Table, Variant]]:
    current = arrays["current_A"]
    size = {"current_A": _times(np.abs(current), 1.0)}
    words = {"state": ["C" if value > 0 else "D" if value < 0 else "R" for value in current]}
    apart = {"a": _times(np.maximum(current, 0.0), 1.0), "b": _times(np.maximum(-current, 0.0), 1.0)}
    rest = {name: values for name, values in arrays.items() if name != "current_A"}
    names = _PLAIN.replace("Current (A)|", "") + "|Charge Current (A)|Discharge Current (A)"
    as_is, given = Variant(_text()), Variant(_text(), remark="the sign of the current is that of column")
    return {
        "charge and discharge apart": (table_of(rest, names, apart), Variant(_text())),
        "a state gives the sign": (table_of(arrays, _PLAIN + "|State", size | words), given),
        "a state against the sign": (
            table_of(arrays, _PLAIN + "|State", {"current_A": _times(-np.abs(current), 1.0)} | words),
            Variant(_text(), "asks", "state"),
        ),
        "a state beside a sign": (table_of(arrays, _PLAIN + "|State", words), as_is),
        "a state beside the other sign, told": (
            table_of(arrays, _PLAIN + "|State", {"current_A": _times(-current, 1.0)} | words),
            Variant(_text(), choices=DISCHARGE_POSITIVE),
        ),
        "no state gives the sign": (table_of(arrays, _PLAIN, size), Variant(_text(), "asks", "state")),
        "two cells": (_two_cells(arrays), Variant(_text(), "asks", "cell")),
        "two cells, told": (_two_cells(arrays), Variant(_text(), choices={"cell": "B"})),
    }


def _times(values: NDArray[np.float64], factor: float, offset: float = 0.0) -> list[str]:
    return [f"{value:.12g}" for value in values * factor + offset]


def _unit_row(arrays: Arrays) -> Table:
    table = table_of(arrays, "Test Time|Current|Voltage|Temperature|Cycle|Step")
    return replace(table, rows=[["s", "A", "V", "°C", "", ""], *table.rows])


def _two_cells(arrays: Arrays) -> Table:
    table = table_of(arrays)
    other = [[row[0], row[1], f"{float(row[2]) + 0.1:.10g}", *row[3:]] for row in table.rows]
    pairs = zip(other, table.rows, strict=True)
    return Table([*table.names, "Channel"], [row for a, b in pairs for row in ([*a, "A"], [*b, "B"])])
