"""Rows of a benchmark that can be stopped: one JSON object a line; what is there already is not done again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


def read_rows(path: Path | None) -> list[Row]:
    """Rows of an earlier call; none without a file. A line that was cut short, when that call was killed, is none."""
    found = list[Row]()
    for text in path.read_text(encoding="utf-8").splitlines() if path is not None and path.exists() else ():
        try:
            found.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return found


def add_row(path: Path | None, row: Row) -> None:
    """Add a row, on a line of its own even behind one that was cut short; nothing without a file."""
    if path is None:
        return
    before = path.read_bytes() if path.exists() else b""
    cut_short = before and not before.endswith(b"\n")
    with path.open("a", encoding="utf-8") as file:
        file.write(("\n" if cut_short else "") + json.dumps(row) + "\n")
