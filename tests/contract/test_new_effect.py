"""An effect that is added in one file is there for the service, the page, the command line and the diagnosis."""

import asyncio
import importlib
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

import models.effects
from bench_service.app import create_app
from bench_service.cli.main import main
from bench_service.config import ServiceConfig
from models.comparison.figures import compare
from models.data.timeseries import TimeSeries
from models.diagnosis import diagnose
from models.effects import effect, effects
from models.effects.input_correction import LiveCorrection, corrections_of
from models.effects.reading import Reading
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from tests.unit.models.diagnosis.cells import SOC, bare, measured

MADE_UP = '''
"""A voltage sensor that picks up the square of the current."""

from models.effects.effect import Effect, Parameter
from models.effects.reading import InputCorrection

EFFECT = Effect(
    name="made_up",
    title="Rectified pick-up",
    recognise="the voltage reads too much at large currents, on charge and on discharge alike",
    source="made up for a test",
    parameters=(Parameter("pick_up_V_per_A2", "V/A2", "what the sensor reads too much for each ampere squared"),),
    shows_over=("current_A",),
    slow=True,
    regressors=lambda view: view.run.current_A[view.index, None] ** 2,
    correction=InputCorrection(
        lambda read, values: read._replace(
            voltage_V=read.voltage_V - values["pick_up_V_per_A2"] * read.current_A**2
        )
    ),
)
'''
RELATED = MADE_UP.replace('name="made_up"', 'name="related", twin="voltage_offset", part_of=("soc_dependence",)')
PICK_UP = 0.0015
CELL = bare()
NETWORK = Structure(
    0,
    (InputChannel("soc", delay=1), InputChannel("current"), InputChannel("low_pass:1.5"), InputChannel("low_pass:25")),
    (PartitionAxis("soc", k_sigma=0.7),),
    1.0,
    name="bare",
)

Add = Callable[[str, str], None]


@contextmanager
def another_folder_of_effects(folder: Path) -> Iterator[Add]:
    """Effects may be written into a folder, as if it were the package's; they are gone afterwards."""
    added: list[str] = []

    def add(name: str, text: str) -> None:
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
        added.append(name)
        importlib.invalidate_caches()
        effects.cache_clear()

    models.effects.__path__.append(str(folder))
    try:
        yield add
    finally:
        models.effects.__path__.remove(str(folder))
        for name in added:
            sys.modules.pop(f"models.effects.{name}", None)
            vars(models.effects).pop(name, None)
        effects.cache_clear()


@pytest.fixture(scope="module")
def made_up(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with another_folder_of_effects(tmp_path_factory.mktemp("effects")) as add:
        add("made_up", MADE_UP)
        yield


@pytest.fixture(scope="module")
def network() -> LocalModelNetwork:
    fit = fit_network([measured(CELL, 1)], capacity_Ah=CELL.capacity_Ah, structure=NETWORK, initial_soc=[SOC], dt_s=1.0)
    return fit.network


def picked_up(run: TimeSeries) -> TimeSeries:
    return replace(run, voltage_V=run.voltage_V + PICK_UP * run.current_A**2)


def get(address: str, folder: Path) -> Any:
    """Ask the application itself: an effect in a folder of a test's is known in this process alone."""

    async def asked() -> httpx.Response:
        # The services themselves are not asked: what effects there are hangs on no store and no bench.
        transport = httpx.ASGITransport(create_app(ServiceConfig(data_dir=folder), services=object()))  # pyright: ignore[reportArgumentType]
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
            return await client.get(address)

    answer = asyncio.run(asked())
    assert answer.status_code == 200, answer.text
    return answer


@pytest.mark.usefixtures("made_up")
def test_the_catalogue_and_the_service_have_it(tmp_path: Path) -> None:
    assert effect("made_up").channel == "voltage"
    listed = {each["name"]: each for each in get("/api/v1/effects", tmp_path).json()["effects"]}
    assert set(listed) == set(effects())
    assert listed["made_up"]["title"] == "Rectified pick-up"
    # What the page draws its picture over, and what it writes behind a correction's size.
    assert listed["made_up"]["shows_over"] == ["current_A"]
    assert listed["made_up"]["parameters"][0]["unit"] == "V/A2"


def test_the_page_takes_what_it_knows_of_effects_from_the_service(tmp_path: Path) -> None:
    panel = get("/static/improve-panel.js", tmp_path).text
    assert "api.effects()" in panel
    for field in ("title", "shows_over", "parameters"):
        assert f"?.{field}" in panel


@pytest.mark.usefixtures("made_up")
def test_a_diagnosis_finds_it(network: LocalModelNetwork) -> None:
    train, run = measured(CELL, 1), picked_up(measured(CELL, 2))
    answer = diagnose(network, [run], [SOC], train=[train], train_soc=[SOC], mode="change")
    assert answer.verdict == "missing"
    first = answer.findings[0]
    assert first.effect == "made_up"
    assert first.parameters["pick_up_V_per_A2"].value == pytest.approx(PICK_UP, rel=0.1)
    assert "rectified pick-up" in first.explanation.lower()


@pytest.mark.usefixtures("made_up")
def test_the_command_line_adds_it_and_whoever_reads_a_run_corrects_it(
    network: LocalModelNetwork, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model, child = tmp_path / "MODEL.json", tmp_path / "MODEL2.json"
    model.write_text(json.dumps(network.to_json()), encoding="utf-8")
    train, run = (picked_up(measured(CELL, seed)) for seed in (1, 4))
    files = []
    for number, each in enumerate((train, run)):
        files.append(str(tmp_path / f"{number}.csv"))
        columns = [each.time_s, each.current_A, each.voltage_V, each.temperature_degC, each.ambient_degC]
        header = "time_s,current_A,voltage_V,temperature_degC,ambient_degC"
        np.savetxt(files[-1], np.column_stack(columns), delimiter=",", header=header, comments="")
    asked = ["add-effect", str(model), "made_up", "--train", files[0], "--validate", files[1], "--out", str(child)]
    assert main([*asked, "--initial-soc", str(SOC), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["effect"] == "made_up" and "columns were corrected" in told["remark"]
    assert told["parameters"]["pick_up_V_per_A2"]["value"] == pytest.approx(PICK_UP, rel=0.1)
    assert told["error_after_mV"] < 0.5 * told["error_before_mV"]

    better = LocalModelNetwork.from_json(json.loads(child.read_text(encoding="utf-8")))
    assert [each["effect"] for each in compare(better, [run], [SOC])["corrections"]] == ["made_up"]
    size = told["parameters"]["pick_up_V_per_A2"]["value"]
    sample = LiveCorrection(corrections_of(better.record), 1.0).step(Reading(2.0, 3.7, 25.0, 22.0))
    assert sample is not None and sample.voltage_V == pytest.approx(3.7 - 4.0 * size, rel=1e-12)


def test_the_command_line_refuses_a_name_that_there_is_not(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["add-effect", "M.json", "gremlins", "--train", "A.csv", "--validate", "B.csv", "--out", "N.json"]) == 2
    said = capsys.readouterr().err
    assert "effect 'gremlins' is unknown; known are" in said
    assert all(name in said for name in effects())


def test_what_a_new_effect_says_of_an_old_one_holds_for_both(tmp_path: Path) -> None:
    assert "related" not in effects()
    with another_folder_of_effects(tmp_path) as add:
        add("related", RELATED)
        assert effect("voltage_offset").twin == "related"
        assert effect("soc_dependence").contains == ("series_resistance", "related")
        assert effect("series_resistance") is sys.modules["models.effects.series_resistance"].EFFECT
    assert effect("voltage_offset").twin is None and "related" not in effects()
