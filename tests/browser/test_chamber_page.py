"""A bench with a temperature chamber in Chromium: its steps are written, its air is seen live and in the run's plot."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browser_rig import LiveLink, OpenPage, looked_at, served
from playwright.sync_api import Route, expect

from bench_service.client import BenchClient
from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(3 * PATIENCE_S)]

_CONFIG = """
[bench.plain.simulate]
[bench.warm.simulate]
[bench.warm.chamber]
simulate = { ramp_K_per_min = 20.0 }
"""
_AMBIENT = (
    "() => { const plot = document.querySelector('.run-plot'); const option = plot && echarts.getInstanceByDom(plot)"
    "?.getOption(); const of = (name) => option?.series.find((each) => each.name === name);"
    " return of('Ambient')?.data.length && [of('Ambient').yAxisIndex === of('Temperature').yAxisIndex,"
    " Math.max(...of('Ambient').data.map((point) => point[1]))]; }"
)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("chamber"), _CONFIG) as found:
        yield found


def test_a_soak_is_written_played_and_looked_at(open_page: OpenPage, address: str) -> None:
    page = open_page("warm")
    expect(page.locator("[data-reading=ambient]")).to_contain_text("chamber off")
    page.get_by_text("Start a test", exact=True).click()
    page.locator("#start-initial_soc").fill("50")
    page.locator("#start-dt_s").fill("10")
    page.locator("#start-source").select_option("edit:")
    rows = page.locator("table.editor tbody tr")
    page.get_by_label("Step 1, kind").select_option("soak")
    page.get_by_label("Step 1, At in °C").fill("99")
    expect(rows.first.locator(".field-error")).to_contain_text("set point outside the chamber's window")
    page.get_by_label("Step 1, At in °C").fill("40")
    page.get_by_label("Step 1, For in s").fill("5 min")
    expect(rows.first.locator(".field-error")).to_be_empty()
    page.locator("#protocol-add-kind").select_option("chamber")
    page.locator("#protocol-add").press("Enter")
    expect(page.get_by_label("Step 2, Set to in °C")).to_have_value("25")
    expect(page.locator("#start-wrong")).to_be_empty()
    looked_at(page, "chamber-editor")
    with BenchClient(address) as client:
        steps = [{"step": "soak", "temperature_degC": 40, "hold_s": 300}]
        protocol = client.upload_protocol({"schema": "bench-protocol-1", "name": "soak", "steps": steps})
        run = client.start_run("warm", None, 10.0, 0.5, protocol_id=protocol["id"])
        assert client.wait_run(run["id"])["state"] == "completed"
        assert client.run(run["id"])["commissioning"]["chamber"]["maker"] == "bench"
        assert [each["ended_by"] for each in client.run_steps(run["id"])] == ["soaked"]
    page.goto(f"{address}/runs/{run['id']}")
    same_axis, warmest_degC = page.wait_for_function(_AMBIENT).json_value()
    assert same_axis and 39.5 < warmest_degC < 40.5
    looked_at(page, "chamber-run")


def test_what_is_known_of_the_cell_comes_late_and_leaves_alone_what_is_being_typed(open_page: OpenPage) -> None:
    page = open_page("warm")
    held: list[Route] = []
    page.route("**/standing", lambda route: held.append(route))
    page.get_by_text("Start a test", exact=True).click()
    soc = page.locator("#start-initial_soc")
    with page.expect_response("**/standing") as answer:
        soc.focus()
        while not held:
            page.wait_for_timeout(20)
        held.pop().continue_()
    answer.value.finished()
    page.wait_for_timeout(100)
    expect(soc).to_have_value("")
    page.keyboard.type("50")
    expect(soc).to_have_value("50")


def test_a_form_that_opens_before_any_bench_is_known_still_learns_where_the_cell_stands(
    open_page: OpenPage, address: str
) -> None:
    with BenchClient(address) as client:
        soc = client.standing("warm")["soc"]
    link = LiveLink()
    link.cut()
    page = open_page("warm", prepare=link.attach)
    page.get_by_text("Start a test", exact=True).click()
    expect(page.locator("#start-source option[value='edit:']")).to_be_attached()
    assert page.locator("#start-initial_soc").input_value() == ""
    link.mend()
    expect(page.locator("#start-initial_soc")).to_have_value(f"{round(100 * soc, 1):g}")
