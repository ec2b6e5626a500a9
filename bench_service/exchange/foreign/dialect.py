"""How a text table is written: where it begins, what separates its columns, which mark its decimals have."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass, replace

from bench_service.exchange.columns import unique_names
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.decimals import decimal_mark
from bench_service.exchange.foreign.units import find_unit

_SEPARATORS = ("\t", ";", ",", "|", " ")
_MOST_LINES = 4000
# So many rows that look like data are samples: a block of facts above the table has fewer of its width.
_RUN = 4
_LINE_END = re.compile(r"\r\n|\n|\r")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?")
_GROUPED = re.compile(r"[+-]?\d{1,3}([.,' ]\d{3})+([.,]\d+)?")
_TIME = re.compile(
    r"(\d+\s*d(ays?)?[ ,]+|\d+\.)?\d+:\d\d(:\d\d([.,]\d+)?)?(\s*[AaPp]\.?[Mm]\.?)?"
    r"|(\d{1,4}[-/.]\w{1,9}[-/.]\d{1,4})([T\s,]+\d+:\d\d.*)?"
)


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a text table is written.

    Attributes
    ----------
    encoding : codec of the text
    separator : one character; a blank stands for any run of blanks
    decimal : "." or ","
    names : every column's name, in order; "column 3" where the file names none
    units : a unit for each column from a row of its own, or ""
    first_row : line of the file in which the first row of data stands, from 1
    skip_chars : characters before that line
    sample : the first rows, as text
    """

    encoding: str
    separator: str
    decimal: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_row: int
    skip_chars: int
    sample: tuple[tuple[str, ...], ...]


def find_dialect(path: object, text: str, encoding: str, whole: bool) -> Dialect:
    """Find the table in a text.

    Parameters
    ----------
    path : name for messages
    text : beginning of the file
    encoding : codec of the text
    whole : whether `text` is the whole file (otherwise its last line is not looked at)

    Raises
    ------
    RunFileError
        No table is found, or its rows do not fit its header: with what to do.
    """
    lines, starts = _lines(text, whole)
    found = [each for separator in _SEPARATORS if (each := _find_table(lines, separator)) is not None]
    fitting = [each for each in found if each.header is not None and each.fits]
    if not fitting:
        raise RunFileError(f"{path}: {_why_none(lines, found)}")
    # A blank is the last resort: it is in every header and every date.
    best = max(fitting, key=lambda each: (each.separator != " ", each.width, each.n_rows))
    if best.earlier is not None:
        first, last = best.earlier
        raise RunFileError(
            f"{path}: lines {first + 1} to {last} hold samples in {best.width} columns, and so do those from line "
            f"{best.first + 1} on: a second table follows; export it again or split it there"
        )
    names = unique_names([name.strip() for name in best.names()])
    sample = tuple(tuple(cell.strip() for cell in row[: best.width]) for row in best.rows[:200])
    return Dialect(
        encoding=encoding,
        separator=best.separator,
        decimal=decimal_mark(str(path), names, best.rows, best.separator),
        names=names,
        units=best.units(),
        first_row=best.first + 1,
        skip_chars=starts[best.first],
        sample=sample,
    )


@dataclass(frozen=True, slots=True)
class _Table:
    separator: str
    first: int
    width: int
    n_rows: int
    rows: list[list[str]]
    header: list[str] | None
    unit_row: list[str] | None
    # Another run of data above this one, of the same width: its first row, and the row after its last.
    earlier: tuple[int, int] | None

    @property
    def fits(self) -> bool:
        """Whether the header names as many columns as the rows have; a separator may end the lines of either."""
        assert self.header is not None
        named = len(self.header)
        while named > 0 and not self.header[named - 1].strip():
            named -= 1
        filled = max((k + 1 for row in self.rows for k, cell in enumerate(row) if cell.strip()), default=0)
        return self.width >= 2 and filled <= len(self.header) and named <= self.width

    def names(self) -> list[str]:
        assert self.header is not None
        return (self.header + [""] * self.width)[: self.width]

    def units(self) -> tuple[str, ...]:
        row = self.unit_row or []
        return tuple((row + [""] * self.width)[: self.width])


def _lines(text: str, whole: bool) -> tuple[list[str], list[int]]:
    lines, starts, at = [], [], 0
    for match in _LINE_END.finditer(text):
        lines.append(text[at : match.start()])
        starts.append(at)
        at = match.end()
        if len(lines) >= _MOST_LINES:
            return lines, starts
    if at < len(text) and (whole or not lines):
        lines.append(text[at:])
        starts.append(at)
    return lines, starts


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:  # a carriage return within the line, a field without an end
        return line.split(separator)


def is_datum(cell: str) -> bool:
    """Whether a cell holds a number, a time or a date."""
    cell = cell.strip()
    return bool(_NUMBER.fullmatch(cell) or _TIME.fullmatch(cell) or _GROUPED.fullmatch(cell))


def _is_data(row: list[str]) -> bool:
    filled = [cell for cell in row if cell.strip()]
    data = sum(map(is_datum, filled))
    return data >= 2 and data >= 0.5 * len(filled)


def _find_table(lines: list[str], separator: str) -> _Table | None:
    """Return the longest run of rows of one width that look like data, with the lines above it."""
    rows = [_split(line, separator) for line in lines]
    runs = _data_runs(rows)
    if not runs:
        return None
    first, last = max(runs, key=lambda run: run[1] - run[0])
    width = len(rows[first])
    names = rows[first - 1] if first > 0 else []
    same = [
        (start, end)
        for start, end in runs
        if end <= first and len(rows[start]) == width
        if end - start >= _RUN or (names and start > 0 and rows[start - 1] == names)
    ]
    table = _Table(separator, first, width, last - first, rows[first:last], None, None, next(iter(same), None))
    above = [row for row in rows[max(0, first - 3) : first] if any(cell.strip() for cell in row)]
    if above and _is_units(above[-1], table.width) and len(above) > 1:
        return replace(table, header=above[-2], unit_row=above[-1])
    if above and len(above[-1]) >= 2 and not _is_data(above[-1]):
        return replace(table, header=above[-1])
    if first == 0 or not above:
        return replace(table, header=[f"column {k + 1}" for k in range(table.width)])
    return table


def _data_runs(rows: list[list[str]]) -> list[tuple[int, int]]:
    """First row, and the row after the last, of each run of rows of one width that look like data."""
    runs, start = [], 0
    data = [_is_data(row) for row in rows]
    while start < len(rows):
        end = start
        while end < len(rows) and data[end] and len(rows[end]) == len(rows[start]):
            end += 1
        if end > start and len(rows[start]) >= 2:
            runs.append((start, end))
        start = max(end, start + 1)
    return runs


def _is_units(row: list[str], width: int) -> bool:
    filled = [cell for cell in row if cell.strip()]
    known = sum(find_unit(cell) is not None for cell in filled)
    return abs(len(row) - width) <= 1 and known >= 2 and known >= 0.4 * len(filled)


def open_quote(line: int) -> str:
    """Say that a cell is opened in a line and not closed there."""
    return (
        f"line {line}: a quotation mark opens a cell there that nothing in that line closes: the file is damaged; "
        "remove the mark, or export it again"
    )


def _why_none(lines: list[str], found: list[_Table]) -> str:
    for each in found:
        if each.first > 0 and lines[each.first - 1].count('"') % 2:
            return open_quote(each.first)
    candidates = [each for each in found if each.header is not None and each.separator != " "]
    for each in candidates:
        assert each.header is not None
        if each.separator == "," and each.width > len(each.header) >= 2:
            return (
                f"line {each.first + 1} has {each.width} fields between commas, the header above it "
                f"{len(each.header)}: where a comma is the decimal mark too, nobody can tell the two apart; "
                "export it with ; between columns or with decimal points"
            )
    for each in candidates:
        assert each.header is not None
        return (
            f"line {each.first + 1} has {each.width} fields, the header above it {len(each.header)}: "
            "the file is damaged, or its header is cut; export it again"
        )
    if not any(re.search(r"\d", line) for line in lines):
        return "holds no numbers: no table of samples"
    return "no table of samples is found in it: needs lines of numbers of equal width below a line of column names"
