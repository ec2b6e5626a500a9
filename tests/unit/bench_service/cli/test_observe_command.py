"""`bench-service observe`, called in this process: a module, its report, gains and spreads."""

import json
from pathlib import Path

import numpy as np
import pytest

from bench_service.cli.main import main
from models.module.models import ModuleModel
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic

_HEADER = "Test Time / s,Current / A,Voltage / V,Surface Temperature / degC,soc_ref"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    network = fit_network(
        [synthetic.run(5000, seed=2, noise_V=1e-3)], capacity_Ah=synthetic.CAPACITY_AH, structure="full"
    ).network
    path = tmp_path_factory.mktemp("observer") / "model.json"
    path.write_text(json.dumps(network.to_json()))
    return path


def _write(path: Path, in_series: int, parallel: int) -> Path:
    run = synthetic.run(1500, seed=11, noise_V=1e-3)
    assert run.soc_ref is not None
    volts = in_series * run.voltage_V + 0.01 * parallel * run.current_A
    columns = np.column_stack([run.time_s, parallel * run.current_A, volts, run.temperature_degC, run.soc_ref])
    lines = [",".join(f"{value:.6f}" for value in row) for row in columns]
    path.write_text("\n".join([_HEADER, *lines]))
    return path


@pytest.mark.proof
def test_a_module_is_observed_and_the_page_shows_the_choice(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, module, page = _write(tmp_path / "run.csv", 4, 2), tmp_path / "module.json", tmp_path / "page.html"
    module.write_text(json.dumps(ModuleModel("S2", 4, 2, (0.01, 0.01)).to_json()))
    arguments = ["observe", model, run, "--module", module, "--report", page, "--json"]
    assert main([str(argument) for argument in arguments]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["runs"][0]["soc_rmse"] < 0.01
    assert answer["report"] == str(page)
    html = page.read_text()
    assert "Convergence against accuracy" in html and "Stability" in html and "may settle" in html
    assert "of which nothing is proven" in html
    assert html.count("<figure>") == 5
    assert "http" not in html


def test_without_the_module_model_the_alarm_says_why(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = _write(tmp_path / "run.csv", 4, 2)
    assert main(["observe", str(model), str(run), "--json"]) == 0
    assert "does not fit" in json.loads(capsys.readouterr().out)["runs"][0]["alarms"][0]


def test_the_gain_is_chosen_on_the_command_line(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, found = _write(tmp_path / "run.csv", 1, 1), {}
    for given in ([], ["--gain", "kalman"], ["--gain", "steady"]):
        assert main(["observe", str(model), str(run), "--initial-soc", "0.4", *given, "--json"]) == 0
        found[given[-1] if given else ""] = json.loads(capsys.readouterr().out)
    assert [each["gain"] for each in found.values()] == ["kalman", "kalman", "steady"]
    assert all(each["stability"].startswith("not certified") for each in found.values())
    assert "does not hold for it" in found["kalman"]["stability"] != found["steady"]["stability"]
    assert found[""]["runs"] == found["kalman"]["runs"] != found["steady"]["runs"]
    assert all(set(each) == set(found[""]) for each in found.values())
    # From 20 points off over 25 minutes; the steady gains, made for sensors that may be off, follow more of the noise.
    assert found["kalman"]["runs"][0]["soc_rmse"] < 0.02 and found["steady"]["runs"][0]["soc_rmse"] < 0.03


def test_the_estimates_are_shown_with_and_without_a_reference(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    known = _write(tmp_path / "known.csv", 1, 1)
    bare = tmp_path / "bare.csv"
    bare.write_text("\n".join(line.rpartition(",")[0] for line in known.read_text().splitlines()))
    shown = {}
    for run in (known, bare):
        assert main(["observe", str(model), str(run), "--initial-soc", "0.4"]) == 0
        shown[run.stem] = capsys.readouterr().out
        assert "stability: not certified" in shown[run.stem]
    assert "SoC RMSE" in shown["known"] and "a reference" not in shown["known"]
    assert "SoC RMSE" not in shown["bare"] and "a column soc_ref" in shown["bare"]
    row = lambda name: next(line.split() for line in shown[name].splitlines() if line.split()[:1] == [name])  # noqa: E731
    assert row("bare")[1:] == row("known")[1:4]


def test_a_declared_spread_of_the_cells_widens_the_band(
    model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, module = _write(tmp_path / "run.csv", 4, 2), tmp_path / "module.json"
    module.write_text(json.dumps(ModuleModel("S2", 4, 2, (0.01, 0.01)).to_json()))
    stds = []
    for spread in ("soc=0.001,capacity=0.001,resistance=0.001", "soc=0.05,capacity=0.05,resistance=0.2"):
        out = tmp_path / "soc.csv"
        arguments = ["observe", model, run, "--module", module, "--cell-spread", spread, "--out", out, "--json"]
        assert main([str(argument) for argument in arguments]) == 0
        capsys.readouterr()
        lines = out.read_text().splitlines()
        stds.append(float(lines[-1].split(",")[lines[0].split(",").index("soc_std")]))
    assert stds[1] > 1.5 * stds[0]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--cell-spread", "soc=0.01"], "--module"),
        (["--module", "MODULE", "--cell-spread", "weight=0.01"], "weight"),
        (["--module", "MODULE", "--cell-spread", "soc=2"], "0..1"),
        (["--module", "MODULE", "--cell-spread", "soc"], "name=value"),
    ],
)
def test_a_spread_that_is_none_is_refused_in_one_line(
    given: list[str], told: str, model: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, module = _write(tmp_path / "run.csv", 4, 2), tmp_path / "module.json"
    module.write_text(json.dumps(ModuleModel("S2", 4, 2, (0.01, 0.01)).to_json()))
    arguments = [str(module) if each == "MODULE" else each for each in given]
    try:
        status = main(["observe", str(model), str(run), *arguments])
    except SystemExit as stop:
        status = stop.code
    error = capsys.readouterr().err.strip()
    assert status == 2
    assert told in error.splitlines()[-1]
