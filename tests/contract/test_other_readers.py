"""What goes out is read by others as it was stored: by polars, and for MAT by mat4py, which share nothing with ours."""

from pathlib import Path

import mat4py
import numpy as np
import polars
import pytest

from bench_service.exchange import encode_run, export_formats
from bench_service.exchange.columns import BDF_NAMES, FIRST_SENSOR_0_1

FORMATS = export_formats()
TABLES = sorted(name for name, each in FORMATS.items() if "csv" in each.suffix or "parquet" in each.suffix)


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """Numbers with all their digits, some missing."""
    rng = np.random.default_rng(3)
    made = {name: rng.normal(size=300) * 10.0 ** rng.integers(-9, 4, 300) for name in BDF_NAMES}
    made["time_s"] = np.cumsum(rng.uniform(0.01, 60.0, 300))
    made["voltage_V"][[0, 17, 299]] = np.nan
    return made


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_by_polars(name: str, tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    path = tmp_path / f"run{FORMATS[name].suffix}"
    path.write_bytes(encode_run(columns, name))
    text = path.suffix == ".csv"
    frame = polars.read_csv(path, infer_schema_length=None) if text else polars.read_parquet(path)
    labels = {own: label for own, (label, _) in BDF_NAMES.items()} if name.startswith("bdf") else {}
    labels |= {"temperature_degC": FIRST_SENSOR_0_1} if name.endswith("0.1.0") else {}
    assert set(frame.columns) == {labels.get(own, own) for own in columns}
    for own, values in columns.items():
        read = frame[labels.get(own, own)].cast(polars.Float64).fill_null(np.nan).to_numpy()
        np.testing.assert_array_equal(read, values, err_msg=own)


def test_mat_is_read_by_mat4py(tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    path = tmp_path / "run.mat"
    path.write_bytes(encode_run(columns, "mat", 1_700_000_000.25))
    read = mat4py.loadmat(str(path))
    assert read.pop("started_unix_s") == 1_700_000_000.25
    assert set(read) == set(columns)
    for own, values in columns.items():
        np.testing.assert_array_equal(np.ravel(read[own]), values, err_msg=own)
