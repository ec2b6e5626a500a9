"""Files out: labels, missing values, and whole or not at all."""

from pathlib import Path

import numpy as np
import pytest

from bench_service.exchange import encode_run, write_run
from bench_service.exchange.atomic import check_writable, write_atomically
from bench_service.exchange.errors import ExchangeError, UnknownFormatError
from bench_service.exchange.write import write_results

COLUMNS = {
    "time_s": np.array([0.0, 0.1]),
    "current_A": np.array([0.0, 1.5]),
    "voltage_V": np.array([3.7, np.nan]),
    "temperature_degC": np.array([25.0, 25.5]),
    "ambient_degC": np.array([24.0, 24.0]),
    "setpoint_A": np.array([0.0, 1.5]),
    "flags": np.array([0, 1], dtype="<u4"),
}


def test_battery_data_format_labels() -> None:
    lines = encode_run(COLUMNS, "bdf", started_unix_s=1.7e9).decode().splitlines()
    assert lines[0] == (
        "Test Time / s,Current / A,Voltage / V,Surface Temperature / degC,Ambient Temperature / degC,Unix Time / s"
    )
    assert lines[2] == "0.1,1.5,,25.5,24,1700000000.1"


def test_unix_time_is_absent_where_unknown() -> None:
    assert b"Unix" not in encode_run(COLUMNS, "bdf")


def test_own_csv_keeps_every_column() -> None:
    lines = encode_run(COLUMNS, "csv").decode().splitlines()
    assert lines[0] == "time_s,current_A,voltage_V,temperature_degC,ambient_degC,setpoint_A,flags"
    assert lines[2] == "0.1,1.5,,25.5,24,1.5,1"


def test_unknown_format_names_the_known_ones() -> None:
    known = "bdf, bdf-0.1.0, bdf-parquet, .* csv, mat, mdf4, parquet"
    with pytest.raises(UnknownFormatError, match=f"not known; choose from {known}"):
        encode_run(COLUMNS, "xlsx")


def test_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("old")
    write_run(path, COLUMNS, "csv")
    assert path.read_bytes() == encode_run(COLUMNS, "csv")
    assert [each.name for each in tmp_path.iterdir()] == ["run.csv"]


def test_failure_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "taken"
    path.mkdir()
    with pytest.raises(ExchangeError, match="cannot be written"):
        write_atomically(path, b"new")
    assert [each.name for each in tmp_path.iterdir()] == ["taken"]
    with pytest.raises(ExchangeError, match="cannot be written"):
        write_atomically(tmp_path / "nowhere" / "a.csv", b"new")


def test_outputs_are_checked_early(tmp_path: Path) -> None:
    check_writable(tmp_path / "a.csv")
    with pytest.raises(ExchangeError, match="does not exist"):
        check_writable(tmp_path / "nowhere" / "a.csv")
    with pytest.raises(ExchangeError, match="is a directory"):
        check_writable(tmp_path)


def test_results_have_a_table_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "soc.csv"
    write_results(path, {"run": np.array(["a", "a"]), "time_s": np.array([0.0, 1.0]), "soc": np.array([0.5, np.nan])})
    assert path.read_text().splitlines() == ["run,time_s,soc", '"a",0,0.5', '"a",1,']
