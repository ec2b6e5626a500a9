"""`bench-service design`, called in this process: files in, a profile and one object out."""

import contextlib
import io
import json
from pathlib import Path

import numpy as np
import pytest

from bench_service.cli.main import main
from bench_service.exchange.profile import read_profile
from tests.unit.models.design.networks import resistive

REQUEST = """
model = "model.json"
capacity_Ah = 2.0
initial_soc = 0.5
duration_s = 3000
signal = "{signal}"
load_cycle = "cycle.csv"
seed = 1
[limits]
current_A = [-4, 4]
voltage_V = [{low}, 4.2]
soc = [0.1, 0.9]
"""


def call(*arguments: object) -> tuple[int, str, str]:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as complaints:
        status = main(["design", *map(str, arguments)])
    return status, out.getvalue(), complaints.getvalue()


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    (tmp_path / "model.json").write_text(json.dumps(resistive().to_json()))
    (tmp_path / "cycle.csv").write_text("time_s,current_A\n0,-2\n30,1\n50,-1\n100,3\n120,0\n")
    return tmp_path


def written(directory: Path, signal: str = "drive_cycle", low: float = 2.5) -> Path:
    path = directory / "request.toml"
    path.write_text(REQUEST.format(signal=signal, low=low))
    return path


@pytest.mark.parametrize("signal", ["optimal", "drive_cycle", "aprbs"])
def test_a_profile_within_its_limits_is_written(directory: Path, signal: str) -> None:
    out = directory / "profile.csv"
    status, text, complaints = call(written(directory, signal), "--out", out, "--json")
    assert (status, complaints) == (0, "")
    answer = json.loads(text)
    contract = {"profile", "duration_s", "n_samples", "log_det_information", "parameter_std"}
    assert contract | {"constraints_active_share", "seconds", "coverage", "constants_std"} <= set(answer)
    assert 0.0 < answer["coverage"]["share"] <= 1.0
    profile = read_profile(out)
    assert profile.time_s[-1] == answer["duration_s"] == 3000.0
    assert np.abs(profile.current_A).max() <= 4.0 + 1e-9


def test_two_model_files_are_told_apart(directory: Path) -> None:
    (directory / "other.json").write_text(json.dumps(resistive(2).to_json()))
    path = written(directory, "optimal")
    rivals = 'criterion = "discriminate"\nrivals = ["model.json", "other.json"]'
    path.write_text(path.read_text().replace("seed = 1", rivals).replace("3000", "600"))
    status, text, complaints = call(path, "--out", directory / "profile.csv", "--json")
    assert (status, complaints) == (0, "")
    assert min(json.loads(text)["separation"]) > 0.0


def test_a_page_shows_the_test(directory: Path) -> None:
    page = directory / "page.html"
    status, text, complaints = call(written(directory), "--out", directory / "profile.csv", "--report", page, "--json")
    assert (status, complaints) == (0, "") and json.loads(text)["report"] == str(page)
    shown = page.read_text()
    for words in (
        "limit 4.2 V",
        "Load cycle",
        "State of charge",
        "Where the time is spent",
        "is gone through",
        "multisine",
    ):
        assert words in shown
    # Self-contained: nothing is fetched.
    assert "http" not in shown and "<script" not in shown
    assert "nan" not in shown.partition("</style>")[2]


def test_a_pre_test_has_a_page_of_what_is_known(directory: Path) -> None:
    path = directory / "first.toml"
    path.write_text("capacity_Ah = 2.0\nduration_s = 20000\n[limits]\ncurrent_A = [-4, 4]\nsoc = [0.1, 0.9]\n")
    status, _, complaints = call(path, "--out", directory / "first.csv", "--report", directory / "page.html", "--json")
    assert status == 0 and "no report" not in complaints
    assert "bounded pre-test" in (directory / "page.html").read_text()


def test_a_person_reads_what_to_expect(directory: Path) -> None:
    status, text, _ = call(written(directory), "--out", directory / "profile.csv")
    assert status == 0 and "predicted: SoC" in text and "log det" in text
    assert "of the asked SoC and current" in text and "capacity" in text


def test_without_a_model_a_pre_test_is_written(directory: Path) -> None:
    path = directory / "first.toml"
    path.write_text("capacity_Ah = 2.0\nduration_s = 20000\n[limits]\ncurrent_A = [-4, 4]\nsoc = [0.1, 0.9]\n")
    status, text, complaints = call(path, "--out", directory / "first.csv", "--json")
    assert status == 0 and json.loads(text)["pre_test"]
    assert "pre-test" in complaints and "initial_soc" in complaints
    assert read_profile(directory / "first.csv").time_s[-1] <= 20_000.0


@pytest.mark.parametrize(
    ("replaced", "by", "says"),
    [
        ("duration_s = 3000", "duration_s = 0", "duration is 0 s"),
        ("[-4, 4]", "[4, -4]", "current_A is 4..-4"),
        ("[2.5, 4.2]", "[3.0, 3.1]", "voltage_V is 3..3.1 V"),
        ('"drive_cycle"', '"chirp"', "signal is 'chirp'"),
        ('"model.json"', '"none.json"', "no such file"),
        ('"cycle.csv"', '"none.csv"', "no such file"),
        ("seed = 1", 'criterion = "discriminate"\nrivals = ["hysteresis", "relaxation"]', "runs is missing"),
        ("seed = 1", 'criterion = "discriminate"\nrivals = ["hysteresis", "none.json"]', "no such file"),
        ("seed = 1", "seed = ", "not valid TOML"),
        ("seed = 1", "rest_ration = 8", "'rest_ration' is unknown"),
    ],
)
def test_what_cannot_be_is_one_line_and_no_file(directory: Path, replaced: str, by: str, says: str) -> None:
    path = written(directory)
    path.write_text(path.read_text().replace(replaced, by))
    status, text, complaints = call(path, "--out", directory / "profile.csv")
    assert (status, text) == (2, "")
    assert says in complaints and complaints.count("\n") == 1
    assert not (directory / "profile.csv").exists()
