"""A module from the command line: identified, compared, observed."""

import json
from pathlib import Path

import pytest

from bench_service.cli.main import main
from tests.unit.models.module import synthetic_module as truth


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert main([str(each) for each in arguments]) == 0
    return json.loads(capsys.readouterr().out)


def test_it_is_identified_compared_and_observed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    train, judged, model = (
        truth.written(tmp_path / "a.csv", 1),
        truth.written(tmp_path / "b.csv", 2),
        tmp_path / "module.json",
    )
    of_module = ["--module", "--layout", f"{truth.SERIES}x{truth.PARALLEL}", "--structure", "minimal"]
    arguments = ["fit", train, "--validate", judged, "--capacity-Ah", truth.CAPACITY_AH, *of_module, "--out", model]
    fitted = told(capsys, *arguments, "--json")
    assert fitted["module"]["chosen"] == "S3" and fitted["module"]["weak_group"]["group"] == 2
    assert {"model", "structure", "n_samples", "n_local_models", "seconds", "train", "validation"} <= set(fitted)
    assert {"expected_rmse_mV", "usability", "runs"} <= set(fitted)
    compared = told(capsys, "compare", model, judged, "--json")
    assert [each["kind"] for each in compared["module"]["models"]] == ["S1", "S2", "S3", "S4"]
    assert compared["module"]["weak_group"]["group"] == 2
    assert compared["overall"]["rmse_mV"] == pytest.approx(fitted["validation"]["rmse_mV"], rel=0.2)
    page = tmp_path / "page.html"
    observed = told(capsys, "observe", model, judged, "--initial-soc", 0.4, "--report", page, "--json")
    assert observed["runs"][0]["soc_rmse"] < 0.03 and page.exists()
    assert main(["compare", str(model), str(judged), "--report", str(page)]) == 0
    text = capsys.readouterr().out
    assert "S3 (taken)" in text and "weak: group 2 is empty after" in text


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--layout", "3x2"], "--layout and --cell are of a module"),
        (["--module", "--layout", "3"], "'3' is no layout"),
        (["--module", "--layout", "4x2"], "the layout says 4 in series"),
        (["--module", "--cell", "none.json"], "none.json: no such file"),
    ],
)
def test_what_does_not_fit_is_said_in_one_line(
    given: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = truth.written(tmp_path / "a.csv", 1)
    arguments = ["fit", str(run), "--capacity-Ah", "4", *given, "--out", str(tmp_path / "m.json")]
    try:
        status = main(arguments)
    except SystemExit as stop:
        status = stop.code
    assert status == 2 and words in capsys.readouterr().err.splitlines()[-1]
