"""A cell's life in Chromium: runs chosen, followed, drawn, and given as CSV."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import httpx
import numpy as np
import pytest
from browser_rig import DESKTOP, PHONE, OpenPage, looked_at, served
from playwright.sync_api import Page, expect

from bench_service.client import BenchClient
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent
from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.streams import SAMPLES, STREAMS
from models.diagnosis import memory_to_json
from models.network.model_record import ModelRecord
from tests.patience import LONG_S
from tests.unit.models.diagnosis.cells import simple_network
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs
from tests.unit.models.diagnosis.trend.test_trend import cycle
from tests.unit.models.hand_network import CAPACITY_AH

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(2 * LONG_S)]

_CYCLES = (0, 1, 10, 15, 20)
_STORED = (10, 0, 1, 20, 15)


def _store(data_dir: Path) -> None:
    """Cycles of a cell that loses 1 % a cycle, stored in no order of theirs."""
    limits = {"voltage_V": [2.5, 4.2], "current_A": [-10.0, 10.0], "temperature_degC": [0.0, 60.0], "soc": [0, 1]}
    with closing(MetadataStore.open(data_dir)) as store, closing(SampleWriter.open(data_dir)) as writer:
        profile = store.profiles.add("swing", np.array([0.0, 1.0]), np.array([0.0, 0.0]))
        for number in _STORED:
            made = cycle(number)
            n = len(made.time_s)
            columns = {column.name: np.zeros(n, column.numpy) for column in STREAMS[SAMPLES]} | {
                "time_s": made.time_s, "current_A": made.current_A, "setpoint_A": made.current_A,
                "voltage_V": made.voltage_V, "temperature_degC": made.temperature_degC,
            }  # fmt: skip
            intent = RunIntent(bench="sim", profile_id=profile.id, dt_s=1.0, initial_soc=SOC, capacity_Ah=CAPACITY_AH,
                               limits=limits, code_version="1", name=made.name)  # fmt: skip
            run = store.runs.add(intent)
            store.runs.start(run.id)
            writer.commit([Rows(run.id, SAMPLES, 0, STREAMS[SAMPLES], columns)])
            closed = writer.close_run(run.id, "completed", None)
            store.runs.end(run.id, "completed", None, n_samples=n, missed_ticks=0, sha256=closed.sha256)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("life")
    _store(folder / "bench-data")
    with served(folder, "[bench.sim.simulate]\nseed = 3\n") as found:
        network = replace(simple_network(CAPACITY_AH), record=ModelRecord(diagnosis=memory_to_json(known_runs())))
        with BenchClient(found) as client:
            client.import_model(json.loads(json.dumps(network.to_json())))
        yield found


def opened(open_page: OpenPage, address: str, viewport: dict[str, int] = DESKTOP) -> Page:
    page = open_page("sim", viewport)
    page.goto(f"{address}/life")
    return page


def test_a_cell_is_followed_from_its_runs_to_its_end(open_page: OpenPage, address: str) -> None:
    page = opened(open_page, address)
    form = page.get_by_role("form", name="Choose model and runs")
    rows = form.locator("tbody tr")
    expect(rows).to_have_count(len(_CYCLES))
    assert [row.split("\t")[1] for row in rows.all_inner_texts()] == [f"cycle {number}" for number in _CYCLES]
    cycles = [form.get_by_label(f"Cycle of cycle {number}", exact=True) for number in _CYCLES]
    assert [each.input_value() for each in cycles] == [str(number) for number in _CYCLES]
    cycles[1].fill("30")
    form.get_by_role("button", name="Follow the cell").click()
    expect(form.get_by_role("alert")).to_contain_text("cycle 10 has cycle 10, below that of the run before it")
    cycles[1].fill("")
    form.get_by_role("button", name="Follow the cell").click()
    expect(form.get_by_role("alert")).to_contain_text("cycle 1 has no cycle")
    cycles[1].fill("1")
    form.get_by_label("End of life / %").fill("90")
    form.get_by_role("button", name="Follow the cell").click()
    page.wait_for_function("() => document.body.dataset.drawn === '1'", timeout=1000 * LONG_S)

    life = page.locator("#life-section")
    expect(life.locator(".life-plot canvas")).to_have_count(5)
    expect(life.locator(".life-words").first).to_contain_text("1.8 Ah")
    told = life.locator("tbody tr")
    assert "nothing" in told.first.inner_text() and "capacity" in told.last.inner_text()
    drawn = page.evaluate(
        "() => echarts.getInstanceByDom(document.querySelector('.life-plot')).getOption()"
        ".series.find((each) => each.name === 'capacity').data"
    )
    assert drawn[-1][1] == pytest.approx(0.8 * CAPACITY_AH, rel=0.06)
    assert [at for at, _ in drawn] == list(_CYCLES)
    taken = page.evaluate(
        "() => echarts.getInstanceByDom(document.querySelectorAll('.life-plot')[1]).getOption()"
        ".series.find((each) => each.name === 'capacity').data"
    )
    assert taken[-1][1] == pytest.approx(CAPACITY_AH - drawn[-1][1], abs=0.02) and taken[0][1] == 0.0

    table = httpx.get(address + str(life.get_by_role("link", name="Export as CSV").get_attribute("href"))).text
    written = list(csv.DictReader(io.StringIO(table)))
    assert len(written) == len(_CYCLES)
    assert float(written[-1]["capacity_Ah"]) == pytest.approx(drawn[-1][1])
    href = str(life.get_by_role("link", name="Report of the life", exact=True).get_attribute("href"))
    report = httpx.get(address + href)
    assert report.status_code == 200 and "Life report" in report.text and "cycle 0" in report.text
    looked_at(page, "life")


def test_nothing_chosen_is_said_on_a_phone(open_page: OpenPage, address: str) -> None:
    page = opened(open_page, address, PHONE)
    form = page.get_by_role("form", name="Choose model and runs")
    expect(form.get_by_role("checkbox")).to_have_count(len(_CYCLES))
    for box in form.get_by_role("checkbox").all():
        box.uncheck()
    form.get_by_role("button", name="Follow the cell").click()
    expect(form.get_by_role("alert")).to_contain_text("at least one run")
    looked_at(page, "life-phone")
