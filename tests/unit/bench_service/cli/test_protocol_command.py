"""`bench-service protocol`: what it lists, checks and converts, and what it refuses in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bench_service.cli.main import main

DOCUMENT = {
    "schema": "bench-protocol-1",
    "name": "one cycle",
    "record": {"time_s": 10},
    "steps": [
        {"step": "cc_cv", "rate_C": "C/2", "voltage_V": 4.1, "until": {"rate_C": 0.05}},
        {"step": "rest", "until": {"time_s": 600}},
        {"step": "constant_current", "rate_C": -1, "until": {"voltage_V": 3.0}},
    ],
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.json").write_text(json.dumps(DOCUMENT))
    return tmp_path


def said(capsys: pytest.CaptureFixture[str], *words: str) -> dict:
    assert main(["protocol", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_library_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    names = {test["name"] for test in said(capsys, "list")["standard_tests"]}
    assert {"capacity", "cc_cv_cycling", "rate_test", "gitt", "hppc", "drive_cycle", "pseudo_ocv", "formation"} <= names


def test_a_protocol_and_a_standard_test_are_checked(capsys: pytest.CaptureFixture[str]) -> None:
    own = said(capsys, "check", "own.json")
    assert own["steps"] == 3 and 3000 < own["expected_s"] < 20000
    assert said(capsys, "check", "capacity", "--set", "rounds=1")["steps"] == 4


def test_formats_are_converted_there_and_back(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    said(capsys, "convert", "own.json", "--capacity-Ah", "2", "--to", "unicycler", "--out", "uni.json")
    assert [step["step"] for step in json.loads((folder / "uni.json").read_text())["method"]] == [
        "constant_current", "constant_voltage", "open_circuit_voltage", "constant_current"
    ]  # fmt: skip
    said(capsys, "convert", "uni.json", "--to", "pybamm", "--out", "strings.json")
    strings = json.loads((folder / "strings.json").read_text())
    assert strings[:2] == ["Charge at 0.5C until 4.1 V", "Hold at 4.1 V until 0.05C"]
    (folder / "strings.txt").write_text("\n".join(strings))
    said(capsys, "convert", "strings.txt", "--out", "back.json")
    assert len(json.loads((folder / "back.json").read_text())["steps"]) == 4


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["check"], "name a file"),
        (["check", "nothing.json"], "No such file"),
        (["check", "alchemy"], "no such standard test"),
        (["check", "capacity", "--set", "rounds"], "--set rounds"),
        (["convert", "own.json"], "--out FILE"),
        (["check", "own.json", "--bench", "other"], "unknown bench"),
        (["convert", "hppc", "--to", "unicycler", "--out", "x.json"], "step "),
    ],
)
def test_what_is_wrong_is_one_line(capsys: pytest.CaptureFixture[str], words: list[str], told: str) -> None:
    assert main(["protocol", *words]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1
