"""Long records in bounded memory, what is written, and votes on the sign."""

import tracemalloc
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench_service.exchange import encode_run, read_run_file
from bench_service.exchange.errors import ExchangeError
from bench_service.exchange.foreign import byte_source, clean, importing, settle, spool, text_table
from bench_service.exchange.foreign import votes as votes_module
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices
from bench_service.exchange.foreign.mapping import Column
from bench_service.exchange.foreign.output import write_imported
from bench_service.exchange.foreign.votes import votes
from benchmarks.import_variants import joined, record, swapped, table_of

RECORD = record()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    target = tmp_path / "run.csv"
    target.write_text(joined(table_of(RECORD)))
    return target


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of a few rows: what a fault at a border would show."""
    for module in (clean, importing, spool):
        monkeypatch.setattr(module, "SLICE", 7)
    monkeypatch.setattr(text_table, "_BLOCK_BYTES", 500)
    monkeypatch.setattr(spool, "_IN_MEMORY_BYTES", 64)


@pytest.mark.usefixtures("small_blocks")
@pytest.mark.parametrize("doubled", [False, True])
def test_borders_of_blocks_leave_no_trace(path: Path, doubled: bool) -> None:
    if doubled:
        head, *rows = path.read_text().splitlines()
        path.write_text("\n".join([head, *(row for row in rows for _ in (0, 1))]) + "\n")
    shares: list[float] = []
    run = import_file(path, progress=shares.append)
    columns = run.columns()
    run.close()
    for name, values in RECORD.items():
        np.testing.assert_array_equal(columns[name], values)
    assert shares == sorted(shares) and shares[-1] == 1.0


@pytest.mark.parametrize("name", ["a.csv", "a.parquet", "a.bdf.csv", "a.bdf.parquet"])
def test_what_is_written_is_read_by_every_command(path: Path, name: str) -> None:
    run = import_file(path)
    write_imported(path.parent / name, run)
    run.close()
    read = read_run_file(path.parent / name)
    assert read.warnings == ()
    for column in ("time_s", "current_A", "voltage_V", "temperature_degC"):
        np.testing.assert_array_equal(getattr(read.series, column), RECORD[column])
    assert len(read.ignored_columns) == 2  # the counts: a measurement does not need them
    again = import_file(path.parent / name)
    np.testing.assert_array_equal(again.columns()["step_count"], RECORD["step_count"])
    assert again.mapping.name == "bdf"
    again.close()


def test_a_mat_file_is_read_by_its_names(tmp_path: Path) -> None:
    from scipy.io import loadmat, savemat

    (tmp_path / "own.mat").write_bytes(encode_run(RECORD, "mat"))
    assert loadmat(tmp_path / "own.mat")["current_A"].shape == (400, 1)
    names = {"time_s": "Time", "current_A": "Strom", "voltage_V": "Spannung"}
    savemat(tmp_path / "lab.mat", {name: RECORD[own] for own, name in names.items()} | {"note": "text", "Q": 3.0})
    for name in ("own", "lab"):
        run = import_file(tmp_path / f"{name}.mat")
        np.testing.assert_array_equal(run.columns()["current_A"], RECORD["current_A"])
        run.close()
    savemat(tmp_path / "empty.mat", {"note": "text"})
    with pytest.raises(ExchangeError, match="holds no vectors"):
        import_file(tmp_path / "empty.mat")
    (tmp_path / "cut.mat").write_bytes((tmp_path / "lab.mat").read_bytes()[:900])
    with pytest.raises(ExchangeError, match="not a readable MAT file"):
        import_file(tmp_path / "cut.mat")


def test_an_end_that_tells_no_format_is_refused(path: Path) -> None:
    run = import_file(path)
    with pytest.raises(ExchangeError, match=r"must tell the format: .bdf.csv"):
        write_imported(path.parent / "a.xlsx", run)
    run.close()


def test_memory_does_not_grow_with_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python's own memory, with all that is held at a time made smaller; pyarrow's blocks are of fixed size."""
    for module in (clean, importing, spool):
        monkeypatch.setattr(module, "SLICE", 10_000)
    monkeypatch.setattr(text_table, "_BLOCK_BYTES", 1 << 18)
    monkeypatch.setattr(spool, "_IN_MEMORY_BYTES", 1 << 16)
    monkeypatch.setattr(votes_module, "_WHOLE", 20_000)
    monkeypatch.setattr(votes_module, "_WINDOW", 2_000)
    monkeypatch.setattr(settle, "_SAMPLED", 5_000)
    monkeypatch.setattr(byte_source, "_BLOCK_BYTES", 1 << 15)
    n, row = 400_000, "{:d}.0,{:.1f},3.7{:d},25.0,1,1"
    path = tmp_path / "a.csv"
    lines = (row.format(k, k // 100 % 2, k // 100 % 2) for k in range(n))
    path.write_text("time_s,current_A,voltage_V,temperature_degC,cycle_count,step_count\n" + "\n".join(lines))
    tracemalloc.start()
    run = import_file(path)
    write_imported(tmp_path / "b.parquet", run)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    run.close()
    assert run.n == n
    assert peak < 0.7 * 6 * 8 * n  # what its six columns would take


def test_long_stages_and_a_held_voltage_are_enough(tmp_path: Path) -> None:
    """One charge of constant current, then constant voltage, in rows of ten minutes: two steps in all."""
    time_s = 600.0 * np.arange(30)
    current_A = np.where(time_s < 12000.0, 1.0, np.exp(-(time_s - 12000.0) / 1800.0))
    voltage_V = np.where(time_s < 12000.0, 3.6 + 0.5 * time_s / 12000.0, 4.1)
    counted = votes(current_A, voltage_V)
    assert counted.score == 1.0 and not counted.both
    arrays = {"time_s": time_s, "current_A": current_A, "voltage_V": np.round(voltage_V, 4)}
    arrays |= {"temperature_degC": np.full(30, 25.0), "cycle_count": np.ones(30), "step_count": np.ones(30)}
    path = tmp_path / "a.csv"
    path.write_text(joined(table_of(arrays)))
    import_file(path).close()
    path.write_text(joined(swapped(table_of(arrays))))
    with pytest.raises(ExchangeError, match="--current-sign discharge-positive"):
        import_file(path)
    run = import_file(path, Choices(current_sign="discharge-positive"))
    np.testing.assert_allclose(run.columns()["current_A"], current_A, rtol=1e-9)
    run.close()


def test_voltages_of_a_modules_cells_come_along(tmp_path: Path) -> None:
    rows = [f"{k},{(-1) ** k},{7.4 + 0.01 * (-1) ** k},20,3.{k}1,3.{k}2" for k in range(9)]
    path = tmp_path / "module.csv"
    path.write_text("\n".join(["time_s,current_A,voltage_V,temperature_degC,v_cell2_V,v_cell1_V", *rows]))
    with closing(import_file(path, Choices(current_sign="charge-positive"))) as run:
        assert run.names[-2:] == ("v_cell1_V", "v_cell2_V") and run.ignored_columns == ()
        assert run.columns()["v_cell1_V"][4] == 3.42
        write_imported(tmp_path / "run.bdf.csv", run)
    read = read_run_file(tmp_path / "run.bdf.csv", "charge-positive")
    assert read.cells_V is not None and read.cells_V[4].tolist() == [3.42, 3.41]


def test_a_sensor_a_little_below_zero_at_rest_leaves_the_sign_to_the_state(tmp_path: Path) -> None:
    current_A = RECORD["current_A"]
    size_A = np.where(current_A == 0.0, -0.0004, np.abs(current_A))
    words = ["C" if value > 0.0 else "D" if value < 0.0 else "R" for value in current_A]
    rows = zip(RECORD["time_s"], size_A, RECORD["voltage_V"], words, strict=True)
    path = tmp_path / "a.csv"
    path.write_text("\n".join(["Test Time (s),Amps,Volts,State", *(",".join(map(str, row)) for row in rows)]))
    with closing(import_file(path)) as run:
        np.testing.assert_allclose(run.columns()["current_A"], current_A, atol=0.0005)
        assert "the sign of the current is that of column 'State'" in run.remarks


def test_two_columns_of_one_name_in_parquet_are_told_apart_by_their_place(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "a.parquet"
    names = ["temperature_degC", "time_s", "current_A", "voltage_V", "temperature_degC"]
    arrays = [RECORD[name] for name in names[:-1]]
    pq.write_table(pa.Table.from_arrays([pa.array(each) for each in [*arrays, arrays[0] + 1.0]], names=names), path)
    with closing(import_file(path)) as run:
        np.testing.assert_array_equal(run.columns()["temperature_degC"], RECORD["temperature_degC"])
        assert run.ignored_columns == ("temperature_degC (2)",)
    with closing(import_file(path, Choices(columns={"temperature_degC": Column("temperature_degC (2)")}))) as run:
        np.testing.assert_array_equal(run.columns()["temperature_degC"], RECORD["temperature_degC"] + 1.0)
