"""Rows outlive the benchmark that makes them, also where it was killed while it wrote one."""

from pathlib import Path

from benchmarks.row_file import add_row, read_rows


def test_a_row_that_was_cut_short_is_made_again(tmp_path: Path) -> None:
    path = tmp_path / "rows"
    assert read_rows(None) == read_rows(path) == []
    add_row(None, {"case": 0})
    add_row(path, {"case": 1})
    with path.open("a") as file:
        file.write('{"case": 2, "er')
    assert read_rows(path) == [{"case": 1}]
    add_row(path, {"case": 2})
    assert read_rows(path) == [{"case": 1}, {"case": 2}]
