"""The command line as users see it: processes, exit statuses, one line on standard error, one object in JSON."""

import json
import re
import signal
import socket
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_rig import CLI, answer, call, refusal, spawn

from bench_service.exchange import write_run
from tests.patience import LONG_S, PATIENCE_S

HEADER = "time_s,current_A,voltage_V,temperature_degC"

METRICS = {"rmse_mV", "mae_mV", "p95_mV", "max_mV", "bias_mV", "nrmse", "n_samples"}


def save_run(path: Path, seed: int, *, sign: float = 1.0, soc: float = 0.5) -> Path:
    """Pulses on a cell of 20 mOhm and one RC pair, 1500 samples at 1 s."""
    rng = np.random.default_rng(seed)
    current_A = np.repeat(rng.choice([-2.0, -1.0, 0.0, 1.0, 2.0], 75), 20)
    time_s = np.arange(len(current_A), dtype=float)
    soc_ref = soc + np.concatenate([[0.0], np.cumsum(current_A[1:])]) / 3600 / 2.5
    polarisation_V = np.zeros(len(current_A))
    for k in range(1, len(current_A)):
        polarisation_V[k] = 0.95 * polarisation_V[k - 1] + 0.05 * 0.015 * current_A[k]
    voltage_V = 3.4 + 0.6 * soc_ref + 0.02 * current_A + polarisation_V + 5e-4 * rng.standard_normal(len(current_A))
    columns = {"time_s": time_s, "current_A": sign * current_A, "voltage_V": voltage_V}
    columns |= {"temperature_degC": np.full(len(time_s), 25.0), "soc_ref": soc_ref}
    write_run(path, columns, "csv")
    return path


def without_reference(run: Path, path: Path) -> Path:
    """Copy a run without its last column, the reference SoC."""
    path.write_text("\n".join(line.rsplit(",", 1)[0] for line in run.read_text().splitlines()))
    return path


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A model from two runs, and what `fit` said."""
    folder = tmp_path_factory.mktemp("fit")
    runs = [save_run(folder / f"train{k}.csv", k) for k in range(2)]
    held_out = save_run(folder / "held_out.csv", 9)
    model = folder / "model.json"
    options = ("--capacity-Ah", 2.5, "--structure", "minimal", "--out", model, "--json")
    return model, answer(spawn("fit", *runs, "--validate", held_out, *options, timeout_s=LONG_S))


def test_help_lists_the_commands() -> None:
    done = spawn("--help")
    assert done.returncode == 0
    listed = set(re.findall(r"^    ([a-z]+) ", done.stdout, re.MULTILINE))
    assert {"compare", "config", "export", "fit", "observe", "run", "serve", "simulate"} <= listed
    for command in listed:
        assert call(command, "--help").returncode == 0, command


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["fit"], ["fit", "a.csv", "--capacity-Ah", "zero"]])
def test_wrong_usage_is_one_line(arguments: list[str]) -> None:
    refusal(spawn(*arguments))


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf"])
def test_capacity_must_be_a_positive_number(value: str, tmp_path: Path) -> None:
    done = call("fit", "a.csv", f"--capacity-Ah={value}", "--out", tmp_path / "m.json")
    assert "--capacity-Ah" in refusal(done)


# --- config ------------------------------------------------------------------------------------------------


def test_config_init_writes_a_file_that_loads(tmp_path: Path) -> None:
    from bench_service.config import ServiceConfig, load_config

    assert answer(spawn("config", "init", "--json", cwd=tmp_path)) == {"file": "bench.toml"}
    assert load_config(tmp_path / "bench.toml", {}) == ServiceConfig()


def test_config_init_replaces_nothing_unasked(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text("# mine")
    assert "exists already" in refusal(spawn("config", "init", cwd=tmp_path))
    assert (tmp_path / "bench.toml").read_text() == "# mine"
    assert spawn("config", "init", "--force", cwd=tmp_path).returncode == 0


# --- simulate ----------------------------------------------------------------------------------------------


def start_simulator(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen([*CLI, "simulate", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM])
def test_simulator_announces_itself_and_ends_on_a_signal(end: signal.Signals) -> None:
    simulator = start_simulator()
    assert simulator.stdout is not None
    line = simulator.stdout.readline()
    found = re.fullmatch(r"listening on modbus-tcp://127\.0\.0\.1:(\d+)\n", line)
    assert found, line
    with socket.create_connection(("127.0.0.1", int(found[1])), timeout=PATIENCE_S):
        pass
    simulator.send_signal(end)
    rest, complaints = simulator.communicate(timeout=PATIENCE_S)
    assert (simulator.returncode, rest, complaints) == (0, "", "")


def test_simulator_answers_json() -> None:
    simulator = start_simulator(
        "--json", "--cell", "lfp", "--effects", "hysteresis=0.02,relaxation=0.008", "--lock-step"
    )
    assert simulator.stdout is not None
    said = json.loads(simulator.stdout.readline())
    assert said["state"] == "listening"
    assert said["address"].startswith("modbus-tcp://127.0.0.1:")
    simulator.terminate()
    assert simulator.communicate(timeout=PATIENCE_S) == ("", "")
    assert simulator.returncode == 0


def test_port_in_use() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        message = refusal(spawn("simulate", "--port", port))
    assert str(port) in message
    assert "choose another port" in message


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--effects", "gravity=1"], "unknown effect 'gravity'"),
        (["--effects", "hysteresis"], "does not read name=value"),
        (["--effects", "hysteresis=nan"], "not a finite number"),
        (["--map", "nowhere"], "nowhere"),
        (["--cell", "lead"], "--cell"),
        (["--lock-step", "--speed", "2"], "not allowed with"),
        (["--port", "70000"], "not a TCP port"),
        (["--initial-soc", "50"], "fraction"),
    ],
)
def test_simulator_refuses(arguments: list[str], reason: str) -> None:
    assert reason in refusal(call("simulate", *arguments))


# --- fit and compare ---------------------------------------------------------------------------------------


def test_fit_answers_the_contract(fitted: tuple[Path, dict[str, Any]]) -> None:
    model, said = fitted
    assert {"model", "structure", "n_samples", "n_local_models", "seconds", "train", "validation"} <= set(said)
    assert said["model"] == str(model)
    assert said["structure"] == "minimal"
    assert set(said["train"]) == METRICS
    assert said["train"]["rmse_mV"] < 2.0
    assert said["validation"]["rmse_mV"] < 3.0
    assert [each["run"] for each in said["runs"]["train"]] == ["train0", "train1"]
    assert json.loads(model.read_text())["kind"] == "local_model_network"


def test_compare_answers_the_contract(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, said = fitted
    page = tmp_path / "page.html"
    held_out = model.parent / "held_out.csv"
    compared = answer(call("compare", model, held_out, "--report", page, "--json"))
    assert {"overall", "runs", "noise_floor_mV", "where", "outside_training", "temperature"} <= set(compared)
    assert compared["overall"] == said["validation"]
    assert set(compared["runs"][0]) >= METRICS | {"run"}
    where = {"variable", "from", "to", "unit", "rmse_mV", "share_of_squared_error", "share_of_time"}
    assert where <= set(compared["where"][0])
    assert "held_out" in page.read_text()
    assert "http" not in page.read_text()


def test_compare_writes_both_voltages_with_the_band(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, _ = fitted
    held_out, series = model.parent / "held_out.csv", tmp_path / "series.csv"
    compared = answer(call("compare", model, held_out, "--out", series, "--json"))
    assert compared["file"] == str(series)
    header, first, *more = series.read_text().splitlines()
    assert header == "run,time_s,current_A,temperature_degC,soc,voltage_V,simulated_V,band_V,inside"
    assert len(more) == 1499 and first.split(",")[0].strip('"') == "held_out"
    *_, measured, simulated, band, inside = more[700].split(",")
    assert abs(float(measured) - float(simulated)) < 0.01 and 0.0 < float(band) < 0.05 and inside in ("0", "1")
    assert "directory" in refusal(call("compare", model, held_out, "--out", tmp_path / "no" / "series.csv"))


def test_compare_says_where_a_run_of_a_wrong_soc_begins(fitted: tuple[Path, dict[str, Any]]) -> None:
    model, said = fitted
    shifted = answer(call("compare", model, model.parent / "held_out.csv", "--initial-soc", "0.55", "--json"))
    assert shifted["overall_fitted_start"]["rmse_mV"] < said["validation"]["rmse_mV"] + 1.0
    found = shifted["runs"][0]["initial_soc"]
    assert abs(found["value"] - 0.5) < 0.01 and 0.0 < found["std"] < 0.02


def test_fit_doubts_where_its_runs_begin(tmp_path: Path) -> None:
    runs = [save_run(tmp_path / f"{k}.csv", k) for k in range(2)]
    model = tmp_path / "model.json"
    options = ("--capacity-Ah", 2.5, "--structure", "minimal", "--out", model, "--json")
    doubted = ("--initial-soc", "0.51,0.5", "--initial-soc-std", 0.01, "--coulombic-efficiency", 0.999)
    said = answer(call("fit", *runs, *doubted, *options))
    first, second = (each["initial_soc"] for each in said["runs"]["train"])
    # They contradict each other; what both share is anybody's guess.
    assert abs(first["value"] - second["value"]) < 0.002
    assert abs(first["std"] - 0.01 / 2**0.5) < 0.001
    assert json.loads(model.read_text())["cell"]["efficiency"] == 0.999
    assert "above 0 and up to 1" in refusal(call("fit", *runs, "--coulombic-efficiency", 0, *options))


def test_runs_of_one_name_are_told_apart(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, _ = fitted
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        save_run(tmp_path / folder / "a.csv", 3)
    compared = answer(call("compare", model, tmp_path / "first" / "a.csv", tmp_path / "second" / "a.csv", "--json"))
    assert [each["run"] for each in compared["runs"]] == ["first/a", "second/a"]


def test_a_wrong_initial_soc_shows_in_the_error(fitted: tuple[Path, dict[str, Any]]) -> None:
    model, said = fitted
    shifted = answer(call("compare", model, model.parent / "held_out.csv", "--initial-soc", "0.6", "--json"))
    assert shifted["overall"]["rmse_mV"] > said["validation"]["rmse_mV"] + 20.0


def test_compare_prints_tables(fitted: tuple[Path, dict[str, Any]]) -> None:
    model, _ = fitted
    done = call("compare", model, model.parent / "held_out.csv")
    assert done.returncode == 0
    assert done.stderr == ""
    assert "held_out" in done.stdout
    assert "RMSE mV" in done.stdout


def test_compare_refuses_as_many_soc_as_do_not_fit(fitted: tuple[Path, dict[str, Any]]) -> None:
    model, _ = fitted
    runs = [model.parent / f"train{k}.csv" for k in range(2)]
    assert "3 values for 2 run(s)" in refusal(call("compare", model, *runs, "--initial-soc", "0.1,0.2,0.3"))


def test_compare_needs_an_initial_soc(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, _ = fitted
    bare = without_reference(model.parent / "held_out.csv", tmp_path / "bare.csv")
    assert "--initial-soc" in refusal(call("compare", model, bare))
    assert answer(call("compare", model, bare, "--initial-soc", "0.5", "--json"))["overall"]["rmse_mV"] < 5.0


def test_observe_answers_the_contract(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, _ = fitted
    out = tmp_path / "soc.csv"
    arguments = ("observe", model, model.parent / "held_out.csv", "--initial-soc", "0.3", "--out", out, "--json")
    observed = answer(call(*arguments))
    assert {"runs", "innovation_rms_mV", "us_per_step"} <= set(observed)
    run = observed["runs"][0]
    assert set(run) >= {"run", "soc_rmse", "soc_max_error", "soc_end_error", "converged_after_s", "coverage_95"}
    assert run["converged_after_s"] < 600.0
    assert run["soc_rmse"] < 0.02
    lines = out.read_text().splitlines()
    assert lines[0] == "run,time_s,soc,soc_std,model_voltage_V,innovation_V,smoothed_soc,smoothed_soc_std"
    assert len(lines) == 1501


def test_observe_needs_no_reference(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, _ = fitted
    bare = without_reference(model.parent / "held_out.csv", tmp_path / "bare.csv")
    done = call("observe", model, bare, "--json")
    run = answer(done)["runs"][0]
    assert run.pop("run") == "bare"
    after = run.pop("smoothed")
    assert after.pop("initial_soc")["std"] > 0.0 and set(after.values()) == {None}
    assert {name for name, value in run.items() if value is not None} <= {"alarms", "current_offset_A", "capacity_Ah"}
    assert "starts at 0.5" in done.stderr


@pytest.mark.parametrize(
    ("content", "reason"),
    [("{", "not valid JSON"), ("[]", "not a model document"), ('{"kind": "local_model_network"}', "schema version")],
)
def test_compare_refuses_what_is_no_model(content: str, reason: str, tmp_path: Path) -> None:
    model = tmp_path / "m.json"
    model.write_text(content)
    assert reason in refusal(call("compare", model, save_run(tmp_path / "a.csv", 0)))


def test_missing_model(tmp_path: Path) -> None:
    assert "no such file" in refusal(call("compare", tmp_path / "m.json", save_run(tmp_path / "a.csv", 0)))


# --- bad runs ----------------------------------------------------------------------------------------------


def fit_refusal(tmp_path: Path, run: Path, *options: object) -> str:
    """Why `fit` refuses a run; it leaves no model behind."""
    out = tmp_path / "m.json"
    message = refusal(call("fit", run, "--capacity-Ah", 2.5, "--out", out, *options))
    assert not out.exists()
    return message


def test_run_with_wrong_columns(tmp_path: Path) -> None:
    run = tmp_path / "a.csv"
    run.write_text("t,i,u,temp\n0,0,3.7,25\n1,0,3.7,25\n")
    message = fit_refusal(tmp_path, run)
    assert "needs time_s (or 'Test Time / s')" in message
    assert "'t', 'i', 'u', 'temp'" in message


def test_run_with_wrong_sign(tmp_path: Path) -> None:
    run = save_run(tmp_path / "a.csv", 0, sign=-1.0)
    out = tmp_path / "m.json"
    message = refusal(spawn("fit", run, "--capacity-Ah", 2.5, "--out", out))
    assert "--current-sign discharge-positive" in message
    assert not out.exists()


def test_current_sign_settles_the_sign(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, said = fitted
    run = save_run(tmp_path / "held_out.csv", 9, sign=-1.0)
    settled = answer(call("compare", model, run, "--current-sign", "discharge-positive", "--json"))
    assert settled["overall"]["rmse_mV"] == pytest.approx(said["validation"]["rmse_mV"])


def test_run_without_any_movement(tmp_path: Path) -> None:
    run = tmp_path / "a.csv"
    run.write_text("\n".join([HEADER + ",soc_ref", *(f"{k},0,3.7,25,0.5" for k in range(500))]))
    assert "current never exceeds" in fit_refusal(tmp_path, run)


def test_missing_run(tmp_path: Path) -> None:
    assert "no such file" in fit_refusal(tmp_path, tmp_path / "nowhere.csv")


def test_unknown_structure(tmp_path: Path) -> None:
    run = save_run(tmp_path / "a.csv", 0)
    assert "'grand' is unknown" in fit_refusal(tmp_path, run, "--structure", "grand")


def test_output_that_cannot_be_written_is_refused_before_the_work(tmp_path: Path) -> None:
    run = save_run(tmp_path / "a.csv", 0)
    done = call("fit", run, "--capacity-Ah", 2.5, "--out", tmp_path / "nowhere" / "m.json")
    assert "does not exist" in refusal(done)


def test_simulate_no_faster_than_the_machine_can() -> None:
    assert "speed is 1e+300" in refusal(call("simulate", "--speed", "1e300"))


def test_not_a_number_in_a_model_is_refused(fitted: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    document = json.loads(fitted[0].read_text())
    document["cell"]["capacity_Ah"] = float("nan")
    (tmp_path / "damaged.json").write_text(json.dumps(document))
    run = save_run(tmp_path / "run.csv", 9)
    for command in ("compare", "observe"):
        assert "NaN is not a JSON number" in refusal(call(command, tmp_path / "damaged.json", run))


@pytest.fixture(scope="module")
def bounded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A bounded model without hysteresis, and what `fit` said."""
    folder = tmp_path_factory.mktemp("bounded")
    run, model = save_run(folder / "train.csv", 0), folder / "model.json"
    options = ("--capacity-Ah", 2.5, "--structure", "bounded", "--without", "hysteresis", "--out", model, "--json")
    return model, answer(call("fit", run, *options))


def test_a_bounded_model_says_what_it_is_made_of(bounded: tuple[Path, dict[str, Any]]) -> None:
    model, said = bounded
    assert said["structure"] == "bounded" and said["compared"] == []
    assert {name for term in said["terms"] for name in term["effects"]} <= {
        "charge_discharge_asymmetry",
        "charge_transfer",
        "relaxation",
    }
    assert any(term["signal"] == "current" or "scaled_current" in term["signal"] for term in said["terms"])
    assert said["train"]["rmse_mV"] < said["expected_rmse_mV"] < 1.3 * said["train"]["rmse_mV"]
    choices = json.loads(model.read_text())["record"]["choices"]
    assert choices["terms"] == said["terms"] and choices["without"] == ["hysteresis"]
    assert choices["expected_rmse_mV"] == said["expected_rmse_mV"]


def test_a_page_states_the_error_to_be_expected(bounded: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    model, said = bounded
    answer(call("compare", model, model.parent / "train.csv", "--report", tmp_path / "page.html", "--json"))
    expected = f"{said['expected_rmse_mV']:.2f} mV were expected on runs that it did not see"
    assert expected in (tmp_path / "page.html").read_text()


def test_auto_is_the_default_and_names_its_rivals(tmp_path: Path) -> None:
    run, model = save_run(tmp_path / "train.csv", 0), tmp_path / "model.json"
    done = call("fit", run, "--capacity-Ah", 2.5, "--out", model)
    assert done.returncode == 0 and "expected on runs it did not see" in done.stdout
    choices = json.loads(model.read_text())["record"]["choices"]
    rivals = [each["structure"] for each in choices.get("compared", [])]
    assert rivals in ([], ["bounded", "searched", "full", "minimal"])
    assert ("took the" in done.stdout) == bool(rivals)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("--without", "gravity"), "effect gravity cannot be left out"),
        (("--without", "hysteresis", "--structure", "full"), "use --structure bounded"),
        (("--without", "hysteresis,"), "empty name"),
    ],
)
def test_what_cannot_be_left_out_is_refused(options: tuple[str, ...], reason: str, tmp_path: Path) -> None:
    assert reason in fit_refusal(tmp_path, save_run(tmp_path / "a.csv", 0), *options)


@pytest.mark.parametrize("command", ["serve", "run"])
def test_a_data_directory_that_is_a_file_is_bad_input(command: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "bench.toml").write_text(f"data_dir = '{tmp_path / 'file'}'\n")
    (tmp_path / "p.csv").write_text("time_s,current_A\n0,0\n10,0\n")
    playing = ("p.csv", "--bench", "sim", "--out", "r.csv") if command == "run" else ("--port", 0)
    assert "is not a directory" in refusal(spawn(command, *playing, cwd=tmp_path))


def test_a_model_of_one_state_of_charge_says_so(tmp_path: Path) -> None:
    """Pulses that cancel: the fit is good, and good for nothing else."""
    rng = np.random.default_rng(5)
    current_A = np.tile(np.repeat([1.0, -1.0, 0.0, 0.0], 5), 30)
    soc_ref = 0.5 + np.cumsum(current_A) / 3600 / 2.5
    voltage_V = 3.4 + 0.6 * soc_ref + 0.02 * current_A + 5e-4 * rng.standard_normal(len(current_A))
    columns = {"time_s": np.arange(len(current_A), dtype=float), "current_A": current_A, "voltage_V": voltage_V}
    columns |= {"temperature_degC": np.full(len(current_A), 25.0), "soc_ref": soc_ref}
    write_run(tmp_path / "one.csv", columns, "csv")
    options = ("--capacity-Ah", 2.5, "--structure", "minimal", "--out", tmp_path / "m.json", "--json")
    done = call("fit", tmp_path / "one.csv", *options)
    answer(done)
    assert "cover the state of charge from 0.500 to 0.501 only" in done.stderr
