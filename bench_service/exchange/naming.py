"""Names of files as the Battery Data Format wants them: ``Institution__Cell__YYYYMMDD_XXX``."""

from __future__ import annotations

import re

_STRANGE = re.compile(r"[^A-Za-z0-9.-]+")


def run_file_name(institution: str, cell: str, day: str, number: int) -> str:
    """Return the name of a run's files, without the ends that tell the format.

    Parameters
    ----------
    institution, cell : str
        Of any letters; what a file name cannot have becomes ``-``.
    day : str
        On which it began, as ``2026-01-02``, with whatever behind.
    number : int
        From 1, of the cell's runs of that day.
    """
    return f"{_part(institution)}__{_part(cell)}__{day[:10].replace('-', '')}_{number:03d}"


def _part(text: str) -> str:
    return _STRANGE.sub("-", text).strip("-.") or "unnamed"
