"""The page of a run in Chromium: what is drawn is what was measured, and its place survives a reload."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser_rig import DESKTOP, PHONE, LiveLink, OpenPage, looked_at, served
from playwright.sync_api import Page, expect
from stored_run import GAP_S, PAUSE_S, store_run

from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(3 * PATIENCE_S)]

_CONFIG = """
[bench.slow.simulate]
lock_step = false
[bench.fast.simulate]
lock_step = true
"""
_PLOT = "echarts.getInstanceByDom(document.querySelector('.run-plot')).getOption()"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the service is started."""
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="module")
def run_id(folder: Path) -> str:
    """A long run, stored before the service starts."""
    return store_run(folder / "bench-data", "long pulses")


@pytest.fixture(scope="module")
def address(folder: Path, run_id: str) -> Iterator[str]:
    with served(folder, _CONFIG) as found:
        yield found


def drawn(page: Page, name: str) -> list[list[float]]:
    """Points of a line of the plot."""
    return page.evaluate(f"(name) => {_PLOT}.series.find((each) => each.name === name).data", name)


def edges_s(points: list[list[float]]) -> list[float]:
    """Times at which a current comes or goes."""
    return [round(b[0], 1) for a, b in zip(points, points[1:], strict=False) if abs(b[1] - a[1]) > 1.0]


def loaded(page: Page) -> int:
    page.wait_for_function("() => document.querySelector('.run-plot canvas') && document.body.dataset.loadMs")
    return int(page.evaluate("document.body.dataset.drawn"))


def zoomed(page: Page, act: Any) -> None:
    """Do something that changes the view, and wait until what the service has of it is drawn."""
    before = loaded(page)
    page.evaluate("delete document.body.dataset.loadMs")
    act()
    page.wait_for_function("(n) => document.body.dataset.loadMs && Number(document.body.dataset.drawn) > n", arg=before)


def test_a_pulse_is_drawn_as_it_was_at_every_zoom_and_a_reload_keeps_the_place(
    open_page: OpenPage, address: str, run_id: str
) -> None:
    page = open_page("fast")
    page.goto(f"{address}/runs/{run_id}")
    loaded(page)
    expect(page.get_by_role("heading", name="long pulses")).to_be_visible()
    first = edges_s(drawn(page, "Current"))
    assert first[:4] == [200.0, 300.0, 800.0, 900.0], "few steps stay exact in the whole run too"
    assert page.evaluate(f"{_PLOT}.series.find((each) => each.name === 'Current').step") == "start"
    # What is missing, held, and what was noted is marked.
    areas = f"{_PLOT}.series.find((each) => each.markArea).markArea.data"
    spans = [(round(a, 1), round(b, 1)) for a, b in page.evaluate(f"{areas}.map(([a, b]) => [a.xAxis, b.xAxis])")]
    assert (round(GAP_S - 0.1, 1), GAP_S + 20.0) in spans
    assert any(abs(a - PAUSE_S[0]) < 0.2 and abs(b - PAUSE_S[1]) < 0.2 for a, b in spans)
    expect(page.locator("#run-events")).to_contain_text("200 ticks were missed")
    plot = page.locator(".run-plot")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    assert box is not None
    # Drag over the second fifth, then the wheel around its middle, and back out by the button.
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 80)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.45 * box["width"], box["y"] + 90, steps=3)
    zoomed(page, page.mouse.up)
    narrow = float(page.locator("#view-to").input_value()) - float(page.locator("#view-from").input_value())
    assert 900.0 < narrow < 1800.0
    zoomed(page, lambda: page.mouse.wheel(0, -100))
    assert float(page.locator("#view-to").input_value()) - float(page.locator("#view-from").input_value()) < narrow

    def ten_minutes() -> None:
        page.locator("#view-from").fill("3000")
        page.locator("#view-to").fill("3600")
        page.locator("#view-to").press("Enter")

    zoomed(page, ten_minutes)
    assert edges_s(drawn(page, "Current")) == [3200.0, 3300.0]
    page.locator("#row-1-right").select_option("temperature")
    looked_at(page, "run-ten-minutes")
    page.reload()
    loaded(page)
    expect(page.locator("#view-from")).to_have_value("3000")
    expect(page.locator("#row-1-right")).to_have_value("temperature")
    assert edges_s(drawn(page, "Current")) == [3200.0, 3300.0] and drawn(page, "Temperature")
    zoomed(page, page.locator("#zoom-reset").click)
    expect(page.locator("#view-from")).to_have_value("0")
    expect(page.locator("#zoom-reset")).to_be_disabled()


def test_cursors_notes_and_incremental_capacity(open_page: OpenPage, address: str, run_id: str) -> None:
    page = open_page("fast", PHONE)
    page.goto(f"{address}/runs/{run_id}?from=3000&to=3600")
    loaded(page)
    page.locator("#cursor-a").fill("3190")
    page.locator("#cursor-a").press("Enter")
    page.locator("#cursor-b").fill("3290")
    page.locator("#cursor-b").press("Enter")
    row = page.locator(".cursor-table tr", has_text="Current")
    expect(row).to_contain_text("−5.000")
    expect(page.locator(".cursor-table tr", has_text="Test time")).to_contain_text("1\u202fmin 40\u202fs")
    page.locator("#incremental-show").click()
    expect(page.locator(".incremental canvas")).to_have_count(2)
    page.get_by_role("textbox", name="Label").fill("Cell 7")
    page.get_by_role("textbox", name="Operator").fill("A. Technician")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#run-notes")).to_contain_text("Saved.")
    expect(page.get_by_role("heading", name="Cell 7")).to_be_visible()
    expect(page.locator("#run-events")).to_contain_text("label 'Cell 7'")
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    looked_at(page, "run-phone")
    # The list finds it by what was written, and leads back.
    page.goto(f"{address}/?bench=fast")
    expect(page.locator("#runs-body")).to_contain_text("Cell 7")
    page.get_by_label("Search runs").fill("nobody")
    expect(page.locator("#runs-body")).to_contain_text("No run is like that")
    page.get_by_label("Search runs").fill("technician cell")
    page.get_by_role("link", name="Cell 7", exact=True).click()
    expect(page.get_by_role("heading", name="Cell 7")).to_be_visible()


def test_a_run_is_started_held_and_stopped_from_the_page_and_looked_at_meanwhile(
    open_page: OpenPage, address: str, run_id: str, tmp_path: Path
) -> None:
    link = LiveLink()
    page = open_page("slow", prepare=link.attach)
    page.get_by_text("Start a test", exact=True).click()
    strong, weak = tmp_path / "strong.csv", tmp_path / "weak.csv"
    strong.write_text("time_s,current_A\n0,50\n60,0\n")
    weak.write_text("time_s,current_A\n0,0\n20,1\n600,0\n7200,0\n")
    page.locator("#start-file").set_input_files(strong)
    expect(page.locator("#start-wrong")).to_contain_text("leaves the bench's limits")
    page.locator("#start-file").set_input_files(weak)
    expect(page.locator("#start-wrong")).to_be_empty()
    told = "2.00 h (2\u202fh 00\u202fmin) of real time: started now, it is done at"
    expect(page.locator("#start-told")).to_contain_text(told)
    expect(page.locator(".run-preview canvas")).to_be_attached()
    page.locator("#start-dt_s").fill("0.1")
    page.locator("#start-initial_soc").fill("50")
    page.locator("#start-name").fill("from the page")
    looked_at(page, "start-a-run")
    page.locator("#start-submit").click()
    panel = page.get_by_role("region", name="Bench slow")
    expect(panel.locator(".bench-head .chip")).to_have_text("running")
    expect(panel.locator(".time-left")).to_contain_text("left, done at")
    page.locator("#pause").click()
    expect(panel.locator(".bench-head .chip")).to_have_text("paused")
    expect(panel.locator(".time-left")).to_contain_text("Held")
    page.locator("#resume").click()
    expect(panel.locator(".bench-head .chip")).to_have_text("running")
    # Its own page, beside another run; it grows by itself.
    page.get_by_role("link", name="Open the run").click()
    loaded(page)
    page.locator("#run-other").select_option(run_id)
    zoomed(page, page.locator("#run-add").click)
    names = page.evaluate(f"{_PLOT}.series.map((each) => each.name)")
    assert any(name.startswith("Voltage · from the page") for name in names) and len(names) == len(set(names))
    n = len(drawn(page, "Voltage · from the page"))
    page.wait_for_function(f"(n) => {_PLOT}.series[0].data.length > n", arg=n)
    # The link is lost, which is said, and comes back: what was measured meanwhile is drawn.
    link.cut()
    expect(page.locator("#offline-banner")).to_contain_text("Disconnected, values are old")
    page.wait_for_timeout(1000)
    n = len(drawn(page, "Voltage · from the page"))
    link.mend()
    expect(page.locator("#offline-banner")).to_be_hidden()
    page.wait_for_function(f"(n) => {_PLOT}.series[0].data.length > n + 5", arg=n)
    points = drawn(page, "Voltage · from the page")
    assert max(b[0] - a[0] for a, b in zip(points, points[1:], strict=False)) < 1.0
    page.get_by_role("button", name="STOP slow").click()
    expect(page.locator("#run-facts .chip").first).to_have_text("stopped")
    looked_at(page, "two-runs")


def test_what_is_proposed_can_run_and_what_would_stop_at_once_cannot_start(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page("fast")
    page.get_by_text("Start a test", exact=True).click()
    expect(page.locator("#start-source")).to_have_value("test:pulse_resistance")
    page.locator("#start-initial_soc").fill("50")
    expect(page.locator("#start-told")).to_contain_text("of test time")
    expect(page.locator("#start-wrong")).to_be_empty()
    expect(page.locator("#start-submit")).to_be_enabled()
    # Longer than the bench allows: said in days, before it starts.
    page.locator("#start-source").select_option("test:ageing")
    expect(page.locator("#start-wrong")).to_contain_text("the run would last longer than 14 days")
    # Its first step may only be played where the cell does not stand.
    step = {"step": "constant_current", "rate_C": -0.5, "limits": {"soc": [0.1, 0.2]}, "until": {"time_s": 600}}
    file = tmp_path / "elsewhere.json"
    file.write_text(json.dumps({"schema": "bench-protocol-1", "name": "elsewhere", "steps": [step]}))
    page.locator("#start-file").set_input_files(file)
    expect(page.locator("#start-wrong")).to_contain_text("It would be stopped at once: step 1")
    expect(page.locator("#start-submit")).to_be_disabled()
    page.locator("#start-initial_soc").fill("19")
    expect(page.locator("#start-wrong")).not_to_contain_text("at once")
    expect(page.locator("#start-submit")).to_be_enabled()


def test_a_first_cycle_from_the_library_to_its_capacity(open_page: OpenPage) -> None:
    page = open_page("fast")
    page.get_by_text("Start a test", exact=True).click()
    page.locator("#start-source").select_option("test:cc_cv_cycling")
    expect(page.locator("#start-about")).to_contain_text("Cycles of constant-current")
    page.locator("#parameter-cycles").fill("two")
    expect(page.locator("#start-wrong")).to_contain_text("cycles is no number")
    page.locator("#parameter-cycles").fill("2")
    page.locator("#parameter-upper_V").fill("5")
    expect(page.locator("#start-wrong")).to_contain_text("5")
    page.locator("#parameter-upper_V").fill("")
    page.locator("#start-initial_soc").fill("50")
    page.locator("#start-dt_s").fill("10")
    expect(page.locator("#start-wrong")).to_be_empty()
    expect(page.locator("#start-told")).to_contain_text("of test time")
    steps = page.get_by_role("region", name="Steps").locator("tbody tr")
    expect(steps).to_have_count(4)
    # In words of the laboratory, with units.
    expect(steps.nth(0)).to_contain_text("CC-CV")
    expect(steps.nth(0)).to_contain_text("Current ≤ 0.125 A")
    expect(steps.nth(1)).to_contain_text("Time ≥ 600 s")
    expect(steps.nth(1)).to_contain_text("at most 2")
    looked_at(page, "start-a-test")
    page.locator("#start-submit").click()
    expect(page.locator("#runs-body tbody tr").first).to_contain_text("CC-CV cycling")
    page.get_by_role("link", name="CC-CV cycling", exact=True).first.click()
    rows = page.locator("#run-cycles table").first.locator("tbody tr")
    expect(rows).to_have_count(2)
    expect(page.locator("#run-facts .chip").first).to_have_text("completed")
    page.reload()
    loaded(page)
    # It began half full: what came out of what went in is no efficiency.
    expect(rows.nth(0)).to_contain_text("begun part charged")
    discharged_Ah = float(rows.nth(1).locator("td").nth(2).inner_text())
    assert 2.2 < discharged_Ah < 2.8
    page.locator("#row-4-left").select_option("cycle")
    assert {point[1] for point in drawn(page, "Cycle")} == {1, 2}
    looked_at(page, "cycles")


def test_a_charge_is_written_step_by_step_and_runs(open_page: OpenPage) -> None:
    page = open_page("slow")
    page.get_by_text("Start a test", exact=True).click()
    page.locator("#start-initial_soc").fill("50")
    page.locator("#start-source").select_option("edit:")
    rows = page.locator("table.editor tbody tr")
    expect(rows).to_have_count(1)
    page.get_by_label("Name of the protocol").fill("Charge by hand")
    page.get_by_label("Step 1, Current in C").fill("C/3")
    page.get_by_label("Step 1, Hold at in V").fill("9")
    expect(rows.first.locator(".field-error")).to_contain_text("9 V, limit")
    expect(page.get_by_label("Step 1, Hold at in V")).to_have_attribute("aria-invalid", "true")
    page.get_by_label("Step 1, Hold at in V").fill("4.1")
    expect(rows.first.locator(".field-error")).to_be_empty()
    expect(page.locator("#start-told")).to_contain_text("of real time: started now")
    # Twice in a loop with a rest, by keyboard alone.
    page.locator("#protocol-add-kind").select_option("rest")
    page.locator("#protocol-add").press("Enter")
    page.get_by_label("Step 2, end 1, Time in s").fill("10 min")
    page.get_by_label("Step 1, kind").select_option("loop")
    expect(rows).to_have_count(3)
    page.get_by_label("Step 2, Name").press("Alt+ArrowUp")
    expect(rows.nth(2).locator(".row-number")).to_have_text("1.2")
    page.get_by_role("button", name="Duplicate, step 1.2").press("Enter")
    page.get_by_role("button", name="Delete, step 1.3").press("Enter")
    expect(rows).to_have_count(3)
    expect(page.locator("#start-wrong")).to_be_empty()
    page.locator("#start-save").click()
    expect(page.locator("#start-source")).to_contain_text("Charge by hand, 1 step")
    page.reload()
    page.get_by_text("Start a test", exact=True).click()
    page.locator("#start-source").select_option("edit:")
    expect(rows).to_have_count(3)
    expect(page.get_by_label("Step 1.1, Current in C")).to_have_value("C/3")
    expect(page.locator("#start-told")).to_contain_text("of real time: started now")
    looked_at(page, "editor")
    page.set_viewport_size(PHONE)  # pyright: ignore[reportArgumentType]
    page.wait_for_function("(width) => document.documentElement.scrollWidth === width", arg=PHONE["width"])
    looked_at(page, "editor-phone")
    page.set_viewport_size(DESKTOP)  # pyright: ignore[reportArgumentType]
    page.locator("#start-dt_s").fill("0.1")
    page.locator("#start-initial_soc").fill("50")
    page.locator("#start-submit").click()
    panel = page.get_by_role("region", name="Bench slow")
    expect(panel.locator(".time-left")).to_contain_text("step 1, cc_cv, cycle 1")
    expect(page.locator("#runs-body tbody tr").first).to_contain_text("Charge by hand")
    page.get_by_role("button", name="STOP slow").click()
    expect(panel.locator(".bench-head .chip")).to_have_text("idle")
    # One current by hand, with what is left of its time.
    page.get_by_text("Start a test", exact=True).click()
    page.locator("#start-source").select_option("manual:")
    page.locator("#manual-current").fill("99")
    expect(page.locator("#start-wrong")).to_contain_text("leaves the bench's limits")
    page.locator("#manual-current").fill("-0.5")
    page.locator("#manual-minutes").fill("2")
    expect(page.locator("#start-wrong")).to_be_empty()
    expect(page.locator("#start-told")).to_contain_text("of real time: started now")
    looked_at(page, "manual")
    page.locator("#start-submit").click()
    expect(panel.locator(".time-left")).to_contain_text("step 1, manual")
    expect(panel.locator(".time-left")).to_contain_text("1\u202fmin 5")
    page.get_by_role("button", name="STOP slow").click()
    expect(panel.locator(".bench-head .chip")).to_have_text("idle")
