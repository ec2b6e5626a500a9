"""Numbers as text: which mark their decimals have, and what stands between groups of thousands."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from bench_service.exchange.errors import RunFileError

if TYPE_CHECKING:
    import pyarrow as pa

MISSING = ("", "NaN", "nan", "NAN", "NA", "N/A", "n/a", "#N/A", "null", "NULL", "None", "-", "--", "---", "#DIV/0!")
# One comma with three digits behind it, and no 0 at the beginning: decimals or thousands.
_EITHER = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


def grouped(decimal: str) -> str:
    """Pattern, for Python and RE2, of a whole number in groups of thousands, where decimals have a mark.

    What begins with 0 is none: 0,125 is a decimal comma, whatever the file's mark is.
    """
    return rf"^[+-]?[1-9]\d{{0,2}}(?:{group_marks(decimal)}\d{{3}})+(?:{re.escape(decimal)}\d+)?(?:[eE][+-]?\d+)?$"


def group_marks(decimal: str) -> str:
    """Pattern of what can stand between groups of thousands, where decimals have a mark."""
    return f"[{',' if decimal == '.' else '.'}' \u00a0\u202f]"


def decimal_mark(where: str, names: tuple[str, ...], rows: list[list[str]], separator: str) -> str:
    """Tell the mark of the decimals: that of most cells in which it can be nothing else.

    Parameters
    ----------
    where : name of the file for messages
    names : of the columns
    rows : cells as text
    separator : between the columns; who writes semicolons there has given the comma to the decimals

    Raises
    ------
    RunFileError
        A comma stands before three digits wherever it stands, and no other number tells what it is.
    """
    counts = {mark: 0 for mark in ".,"}
    patterns = {mark: _surely(mark) for mark in counts}
    either: tuple[str, str] | None = None
    for row in rows:
        for k, cell in enumerate(row[: len(names)]):
            cell = cell.strip()
            if _EITHER.fullmatch(cell):
                either = either or (cell, names[k])
                continue
            for mark, pattern in patterns.items():
                counts[mark] += pattern.fullmatch(cell) is not None
    if either is not None and not any(counts.values()):
        if separator == ";":
            return ","
        cell, name = either
        raise RunFileError(
            f"{where}: is {cell} in column {name!r} {cell.replace(',', '.')} or {cell.replace(',', '')}? Every comma "
            "has three digits behind it, so that it may stand before decimals or between thousands; export it without "
            "groups of thousands, or with decimal points"
        )
    return "," if counts[","] > counts["."] else "."


def _surely(mark: str) -> re.Pattern[str]:
    """Numbers in which the mark stands before decimals, or the other one more than once between groups."""
    other = re.escape("," if mark == "." else ".")
    plain = rf"\d*{re.escape(mark)}\d+([eE][+-]?\d+)?"
    return re.compile(rf"[+-]?({plain}|\d{{1,3}}({other}\d{{3}})+{re.escape(mark)}\d+|\d{{1,3}}({other}\d{{3}}){{2,}})")


def cleaned(array: pa.Array, decimal: str) -> pa.Array:
    """Turn cells into float64: blanks and the marks between thousands go, missing ones become null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    text = pc.utf8_trim_whitespace(array)  # pyright: ignore[reportAttributeAccessIssue]
    text = pc.if_else(pc.is_in(text, value_set=pa.array(MISSING)), None, text)  # pyright: ignore[reportAttributeAccessIssue]
    groups = pc.match_substring_regex(text, pattern=grouped(decimal))  # pyright: ignore[reportAttributeAccessIssue]
    bare = pc.replace_substring_regex(text, pattern=group_marks(decimal), replacement="")  # pyright: ignore[reportAttributeAccessIssue]
    text = pc.if_else(groups, bare, text)  # pyright: ignore[reportAttributeAccessIssue]
    if decimal == ",":
        if pc.any(pc.match_substring(text, ".")).as_py():  # pyright: ignore[reportAttributeAccessIssue]
            raise pa.ArrowInvalid("a decimal point among decimal commas")
        text = pc.replace_substring(text, pattern=",", replacement=".")  # pyright: ignore[reportAttributeAccessIssue]
    return text.cast(pa.float64())
