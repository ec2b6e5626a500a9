"""`bench-service import`, called in this process: a cycler's file in, a run out, or one question."""

import contextlib
import io
import json
from pathlib import Path

import pytest

from bench_service.cli.main import main
from bench_service.exchange import read_run
from benchmarks.import_variants import joined, record, renamed, swapped, table_of

TABLE = table_of(record(220))


def call(*arguments: object) -> tuple[int, str, str]:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as complaints:
        status = main(["import", *map(str, arguments)])
    return status, out.getvalue(), complaints.getvalue()


@pytest.fixture
def config(tmp_path: Path) -> Path:
    (tmp_path / "bench.toml").write_text(f"data_dir = '{tmp_path / 'data'}'\n")
    return tmp_path / "bench.toml"


def test_a_file_becomes_a_run(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(joined(TABLE, "\t"))
    status, text, complaints = call(tmp_path / "a.txt", "--out", tmp_path / "a.csv", "--json")
    assert (status, complaints) == (0, "")
    answer = json.loads(text)
    assert {"file", "state", "samples", "reason", "mapping", "remarks", "ignored_columns"} <= set(answer)
    assert (answer["state"], answer["samples"]) == ("completed", 220)
    assert len(read_run(tmp_path / "a.csv")) == 220


def test_looking_says_what_is_taken_for_what_and_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text(joined(TABLE))
    status, text, _ = call(tmp_path / "a.txt", "--show", "--json")
    answer = json.loads(text)
    assert status == 0 and len(answer["first_rows"]) == 5
    assert answer["mapping"]["columns"]["current_A"]["column"] == "Current (A)"
    status, text, _ = call(tmp_path / "a.txt", "--show")
    assert "Test Time (s)" in text and "unit s from its name" in text
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_question_is_one_line_and_its_answer_is_remembered(tmp_path: Path, config: Path) -> None:
    path, out = tmp_path / "a.csv", tmp_path / "out.csv"
    path.write_text(joined(swapped(renamed(TABLE, {0: "alpha", 1: "beta", 2: "gamma"}))))
    status, text, complaints = call(path, "--out", out)
    assert (status, text) == (2, "") and complaints.count("\n") == 1 and "--column current_A=NAME" in complaints
    chosen = ["--column", "time_s=alpha", "--column", "current_A=beta:mA", "--column", "voltage_V=gamma"]
    status, _, complaints = call(path, "--out", out, *chosen)
    assert status == 2 and "--current-sign discharge-positive" in complaints and not out.exists()
    chosen += ["--current-sign", "discharge-positive", "--save-mapping", "ours", "--config", config]
    assert call(path, "--out", out, *chosen)[0] == 0
    assert call(path, "--out", tmp_path / "again.csv", "--mapping", "ours", "--config", config)[0] == 0
    assert (tmp_path / "again.csv").read_bytes() == out.read_bytes()
    assert read_run(out).current_A.max() == pytest.approx(2e-3)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "say where to with --out"),
        (["--out", "a.xlsx"], "must tell the format"),
        (["--out", "b.csv", "--column", "power=P"], "with a role of"),
        (["--out", "b.csv", "--time-zone", "Here"], "time zone 'Here' is not known"),
        (["--out", "b.csv", "--mapping", "none"], "mapping 'none' is not known"),
        (["--out", "b.csv", "--mapping", "none", "--format", "arbin"], "give one of them"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    tmp_path: Path, config: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.csv").write_text(joined(TABLE))
    try:
        status, _, complaints = call("a.csv", *arguments, "--config", config)
    except SystemExit as ended:  # argparse ends by itself
        status, complaints = ended.code, ""
    assert status == 2 and (says in complaints or not complaints)
    assert not (tmp_path / "b.csv").exists()
