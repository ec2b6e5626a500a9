"""Numbers to and from Arrow are those of pyarrow's own ways, which load pandas."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from bench_service.exchange.arrow_numbers import floats, table_of
from tests.patience import PATIENCE_S

VALUES = [1.5, None, -2.0, 7.25, None, 0.1, 1e300, -0.0, 3.0, None, 5.0]


def whole(column: pa.ChunkedArray | pa.Array) -> np.ndarray:
    """What pyarrow itself makes of a column."""
    return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)


@pytest.mark.parametrize("begin", [0, 1, 3, 9, 11])
def test_numbers_and_gaps_are_those_of_pyarrow(begin: int) -> None:
    array = pa.array(VALUES, pa.float64()).slice(begin)
    np.testing.assert_array_equal(floats(array), whole(array))
    chunked = pa.chunked_array([array, pa.array([], pa.float64()), pa.array(VALUES[:3], pa.float64())])
    np.testing.assert_array_equal(floats(chunked), whole(chunked))


@pytest.mark.parametrize("kind", [pa.int8(), pa.int64(), pa.uint32(), pa.float32()])
def test_other_kinds_of_numbers_are_read(kind: pa.DataType) -> None:
    array = pa.array([3, None, 5], kind)
    np.testing.assert_array_equal(floats(array), [3.0, np.nan, 5.0])


def test_a_column_of_nothing_is_missing() -> None:
    np.testing.assert_array_equal(floats(pa.nulls(3)), np.full(3, np.nan))
    assert floats(pa.chunked_array([], pa.float64())).shape == (0,)


def test_what_was_read_can_be_changed() -> None:
    found = floats(pa.array([1.0, 2.0]))
    found[0] = 5.0
    assert found.tolist() == [5.0, 2.0]


def test_a_table_has_gaps_where_numbers_are_missing() -> None:
    every_other = np.array([1.0, 9.0, np.nan, 9.0, 3.0, 9.0])[::2]
    table = table_of({"a": every_other, "count": np.array([1, 2, 3]), "name": np.array(["x", "y", "z"])})
    assert table.to_pydict() == {"a": [1.0, None, 3.0], "count": [1, 2, 3], "name": ["x", "y", "z"]}
    assert table.column("a").null_count == 1
    assert table.schema.types[:2] == [pa.float64(), pa.int64()]
    table.validate(full=True)


def test_a_log_is_read_and_written_without_pandas(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    rows = "time_s,current_A,voltage_V,temperature_degC", "0,0.0,3.7,25", "1,-1.0,,25", "2,-1.0,3.6,25"
    log.write_text("\n".join(rows), encoding="utf-8")
    program = (
        "import json, sys; from pathlib import Path; from bench_service.exchange.read import read_run_file\n"
        "from bench_service.exchange.parquet import encode_parquet\n"
        "from bench_service.exchange.delimited import encode_csv\n"
        f"run = read_run_file(Path({str(log)!r})).series\n"
        "columns = {name: getattr(run, name) for name in ('time_s', 'current_A', 'voltage_V', 'temperature_degC')}\n"
        f"stored = Path({str(tmp_path / 'log.parquet')!r}); stored.write_bytes(encode_parquet(columns))\n"
        "again = read_run_file(stored).series; encode_csv(columns)\n"
        "print(json.dumps([len(again.time_s), 'pandas' in sys.modules]))"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=PATIENCE_S)
    assert json.loads(done.stdout) == [3, False]
