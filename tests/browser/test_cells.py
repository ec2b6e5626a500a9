"""Cells in Chromium: one is taken in, put on a bench, played on, and its page has what belongs to it."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import pytest
from browser_rig import PHONE, OpenPage, looked_at, served
from playwright.sync_api import Page, Route, expect

from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(3 * PATIENCE_S)]
TYPE = {
    "maker": "LG",
    "model": "M50",
    "chemistry": "NMC",
    "capacity_Ah": "2,5",
    "charge_A": "3,4",
    "discharge_A": "7,3",
    "voltage_V-low": "2,5",
    "voltage_V-high": "4,15",
    "temperature_degC-low": "0",
    "temperature_degC-high": "45",
}


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("cells"), "[bench.fast.simulate]\nlock_step = true\n") as found:
        yield found


def test_a_cell_is_taken_in_played_on_and_has_its_history(open_page: OpenPage, address: str) -> None:
    page = open_page("fast")
    page.get_by_role("link", name="Cells", exact=True).first.click()
    expect(page.locator("#cells-body")).not_to_contain_text("Loading")
    page.locator("#cell-id").fill("C1")
    page.locator("#cell-label").fill("left of box 3")
    page.locator("#cell-owner").fill("Ana")
    page.locator("#cell-metadata").fill("batch = 7b\nmass_g = 68.2")
    page.locator("#cell-add").click()
    expect(page.get_by_role("alert").first).to_contain_text("Maker: say it")
    for name, value in TYPE.items():
        page.locator(f"#type-{name}").fill(value)
    page.locator("#type-source").fill("data sheet rev. 2")
    looked_at(page, "cells-add")
    page.locator("#cell-add").click()
    page.wait_for_url("**/cells/C1")
    facts = page.locator("#cell-facts")
    expect(facts).to_contain_text("C1 · left of box 3")
    expect(facts).to_contain_text("2.50 … 4.15 V")
    expect(facts).to_contain_text("\u22127.3 … 3.4 A")
    expect(facts).to_contain_text("68.2")

    page.goto(f"{address}/?bench=fast")
    page.locator("#start-details summary").click()
    page.locator("#start-cell").select_option("C1")
    expect(page.locator("#bench-section")).to_contain_text("cell C1 · left of box 3")
    assert httpx.get(f"{address}/api/v1/benches/fast").json()["limits"]["current_A"] == [-7.3, 3.4]
    expect(page.locator("#bench-section .chip").first).to_have_text("idle")
    looked_at(page, "cells-start")
    profile = {"name": "short", "time_s": [0, 5, 10], "current_A": [0, -1, 0]}
    profile_id = httpx.post(f"{address}/api/v1/profiles", json=profile).json()["id"]
    order = {"bench": "fast", "profile_id": profile_id, "dt_s": 1.0, "initial_soc": 0.5, "cell_id": "c1"}
    run_id = httpx.post(f"{address}/api/v1/runs", json=order).json()["id"]

    page.goto(f"{address}/cells/c1")
    expect(page.locator("#cell-runs tbody tr")).to_have_count(1)
    expect(page.locator("#cell-facts")).to_contain_text("bench fast")
    page.locator("#cell-owner").fill("Bo")
    page.get_by_role("button", name="Save").click()
    expect(page.locator("#cell-change")).to_contain_text("Saved.")
    expect(page.locator("#cell-events")).to_contain_text("owner Bo, was Ana")
    page.locator("#cell-retire").click()
    expect(page.locator("#cell-change")).to_contain_text("take it off first")
    looked_at(page, "cell")
    page.get_by_role("link", name="short").or_(page.locator("#cell-runs tbody a")).first.click()
    page.wait_for_url(f"**/runs/{run_id}")
    expect(page.locator("#run-facts").get_by_role("link", name="C1")).to_be_visible()


def test_cells_are_found_by_words_on_a_phone(open_page: OpenPage, address: str) -> None:
    for owner in ("Ana", "Bo"):
        httpx.post(f"{address}/api/v1/cells", json={"owner": owner, "metadata": {"batch": "9"}}).raise_for_status()
    page = open_page("fast", PHONE)
    page.goto(f"{address}/cells")
    page.locator("#cells-q").fill("batch 9 bo")
    expect(page.locator("#cells-body tbody tr")).to_have_count(1)
    looked_at(page, "cells-phone")
    page.locator("#cells-q").fill("nobody")
    expect(page.locator("#cells-body")).to_contain_text("No cell is like that.")
    page.goto(f"{address}/cells/C99")
    expect(page.locator("#cell-facts")).to_contain_text("unknown cell 'C99'")


def held(page: Page, address: str) -> Callable[[], None]:
    """Keep back the answers to an address until the function that is given is called."""
    waiting: list[Route] = []
    page.route(address, lambda route: waiting.append(route))

    def release() -> None:
        page.unroute(address)
        for route in waiting:
            route.continue_()

    return release


def test_a_file_is_brought_in_for_a_cell(open_page: OpenPage, address: str, tmp_path: Path) -> None:
    body = {"id": "old-1", "capacity_Ah": 2.5}
    httpx.post(f"{address}/api/v1/cells", json=body).raise_for_status()
    page = open_page("fast")
    page.goto(f"{address}/cells/old-1")
    page.get_by_role("link", name="Import a file of it").click()
    file = tmp_path / "old.csv"
    rows = [f"{t},{-1.0 if 5 <= t < 20 else 0.0},{3.6 if 5 <= t < 20 else 3.7}" for t in range(40)]
    file.write_text("\n".join(["time_s,current_A,voltage_V", *rows]))
    page.locator("#import-file").set_input_files(file)
    expect(page.locator("#import-of-cell")).to_have_value("old-1")
    expect(page.locator("#import-capacity")).to_have_value("2.5")
    # The same for a cell that is typed, the cursor already in its capacity; and one that there is not.
    page.locator("#import-of-cell").fill("C99")
    page.locator("#import-of-cell").press("Tab")
    told = page.locator("#import-store .hint")
    expect(told).to_contain_text("unknown cell C99")
    page.locator("#import-soc").fill("50")
    page.locator("#import-store-button").click()
    expect(told).to_contain_text("unknown cell C99")
    page.locator("#import-capacity").fill("")
    page.locator("#import-of-cell").fill("old-1")
    page.locator("#import-of-cell").press("Tab")
    expect(page.locator("#import-capacity")).to_be_focused()
    expect(page.locator("#import-capacity")).to_have_value("2.5")
    expect(told).to_be_empty()
    release = held(page, "**/api/v1/jobs/*")
    page.locator("#import-store-button").click()
    # The work is shown beside the button.
    expect(page.locator("#import-storing").get_by_role("progressbar", name="Storing the run")).to_be_in_viewport()
    release()
    page.wait_for_url("**/runs/*")
    facts = page.locator("#run-facts")
    expect(facts.get_by_role("link", name="old-1")).to_be_visible()
    expect(facts).to_contain_text(re.compile(r"brought in .*\d{4}"))
    expect(facts.get_by_role("link", name="PARQUET of old.csv", exact=True)).to_be_visible()
    expect(facts.get_by_role("link", name="Improve a model with it")).to_have_attribute("href", "/improve")
    page.goto(f"{address}/life?cell=OLD-1")
    expect(page.locator("#life-choose")).to_contain_text("A model of the cell as it was is needed")
