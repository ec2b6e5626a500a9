"""Measured runs from files: format by content, columns by name, then checks of time, units and sign."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bench_service.exchange.columns import cell_columns, choose_columns
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.format import RawTable
from bench_service.exchange.registry import formats
from bench_service.exchange.sign import judge_sign
from models.data.errors import TimeSeriesError
from models.data.stamps.clock import without_hour_jumps
from models.data.stamps.repair import with_stamps_put_right
from models.data.timeseries import FloatArray, TimeSeries

CurrentSign = Literal["charge-positive", "discharge-positive"]

# A cell in mV starts at about 1000 (Ni-MH), a module in V ends below; a current in mA is above for all but tiny cells.
_LARGEST_VOLTAGE_V = 1000.0
_LARGEST_CURRENT_A = 1000.0
# Loggers write two rows with one time at the edge of a step; more than this share is a clock that is too coarse.
_DUPLICATE_SHARE = 0.02
_DUPLICATES_ALWAYS_ALLOWED = 3
# What loggers write where there is no value: the largest number of 32 bits, give or take its last digits.
_SENTINEL = 1e37


@dataclass(frozen=True, slots=True)
class RunFile:
    """A run as read.

    Attributes
    ----------
    series : the measurement, positive current charges
    cells_V : (n, groups) voltage of each group of a module's cells, NaN where missing; None where the file has none
    warnings : what a person should know: unclear sign, ignored duplicates, missing temperature
    ignored_columns : columns that were not used
    """

    series: TimeSeries
    warnings: tuple[str, ...] = ()
    ignored_columns: tuple[str, ...] = ()
    cells_V: FloatArray | None = None


def read_run(path: Path | str, current_sign: CurrentSign | None = None) -> TimeSeries:
    """Read a measured run; as `read_run_file`, without its remarks."""
    return read_run_file(path, current_sign).series


def read_run_file(path: Path | str, current_sign: CurrentSign | None = None) -> RunFile:
    """Read a measured run from CSV, gzipped CSV, Parquet, MAT or MDF.

    Parameters
    ----------
    path : the file; its content decides about the format, not its name
    current_sign : which sign charges in the file; None checks the current against the voltage's response

    Returns
    -------
    RunFile

    Raises
    ------
    RunFileError
        With one line: missing or unreadable file, wrong columns, no rows, a cell that is no number, time that is not
        finite or does not increase, a unit or a sign of current that cannot be.
    """
    path = Path(path)
    if current_sign is not None and current_sign not in get_args(CurrentSign):
        raise RunFileError(f"current sign {current_sign!r}: must be one of {', '.join(get_args(CurrentSign))}")
    table = _read_table(path)
    columns = dict(table.columns)
    warnings: list[str] = []
    _settle_clock(path, columns, warnings)
    _check_time(path, columns["time_s"])
    columns = _without_duplicates(path, columns, warnings)
    columns = {own: _without_sentinels(path, own, values, warnings) for own, values in columns.items()}
    _check_values(path, columns, warnings)
    _settle_sign(path, columns, current_sign, warnings)
    _settle_temperature(path, columns, warnings)
    used = set(choose_columns(str(path), table.names).values())
    cells = [columns.pop(name) for name in cell_columns(str(path), table.names)]
    try:
        series = TimeSeries(name=run_name(path), **columns)
    except TimeSeriesError as error:
        raise RunFileError(f"{path}: {str(error).removeprefix(run_name(path) + ': ')}") from error
    repaired, remarks = with_stamps_put_right(series)
    cells_V = np.column_stack(cells) if cells else None
    if cells_V is not None and len(repaired) != len(cells_V):
        cells_V = None
        remarks.append(f"{series.name}: the voltages of its cells are not used: rows had to be put in")
    ignored = tuple(name for name in table.names if name not in used)
    return RunFile(repaired, (*warnings, *remarks), ignored, cells_V)


def run_name(path: Path) -> str:
    """Name of a run after its file, without the ends that tell the format."""
    name = path.name
    for suffix in (".gz", ".csv", ".parquet", ".mat", ".mf4", ".bdf"):
        name = name.removesuffix(suffix)
    return name


def _read_table(path: Path) -> RawTable:
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError as error:
        reason = "no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)
        raise RunFileError(f"{path}: {reason[0].lower()}{reason[1:]}") from error
    if not head:
        raise RunFileError(f"{path}: is empty")
    for each in formats().values():
        if each.recognise is not None and each.read is not None and each.recognise(head):
            table = each.read(path)
            if len(table.columns["time_s"]) == 0:
                raise RunFileError(f"{path}: has a header but no rows")
            return table
    raise RunFileError(f"{path}: is neither CSV, gzipped CSV, Parquet, MAT nor MDF")


def _row(k: int) -> int:
    """Row in a text editor of sample `k`: the header is row 1."""
    return k + 2


def _settle_clock(path: Path, columns: dict[str, NDArray[np.float64]], warnings: list[str]) -> None:
    """Take out an hour by which a clock was put forward or back."""
    names = ("time_s", "current_A", "voltage_V")
    if not np.isfinite(columns["time_s"]).all() or any(name not in columns for name in names):
        return
    time_s, jumps = without_hour_jumps(*(columns[name] for name in names))
    if jumps:
        columns["time_s"] = np.asarray(time_s, np.float64)
        rows = ", ".join(str(_row(k)) for k in jumps)
        warnings.append(
            f"{path}: the clock jumps by an hour at row {rows}, as at a change to or from daylight saving time, while "
            "load and voltage go on; taken out"
        )


def _check_time(path: Path, time_s: NDArray[np.float64]) -> None:
    bad = ~np.isfinite(time_s)
    if bad.any():
        k = int(np.argmax(bad))
        raise RunFileError(f"{path}: row {_row(k)}: time is missing or infinite ({int(bad.sum())} such row(s))")
    falls = np.diff(time_s) < 0
    if falls.any():
        k = int(np.argmax(falls)) + 1
        raise RunFileError(
            f"{path}: time goes backwards {int(falls.sum())} time(s), first at row {_row(k)} "
            f"({time_s[k - 1]:g} s, then {time_s[k]:g} s); sort the rows or split the file"
        )


def _without_duplicates(
    path: Path, columns: dict[str, NDArray[np.float64]], warnings: list[str]
) -> dict[str, NDArray[np.float64]]:
    """Keep the first row of each time: the value at a time belongs to the interval that ends there."""
    time_s = columns["time_s"]
    keep = np.diff(time_s, prepend=-np.inf) > 0
    n = int((~keep).sum())
    if n == 0:
        return columns
    first = int(np.argmin(keep))
    what = f"{n} row(s) repeat the time of the row before, first at row {_row(first)} ({time_s[first]:g} s)"
    if n > max(_DUPLICATES_ALWAYS_ALLOWED, _DUPLICATE_SHARE * len(time_s)):
        raise RunFileError(
            f"{path}: {what}; the time column is too coarse or the rows are doubled: delete repeats, or log time finer"
        )
    warnings.append(f"{path}: {what}; left out")
    return {name: values[keep] for name, values in columns.items()}


def _without_sentinels(path: Path, own: str, values: NDArray[np.float64], warnings: list[str]) -> NDArray[np.float64]:
    """Take what stands for no value as missing."""
    sentinel = np.isfinite(values) & (np.abs(values) >= _SENTINEL)
    n = int(sentinel.sum())
    if n == 0:
        return values
    first = int(np.argmax(sentinel))
    warnings.append(f"{path}: {own} is {values[first]:.3g} in {n} row(s), first at row {_row(first)}: taken as missing")
    return np.where(sentinel, np.nan, values)


def _check_values(path: Path, columns: dict[str, NDArray[np.float64]], warnings: list[str]) -> None:
    if len(columns["time_s"]) < 2:
        raise RunFileError(f"{path}: has 1 row; at least 2 are needed")
    for own, values in columns.items():
        infinite = np.isinf(values)
        if infinite.any():
            raise RunFileError(f"{path}: row {_row(int(np.argmax(infinite)))}: {own} is infinite")
    for own in ("current_A", "voltage_V"):
        missing = int(np.isnan(columns[own]).sum())
        if missing == len(columns[own]):
            raise RunFileError(f"{path}: {own} has no value at all")
        if missing:
            warnings.append(f"{path}: {own} is missing in {missing} of {len(columns[own])} rows")
    voltage_V = float(np.nanmedian(columns["voltage_V"]))
    if abs(voltage_V) > _LARGEST_VOLTAGE_V:
        raise RunFileError(
            f"{path}: median voltage is {voltage_V:g}, above {_LARGEST_VOLTAGE_V:g} V: probably in mV; convert it to V"
        )
    current_A = float(np.nanpercentile(np.abs(columns["current_A"]), 99.0))
    if current_A > _LARGEST_CURRENT_A:
        raise RunFileError(
            f"{path}: current reaches {current_A:g}, above {_LARGEST_CURRENT_A:g} A: probably in mA; convert it to A"
        )


def _settle_sign(
    path: Path,
    columns: dict[str, NDArray[np.float64]],
    current_sign: CurrentSign | None,
    warnings: list[str],
) -> None:
    if current_sign == "discharge-positive":
        columns["current_A"] = -columns["current_A"]
    if current_sign is not None:
        return
    evidence = judge_sign(columns["current_A"], columns["voltage_V"], columns["time_s"])
    if evidence.verdict == "discharge-positive":
        raise RunFileError(
            f"{path}: the current has the wrong sign (positive must charge): {evidence.text}; "
            "settle it with --current-sign discharge-positive (or charge-positive to keep the file's sign)"
        )
    if evidence.verdict == "unclear":
        warnings.append(
            f"{path}: the sign of the current cannot be checked ({evidence.text}); positive is taken to charge"
        )


def _settle_temperature(path: Path, columns: dict[str, NDArray[np.float64]], warnings: list[str]) -> None:
    for own in ("ambient_degC", "soc_ref"):
        if own in columns and np.isnan(columns[own]).all():
            del columns[own]
    if "temperature_degC" not in columns and "ambient_degC" in columns:
        # A thermal model must not be identified from one temperature taken for two.
        columns["temperature_degC"] = columns.pop("ambient_degC")
        warnings.append(f"{path}: no cell temperature; the ambient temperature stands for it")
    elif "temperature_degC" not in columns:
        columns["temperature_degC"] = np.full(len(columns["time_s"]), np.nan)
    if np.isnan(columns["temperature_degC"]).all():
        warnings.append(f"{path}: no temperature is known")
