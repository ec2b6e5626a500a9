"""Measured runs from files: columns, checks of time, units and sign, and the message for each fault."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from bench_service.exchange import RunFileError, read_run, read_run_file

HEADER = "time_s,current_A,voltage_V,temperature_degC"


def cell_rows(n: int = 200) -> list[str]:
    """Rest, charge and discharge pulses on a cell of 30 mOhm."""
    rows = []
    for k in range(n):
        current_A = (0.0, 2.0, 0.0, -3.0)[(k // 10) % 4]
        rows.append(f"{k * 0.5},{current_A},{3.7 + 0.03 * current_A:.4f},25.0")
    return rows


def write(path: Path, rows: list[str], header: str = HEADER) -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def refused(path: Path) -> str:
    """Read a file that must be refused; return the one line that says why."""
    with pytest.raises(RunFileError) as caught:
        read_run(path)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message


def test_own_names(tmp_path: Path) -> None:
    run = read_run(write(tmp_path / "pulses.csv", cell_rows()))
    assert run.name == "pulses"
    assert len(run) == 200
    assert run.time_s[3] == 1.5
    assert run.current_A[15] == 2.0
    assert run.voltage_V[35] == pytest.approx(3.61)
    assert run.temperature_degC[0] == 25.0
    assert run.ambient_degC is None
    assert run.soc_ref is None


@pytest.mark.parametrize(
    "header",
    [
        "Test Time / s,Current / A,Voltage / V,Surface Temperature / degC",
        "test_time_second,current_ampere,voltage_volt,surface_temperature_celsius",
        '"Test Time / s","Current / A","Voltage / V","Surface Temperature / degC"',
    ],
)
def test_battery_data_format_names(tmp_path: Path, header: str) -> None:
    run = read_run(write(tmp_path / "a.bdf.csv", cell_rows(), header))
    assert run.name == "a"
    assert run.current_A[15] == 2.0


def test_the_first_of_several_sensors_stands_for_a_cell_temperature_that_is_not_there(tmp_path: Path) -> None:
    names = "Test Time / s,Current / A,Voltage / V,Surface Temperature T1 / degC"
    assert read_run(write(tmp_path / "a.csv", cell_rows(), names)).temperature_degC[0] == 25.0
    rows = [f"{row},31.0" for row in cell_rows()]
    both = "Test Time / s,Current / A,Voltage / V,Temperature T1 / degC,Surface Temperature / degC"
    assert read_run(write(tmp_path / "b.csv", rows, both)).temperature_degC[0] == 31.0


def test_byte_order_mark_and_windows_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join([HEADER, *cell_rows()]).encode() + b"\r\n")
    assert read_run(path).time_s[3] == 1.5


def test_gzip_is_known_by_content(tmp_path: Path) -> None:
    path = tmp_path / "named_wrongly.csv"
    path.write_bytes(gzip.compress("\n".join([HEADER, *cell_rows()]).encode()))
    assert len(read_run(path)) == 200


def test_empty_fields_are_missing_values_and_never_zero(tmp_path: Path) -> None:
    rows = cell_rows()
    rows[15] = "7.5,2.0,,25.0"
    rows[16] = "8.0,2.0,NaN,"
    read = read_run_file(write(tmp_path / "a.csv", rows))
    assert np.flatnonzero(np.isnan(read.series.voltage_V)).tolist() == [15, 16]
    assert np.flatnonzero(np.isnan(read.series.temperature_degC)).tolist() == [16]
    assert any("voltage_V is missing in 2 of 200 rows" in each for each in read.warnings)


def test_other_columns_are_ignored_and_named(tmp_path: Path) -> None:
    rows = [f"{row},4.1,0.5" for row in cell_rows()]
    read = read_run_file(write(tmp_path / "a.csv", rows, HEADER + ",humidity,soc_ref"))
    assert read.ignored_columns == ("humidity",)
    assert read.series.soc_ref is not None
    assert read.series.soc_ref[0] == 0.5


def test_ambient_alone_stands_for_the_cell_temperature(tmp_path: Path) -> None:
    read = read_run_file(
        write(tmp_path / "a.csv", cell_rows(), "Test Time / s,Current / A,Voltage / V,Ambient Temperature / degC")
    )
    assert read.series.temperature_degC[0] == 25.0
    assert read.series.ambient_degC is None
    assert any("ambient" in each for each in read.warnings)


def test_the_edge_of_a_step_may_repeat_its_time(tmp_path: Path) -> None:
    rows = cell_rows()
    rows.insert(10, "5.0,0.0,3.5,25.0")
    read = read_run_file(write(tmp_path / "a.csv", rows))
    assert len(read.series) == 200
    assert read.series.voltage_V[10] == 3.5  # the first of the two rows
    assert any("row 13 (5 s)" in each for each in read.warnings)


def test_missing_file(tmp_path: Path) -> None:
    assert "no such file" in refused(tmp_path / "nowhere.csv")


def test_empty_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(b"")
    assert "is empty" in refused(tmp_path / "a.csv")


def test_header_alone(tmp_path: Path) -> None:
    assert "no rows" in refused(write(tmp_path / "a.csv", []))


def test_binary_file(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(bytes(range(256)))
    assert "neither CSV" in refused(tmp_path / "a.csv")


def test_broken_gzip(tmp_path: Path) -> None:
    content = gzip.compress("\n".join([HEADER, *cell_rows()]).encode())
    (tmp_path / "a.csv.gz").write_bytes(content[: len(content) // 2])
    assert "cannot be read" in refused(tmp_path / "a.csv.gz")


def test_wrong_columns_names_what_is_needed_and_what_is_there(tmp_path: Path) -> None:
    message = refused(write(tmp_path / "a.csv", cell_rows(), "t,current_mA,U,temperature_degC"))
    assert "needs time_s (or 'Test Time / s'), current_A (or 'Current / A'), voltage_V (or 'Voltage / V')" in message
    assert "'current_mA', 'U'" in message


def test_temperature_column_is_needed(tmp_path: Path) -> None:
    rows = [row.rsplit(",", 1)[0] for row in cell_rows()]
    message = refused(write(tmp_path / "a.csv", rows, "time_s,current_A,voltage_V"))
    assert "needs temperature_degC" in message
    assert "empty temperature column will do" in message


def test_two_columns_with_one_meaning(tmp_path: Path) -> None:
    rows = [row + ",1" for row in cell_rows()]
    assert "both hold current_A" in refused(write(tmp_path / "a.csv", rows, HEADER + ",Current / A"))


def test_cell_that_is_no_number(tmp_path: Path) -> None:
    rows = cell_rows()
    rows[7] = "3.5,zero,3.7,25.0"
    assert "row 9, column 'current_A': 'zero' is not a number" in refused(write(tmp_path / "a.csv", rows))


def test_row_with_too_few_fields(tmp_path: Path) -> None:
    rows = cell_rows()
    rows[7] = "3.5,0.0"
    assert "row 9 has 2 fields, the header has 4" in refused(write(tmp_path / "a.csv", rows))


@pytest.mark.parametrize("time", ["", "nan", "inf"])
def test_time_must_be_finite(tmp_path: Path, time: str) -> None:
    rows = cell_rows()
    rows[7] = f"{time},0.0,3.7,25.0"
    assert "row 9: time is missing or infinite" in refused(write(tmp_path / "a.csv", rows))


def test_time_going_backwards(tmp_path: Path) -> None:
    rows = cell_rows()
    rows[7], rows[8] = rows[8], rows[7]
    assert "backwards 1 time(s), first at row 10 (4 s, then 3.5 s)" in refused(write(tmp_path / "a.csv", rows))


def test_slow_rows_in_the_wrong_order_are_no_clock(tmp_path: Path) -> None:
    rows = [f"{k * 900},-0.25,{3.7 - 0.01 * k:.4f},25.0" for k in range(60)]
    rows[30], rows[31] = rows[31], rows[30]
    assert "backwards 1 time(s), first at row 33 (27900 s, then 27000 s); sort" in refused(
        write(tmp_path / "a.csv", rows)
    )
    shuffled = [cell_rows()[k] for k in np.random.default_rng(5).permutation(200)]
    assert "backwards 9" in refused(write(tmp_path / "b.csv", shuffled))


def test_doubled_rows(tmp_path: Path) -> None:
    rows = [row for row in cell_rows() for _ in range(2)]
    assert "200 row(s) repeat the time" in refused(write(tmp_path / "a.csv", rows))


def test_infinite_value(tmp_path: Path) -> None:
    rows = cell_rows()
    rows[7] = "3.5,0.0,inf,25.0"
    assert "row 9: voltage_V is infinite" in refused(write(tmp_path / "a.csv", rows))


def test_column_without_any_value(tmp_path: Path) -> None:
    rows = [f"{k},1.0,,25.0" for k in range(20)]
    assert "voltage_V has no value at all" in refused(write(tmp_path / "a.csv", rows))


def test_voltage_in_mV(tmp_path: Path) -> None:
    rows = [f"{k},{k % 2},{3700 + 30 * (k % 2)},25.0" for k in range(20)]
    assert "median voltage is 3715, above 1000 V: probably in mV" in refused(write(tmp_path / "a.csv", rows))


def test_current_in_mA(tmp_path: Path) -> None:
    rows = [f"{k},{2900 * (k % 2)},{3.7 + 0.03 * (k % 2)},25.0" for k in range(20)]
    assert "current reaches 2900, above 1000 A: probably in mA" in refused(write(tmp_path / "a.csv", rows))


def test_temperature_in_kelvin(tmp_path: Path) -> None:
    rows = [row.replace(",25.0", ",298.15") for row in cell_rows()]
    assert "temperature_degC is 298.15" in refused(write(tmp_path / "a.csv", rows))


def test_parquet_with_text_in_a_column(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(
        {"time_s": [0.0, 1.0], "current_A": ["a", "b"], "voltage_V": [3.7, 3.7], "temperature_degC": [2, 2]}
    )
    pq.write_table(table, tmp_path / "a.parquet")
    assert "column 'current_A' holds string, not numbers" in refused(tmp_path / "a.parquet")


def test_broken_parquet(tmp_path: Path) -> None:
    (tmp_path / "a.parquet").write_bytes(b"PAR1 and nothing that follows")
    assert "not a readable Parquet file" in refused(tmp_path / "a.parquet")


def test_voltages_of_a_modules_cells_stand_beside_the_run(tmp_path: Path) -> None:
    rows = [f"{k},{(-1) ** k},{7.4 + 0.01 * (-1) ** k},20,3.{k}1,{'' if k == 2 else f'3.{k}2'}" for k in range(6)]
    path = tmp_path / "module.csv"
    header = "time_s,current_A,voltage_V,temperature_degC,v_cell2_V,v_cell1_V"
    path.write_text("\n".join([header, *rows]))
    read = read_run_file(path, "charge-positive")
    assert read.ignored_columns == () and read.cells_V is not None
    np.testing.assert_allclose(read.cells_V[:, 1], [3.01, 3.11, 3.21, 3.31, 3.41, 3.51])
    assert np.isnan(read.cells_V[2, 0]) and read.cells_V[3, 0] == 3.32
    path.write_text("\n".join([header.replace("v_cell1_V", "v_cell3_V"), *rows]))
    with pytest.raises(RunFileError, match="v_cell2_V but no v_cell1_V"):
        read_run_file(path, "charge-positive")
