"""`bench-service trend`, called in this process: a model and runs in, one object and a page out."""

import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.cli.main import main
from bench_service.exchange import write_run
from models.diagnosis import memory_to_json
from models.network.model_record import ModelRecord
from tests.unit.models.diagnosis.cells import simple_network
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs
from tests.unit.models.diagnosis.trend.test_trend import cycle
from tests.unit.models.hand_network import CAPACITY_AH


def call(*arguments: object) -> tuple[int, str, str]:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as complaints:
        status = main(["trend", *map(str, arguments)])
    return status, out.getvalue(), complaints.getvalue()


def written(folder: Path, number: int) -> Path:
    run = cycle(number)
    columns: dict[str, np.ndarray[Any, Any]] = {
        "time_s": run.time_s, "current_A": run.current_A, "voltage_V": run.voltage_V,
        "temperature_degC": run.temperature_degC,
    }  # fmt: skip
    path = folder / f"cycle{number}.csv"
    write_run(path, columns, "csv")
    return path


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """A model that knows its training runs, a young and an old cycle."""
    folder = tmp_path_factory.mktemp("life")
    network = replace(simple_network(CAPACITY_AH), record=ModelRecord(diagnosis=memory_to_json(known_runs())))
    model = folder / "model.json"
    model.write_text(json.dumps(network.to_json()))
    runs = [written(folder, number) for number in (0, 15)]
    return model, runs


def test_a_series_is_followed_and_drawn(files: tuple[Path, list[Path]], tmp_path: Path) -> None:
    model, runs = files
    page = tmp_path / "life.html"
    status, text, complaints = call(model, *runs, "--initial-soc", SOC, "--report", page, "--json")
    assert (status, complaints) == (0, "")
    young, old = json.loads(text)["runs"]
    assert young["verdict"] == "nothing_missing" and young["findings"] == []
    assert young["capacity_Ah"]["value"] == pytest.approx(CAPACITY_AH, rel=0.05)
    assert old["capacity_Ah"]["value"] == pytest.approx(0.85 * CAPACITY_AH, rel=0.05)
    assert "capacity" in {each["effect"] for each in old["findings"]}
    drawn = page.read_text(encoding="utf-8")
    assert drawn.count("<figure>") == 4 and "capacity" in drawn
    assert json.loads(text)["forecast"] is None


def test_places_and_the_end_are_taken(files: tuple[Path, list[Path]], tmp_path: Path) -> None:
    model, runs = files
    series = [runs[0], written(tmp_path, 1), written(tmp_path, 14), runs[1]]
    status, text, _ = call(model, *series, "--initial-soc", SOC, "--at", "1,2,30,31", "--end", 0.9, "--json")
    assert status == 0
    ahead = json.loads(text)["forecast"]
    assert (ahead["unit"], ahead["end_Ah"]) == ("cycle", pytest.approx(0.9 * CAPACITY_AH))
    status, _, complaints = call(model, *series, "--initial-soc", SOC, "--at", "1,2,30", "--json")
    assert status == 2 and "--at" in complaints


def test_a_person_reads_a_table(files: tuple[Path, list[Path]]) -> None:
    model, runs = files
    status, text, _ = call(model, runs[0], "--initial-soc", SOC)
    assert status == 0
    assert "nothing" in text and "capacity / Ah" in text


def test_each_run_needs_a_start(files: tuple[Path, list[Path]]) -> None:
    model, runs = files
    status, text, complaints = call(model, *runs, "--initial-soc", "0.5,0.5,0.5", "--json")
    assert (status, text) == (2, "")
    assert "--initial-soc" in complaints and complaints.count("\n") == 1
