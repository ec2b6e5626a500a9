"""bench.toml and the environment."""

import re
from pathlib import Path

import pytest

from bench_service.config import ConfigError, ServiceConfig, WebhookConfig, example_config, load_config, parse_config
from simulators.catalogue import CELLS

LIMITS = "limits = { voltage_V = [2.5, 4.2], current_A = [-5, 5], temperature_degC = [0, 45] }"


def test_without_a_file_there_is_one_simulated_bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    config = load_config(environ={})
    assert list(config.bench) == ["sim"]
    assert config.bench["sim"].simulate is not None and config.bench["sim"].simulate.lock_step
    assert config.data_dir == Path("bench-data")


def test_the_example_says_the_defaults() -> None:
    assert parse_config(example_config()) == ServiceConfig()


def test_the_examples_of_a_webhook_are_taken() -> None:
    notebook = (Path(__file__).parents[3] / "docs" / "notebook.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```toml\n(\[webhook\].*?)```", notebook, re.DOTALL)
    config = parse_config(shown).webhook
    assert config is not None and config.secret is not None and f"BENCH_SECRET='{config.secret}'" in notebook
    assert config.secret in example_config()


def test_the_example_explains_every_key() -> None:
    keys = {line.split("=")[0].strip("# ") for line in example_config().splitlines() if "=" in line}
    webhook = WebhookConfig(url="http://127.0.0.1:1/")
    tables = {"bench", "limits", "simulate", "url", "chamber", "webhook", "readers"}
    for model in (ServiceConfig(), ServiceConfig().bench["sim"], ServiceConfig().bench["sim"].limits, webhook):
        assert set(type(model).model_fields) - tables <= keys


@pytest.mark.parametrize("cell", sorted(CELLS))
def test_a_simulated_bench_has_the_limits_of_its_cell(cell: str) -> None:
    bench = parse_config(f"[bench.a]\nsimulate = {{cell = '{cell}'}}\nlimits = {{soc = [0.2, 0.8]}}").bench["a"]
    assert bench.capacity_Ah == CELLS[cell].parameters.capacity_Ah
    for name in ("voltage_V", "current_A", "temperature_degC"):
        assert getattr(bench.limits, name) == getattr(CELLS[cell].limits, name)
    assert bench.limits.soc == (0.2, 0.8)


def test_a_simulated_capacity_counts_as_nominal_unless_stated() -> None:
    bench = parse_config(
        "[bench.a]\nsimulate = {capacity_Ah = 5}\n[bench.b]\ncapacity_Ah = 2\n[bench.b.simulate]"
    ).bench
    assert bench["a"].capacity_Ah == 5.0 and bench["b"].capacity_Ah == 2.0


def test_a_file_of_the_working_directory_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text('[bench.left]\nurl = "modbus-tcp://10.0.0.7:502"\ncapacity_Ah = 5\n' + LIMITS)
    config = load_config(environ={})
    assert config.bench["left"].url == "modbus-tcp://10.0.0.7:502"
    assert config.bench["left"].capacity_Ah == 5.0


def test_the_environment_wins_over_the_file(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_text('data_dir = "here"\n')
    assert load_config(tmp_path / "b.toml", {"BENCH_DATA_DIR": "/there"}).data_dir == Path("/there")
    with pytest.raises(ConfigError, match="environment: BENCH_DATA_DIR: is empty"):
        load_config(tmp_path / "b.toml", {"BENCH_DATA_DIR": " "})
    assert load_config(tmp_path / "b.toml", {}).worker_nice == 19
    assert load_config(tmp_path / "b.toml", {"BENCH_WORKER_NICE": "5"}).worker_nice == 5
    for text in ("-1", "20", "much", ""):
        with pytest.raises(ConfigError, match="environment: BENCH_WORKER_NICE: is .*from 0 to 19"):
            load_config(tmp_path / "b.toml", {"BENCH_WORKER_NICE": text})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("data_dir = ", "b.toml: not valid TOML"),
        ("datadir = 'x'", "b.toml: datadir: unknown key"),
        ("[bench.a]\nsimulate = {}\nlimits = {voltage_v = [2.5, 4.2]}", "bench.a.limits.voltage_v: unknown key"),
        ("[bench.a]\nsimulate = {}\nlimits = {voltage_V = [4.2, 2.5]}", "low 4.2 must be below high 2.5"),
        ("[bench.a]\nsimulate = {}\nlimits = {current_A = ['-9', 9]}", "bench.a.limits.current_A.0: must be a number"),
        ("[bench.a]\nsimulate = {}\nlimits = {current_A = [-9, nan]}", "bench.a.limits.current_A.1: must be finite"),
        ("[bench.a]\nsimulate = {}\nlimits = {soc = [0, 100]}", "fraction between 0 and 1"),
        ("[bench.a]\nsimulate = {}\ncapacity_Ah = true", "bench.a.capacity_Ah: must be a number"),
        ("[bench.a]\nsimulate = {}\ncapacity_Ah = inf", "bench.a.capacity_Ah: must be finite"),
        ("[bench.a]\nsimulate = {}\nwatchdog_s = 30", "external_interlock = true"),
        ("[bench.a]\nsimulate = {lock_step = 1}", "bench.a.simulate.lock_step"),
        ("[bench.a]\n", "bench.a: give exactly one of 'url'"),
        ("[bench.a]\nsimulate = {}\nurl = 'modbus-tcp://h:1'", "give exactly one of 'url'"),
        ("[bench.a]\nurl = 'modbus-tcp://h:1'", "no default limits.voltage_V, limits.current_A"),
        ("[bench.a]\nurl = 'modbus-tcp://h:1'\n" + LIMITS, "bench.a: a real cell has no default capacity_Ah"),
        ("[bench.a]\nurl = 'http://h:1'", "bench.a.url: http://h:1: the address of a cycler is"),
        ("[bench.a]\nurl = 'modbus-tcp://h:99999'", "Port out of range"),
        ("[bench.'../a']\nsimulate = {}", "bench.../a"),
        ("bench = {}", "bench: needs at least one bench"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        parse_config(text, "b.toml")
    assert message in str(refusal.value) and str(refusal.value).startswith("b.toml: ")
    assert "\n" not in str(refusal.value)


def test_a_missing_file_names_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such file; 'bench-service config init'"):
        load_config(tmp_path / "none.toml", {})


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(tmp_path / "b.toml", {})


def test_the_gain_of_live_observers_is_one_of_two() -> None:
    text = "[bench.a]\nsimulate = {}\nobserver_gain = '%s'"
    assert parse_config(text % "steady").bench["a"].observer_gain == "steady"
    with pytest.raises(ConfigError, match="bench.a.observer_gain: .*'kalman' or 'steady'"):
        parse_config(text % "best")
