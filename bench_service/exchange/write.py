"""Runs and tables of results to files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from bench_service.exchange.atomic import write_atomically
from bench_service.exchange.delimited import encode_csv
from bench_service.exchange.errors import UnknownFormatError
from bench_service.exchange.format import Array, Format, RunTable
from bench_service.exchange.registry import formats


def export_formats() -> dict[str, Format]:
    """Formats that can be written, by name."""
    return {name: each for name, each in formats().items() if each.encode is not None}


def encode_run(columns: Mapping[str, Array], format_name: str, started_unix_s: float | None = None) -> bytes:
    """Return one run as the bytes of a file.

    Parameters
    ----------
    columns : own name -> (n,) with NaN where missing; at least time_s, current_A, voltage_V
    format_name : one of `export_formats`
    started_unix_s : UTC of the run's time 0 in s, or None

    Raises
    ------
    UnknownFormatError
        There is no such format.
    """
    known = export_formats()
    encode = known[format_name].encode if format_name in known else None
    if encode is None:
        raise UnknownFormatError(f"format {format_name!r} is not known; choose from {', '.join(sorted(known))}")
    return encode(RunTable(dict(columns), started_unix_s))


def write_run(path: Path, columns: Mapping[str, Array], format_name: str, started_unix_s: float | None = None) -> None:
    """Write one run as a file, whole or not at all (arguments as for `encode_run`)."""
    write_atomically(path, encode_run(columns, format_name, started_unix_s))


def write_results(path: Path, columns: Mapping[str, Array]) -> None:
    """Write what a model or an observer says as a CSV of its own (run data formats have no such columns)."""
    write_atomically(path, encode_csv(columns))
