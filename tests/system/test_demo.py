"""The main job as a newcomer starts it: `bench-service demo` in processes of its own, over real Modbus TCP."""

import contextlib
import hashlib
import json
import os
import re
import selectors
import signal
import sqlite3
import subprocess
import sys
import time
import urllib.request
from argparse import Namespace
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from bench_service.cli.commands.demo import stays_up
from bench_service.store.samples import SampleReader
from bench_service.streams import OBSERVER
from tests.patience import LONG_S, wait_for

pytestmark = pytest.mark.timeout(4 * LONG_S)

KEYS = {"runs", "samples", "missed_ticks", "model_chain", "hidden_effect", "diagnosed_effect", "soc_rmse", "seconds"}


class Run(NamedTuple):
    """One run as the metadata have it."""

    id: str
    state: str
    n_samples: int | None
    sha256: str | None
    initial_soc: float
    capacity_Ah: float


class Demos(NamedTuple):
    """Two demos of different seeds: a sealed game for a program, and one on a terminal."""

    answer: dict[str, Any]
    game: Path
    text: str
    page: str
    terminal: Path


def start(data: Path, *options: str, stdout: int = subprocess.PIPE) -> subprocess.Popen[bytes]:
    """Start a demo in a folder that the environment names; its coverage is not measured, which takes twice the time."""
    command = [sys.executable, "-m", "bench_service.cli", "demo", *options]
    foreign = ("COVERAGE_PROCESS_CONFIG", "COVERAGE_PROCESS_START")
    environment = {name: value for name, value in os.environ.items() if name not in foreign}
    environment["BENCH_DATA_DIR"] = str(data)
    return subprocess.Popen(command, stdout=stdout, stderr=subprocess.PIPE, env=environment)


def metadata(data: Path, query: str) -> list[tuple[Any, ...]]:
    """Rows of `meta.sqlite`, read by SQLite alone; none while there is no such table yet."""
    try:
        with contextlib.closing(sqlite3.connect(f"file:{data / 'meta.sqlite'}?mode=ro", uri=True)) as store:
            return store.execute(query).fetchall()
    except sqlite3.OperationalError:
        return []


def runs(data: Path) -> list[Run]:
    columns = ", ".join(f'"{name}"' for name in Run._fields)
    return [Run(*row) for row in metadata(data, f"select {columns} from run order by created_utc")]


def until(condition: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    def goes_on() -> bool:
        assert process.poll() is None, process.communicate()
        return condition()

    wait_for(goes_on, "the demo has come so far", LONG_S, every_s=0.05)


def read_terminal(terminal: int, until_text: str) -> str:
    """What a person sees up to some text."""
    seen, deadline_s = "", time.monotonic() + LONG_S
    with selectors.DefaultSelector() as selector:
        selector.register(terminal, selectors.EVENT_READ)
        while until_text not in seen:
            assert selector.select(max(deadline_s - time.monotonic(), 0.0)), f"not seen in time; so far:\n{seen}"
            seen += os.read(terminal, 65536).decode()
    return seen


def play_until_ended(data: Path) -> int:
    """Play the first run, then end the demo as a service manager does."""
    process = start(data, "--seed", "2", "--exit")
    with ended(process):
        until(lambda: any(run.state == "completed" for run in runs(data)), process)
        process.send_signal(signal.SIGTERM)
        _, complaint = process.communicate(timeout=LONG_S)
        assert complaint == b"error: interrupted\n"
        return process.returncode


@contextlib.contextmanager
def ended(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Leave no process behind, whatever a test finds."""
    try:
        yield
    finally:
        if process.poll() is None:
            process.terminate()
            process.communicate(timeout=LONG_S)


@pytest.fixture(scope="module")
def demos(tmp_path_factory: pytest.TempPathFactory) -> Demos:
    folder = tmp_path_factory.mktemp("demo")
    game, terminal = folder / "game", folder / "terminal"
    master, slave = os.openpty()
    try:
        for_person = start(terminal, "--seed", "1", stdout=slave)
        for_program = start(game, "--hidden-effect", "series_resistance", "--seed", "4", "--exit", "--json")
        with ended(for_person), ended(for_program):
            text = read_terminal(master, "until Ctrl-C.")
            with urllib.request.urlopen(text.split("Watch it at ")[1].split()[0], timeout=LONG_S) as answer:
                page = answer.read().decode()
            for_person.send_signal(signal.SIGINT)
            _, complaint = for_person.communicate(timeout=LONG_S)
            assert (for_person.returncode, complaint) == (0, b"")
            output, complaint = for_program.communicate(timeout=LONG_S)
            assert (for_program.returncode, complaint) == (0, b"")
    finally:
        os.close(master)
        os.close(slave)
    assert output.count(b"\n") == 1
    return Demos(json.loads(output), game, text, page, terminal)


def test_a_program_gets_the_contract_s_answer(demos: Demos) -> None:
    answer = demos.answer
    assert answer.keys() >= KEYS
    assert answer["state"] == "completed"
    assert answer["missed_ticks"] == 0
    assert answer["model_chain"][-1]["validation_rmse_mV"] <= 5.0
    assert answer["runs"] == [run.id for run in runs(demos.game)]
    assert len(answer["runs"]) == 4


def test_a_hidden_contact_resistance_is_named_sized_and_added(demos: Demos) -> None:
    answer = demos.answer
    # The seal was said before; what it closes is shown after.
    assert hashlib.sha256(answer["seal"]["contents"].encode()).hexdigest() == answer["seal"]["sha256"]
    assert answer["seal"]["contents"].startswith(f"series_resistance={answer['hidden_size']['value']!r} ")
    assert answer["verdict"] == "missing"
    assert answer["hidden_effect"] == answer["diagnosed_effect"] == "series_resistance"
    first, second = answer["model_chain"]
    assert second["effect"] == "series_resistance"
    assert second["validation_rmse_mV"] < 0.5 * first["validation_rmse_mV"]
    found = second["parameters"]["resistance_Ohm"]["value"]
    assert found == pytest.approx(answer["hidden_size"]["value"], rel=0.15)


@pytest.mark.proof
def test_what_a_structure_lacks_is_named_and_added(tmp_path: Path) -> None:
    options = ("--hidden-effect", "random", "--mode", "structure", "--cell", "lfp", "--seed", "2", "--exit", "--json")
    with ended(process := start(tmp_path, *options)):
        output, _ = process.communicate(timeout=LONG_S)
    answer = json.loads(output)
    (asked,) = metadata(tmp_path, "select request from campaign")[0]
    assert json.loads(asked)["without"] == ["charge_transfer", "hysteresis", "relaxation"]
    assert answer["hidden_size"]["before"] == 0.0
    assert (answer["verdict"], answer["diagnosed_effect"]) == ("missing", answer["hidden_effect"])
    before, after = (each["validation_rmse_mV"] for each in answer["model_chain"])
    assert after < 0.6 * before


def test_an_effect_that_cannot_be_hidden_is_refused_before_anything_starts(tmp_path: Path) -> None:
    _, complaint = (refused := start(tmp_path / "data", "--hidden-effect", "phlogiston")).communicate(timeout=LONG_S)
    assert refused.returncode == 2
    assert b"phlogiston" in complaint
    assert b"series_resistance" in complaint
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("which", ["game", "terminal"])
def test_every_sample_is_stored(demos: Demos, which: str) -> None:
    data = getattr(demos, which)
    found = runs(data)
    assert {run.state for run in found} == {"completed"}
    with SampleReader(data) as reader:
        stored = [reader.read(run.id) for run in found]
    assert sum(each.n for each in stored) == sum(run.n_samples or 0 for run in found) >= 20_000
    if which == "game":
        assert sum(each.n for each in stored) == demos.answer["samples"]
    for each in stored:
        np.testing.assert_allclose(np.diff(each.columns["time_s"]), 1.0, atol=1e-9)
        assert not np.isnan(each.columns["voltage_V"]).any()


def test_the_live_observer_finds_the_state_of_charge_from_20_points_off(demos: Demos) -> None:
    run = runs(demos.terminal)[1]
    with SampleReader(demos.terminal) as reader:
        samples, observed = reader.read(run.id).columns, reader.read(run.id, OBSERVER).columns
    charge_As = np.cumsum(samples["current_A"][1:] * np.diff(samples["time_s"]))
    truth = run.initial_soc + np.concatenate([[0.0], charge_As]) / 3600.0 / run.capacity_Ah
    np.testing.assert_array_equal(observed["time_s"], samples["time_s"])
    error = observed["soc"] - truth
    (started,) = metadata(demos.terminal, f"select observer_initial_soc from run where id = '{run.id}'")[0]
    assert abs(started - run.initial_soc) == pytest.approx(0.2, abs=0.01)
    wrong = np.flatnonzero(np.abs(error) >= 0.03)
    converged = int(wrong[-1]) + 1 if len(wrong) else 0
    assert observed["time_s"][converged] < 600.0
    assert np.sqrt(np.mean(error[converged:] ** 2)) <= 0.01


@pytest.mark.proof
def test_the_same_seed_gives_the_same_samples_to_the_bit(demos: Demos, tmp_path: Path) -> None:
    with ended(process := start(tmp_path, "--seed", "1", "--exit", "--json")):
        output, _ = process.communicate(timeout=LONG_S)
    assert json.loads(output)["soc_rmse"] <= 0.01
    once, again = runs(tmp_path), runs(demos.terminal)
    assert [run.sha256 for run in once] == [run.sha256 for run in again]
    assert len({run.sha256 for run in once} - {None}) == 2
    with SampleReader(tmp_path) as one, SampleReader(demos.terminal) as other:
        for first, second in zip(once, again, strict=True):
            columns, same = one.read(first.id).columns, other.read(second.id).columns
            assert {name: values.tobytes() for name, values in columns.items()} == {
                name: values.tobytes() for name, values in same.items()
            }


def test_another_seed_gives_other_samples(demos: Demos) -> None:
    first, other = runs(demos.terminal)[0], runs(demos.game)[0]
    assert None not in (first.sha256, other.sha256)
    assert other.sha256 != first.sha256


@pytest.mark.proof
def test_an_ended_demo_leaves_nothing_running_and_keeps_what_it_measured(tmp_path: Path) -> None:
    assert play_until_ended(tmp_path) == 1
    assert metadata(tmp_path, "select state from campaign") == [("stopped",)]
    first, *rest = runs(tmp_path)
    assert first.state == "completed"
    assert all(run.state in ("stopped", "interrupted") for run in rest)
    with SampleReader(tmp_path) as reader:
        assert reader.n_rows(first.id) == first.n_samples


def test_a_person_sees_tables_and_the_page(demos: Demos) -> None:
    for words in ("samples stored", "run the fit never saw", "SoC error", str(demos.terminal)):
        assert words in demos.text.replace("\r\n", "")
    (error_mV,) = re.findall(r"run the fit never saw +([0-9.]+) mV", demos.text)
    assert float(error_mV) <= 5.0
    assert "<h1" in demos.page


@pytest.mark.parametrize(
    ("on_terminal", "leave", "as_json", "stays"),
    [(True, False, False, True), (True, True, False, False), (True, False, True, False), (False, False, False, False)],
)
def test_the_page_stays_only_for_a_person(on_terminal: bool, leave: bool, as_json: bool, stays: bool) -> None:
    assert stays_up(Namespace(exit=leave, json=as_json), on_terminal) is stays
