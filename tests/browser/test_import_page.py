"""A cycler's file in Chromium: dropped, asked about, corrected, stored, seen as a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser_rig import PHONE, OpenPage, looked_at, served
from playwright.sync_api import expect

from benchmarks.import_variants import commas, joined, record, renamed, swapped, table_of
from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(3 * PATIENCE_S)]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("imports"), "[bench.fast.simulate]\nlock_step = true\n") as found:
        yield found


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Of an unknown cycler: its own word for the voltage, discharge positive."""
    target = tmp_path / "cell 7.txt"
    target.write_text(joined(commas(swapped(renamed(table_of(record()), {2: "Klemme"}))), ";"))
    return target


def test_a_file_is_dropped_corrected_and_stored(open_page: OpenPage, address: str, file: Path) -> None:
    page = open_page("fast")
    # Until the bench is there the page grows above the link, and a click may miss it.
    expect(page.locator("#bench-section .chip").first).to_have_text("idle")
    page.get_by_role("link", name="Import a file").click()
    page.wait_for_url("**/import")
    page.locator("#import-file").set_input_files(file)
    question = page.locator(".question")
    expect(question).to_contain_text("which column holds voltage? Settle it below.")
    expect(question).not_to_contain_text("--")
    expect(page.locator("tr[data-asked=true] th")).to_have_text("Voltage")
    expect(page.locator("#import-store")).to_be_hidden()
    # Names of columns and units are read in full.
    room = """(node) => {
        const pen = document.createElement("canvas").getContext("2d");
        pen.font = getComputedStyle(node).font;
        return node.clientWidth - pen.measureText(node.selectedOptions[0].text).width;
    }"""
    assert min(select.evaluate(room) for select in page.locator(".import-columns select").all()) > 30
    looked_at(page, "import-question")
    page.locator("#column-voltage_V").select_option("Klemme")
    expect(question).to_contain_text("the current has the wrong sign")
    page.locator("#import-current_sign").select_option("discharge-positive")
    expect(page.locator("#import-body")).to_contain_text("400 samples")
    expect(question).to_have_count(0)
    expect(page.locator("#import-body table").last.locator("tbody tr").first).to_contain_text("25")
    page.locator("#import-capacity").fill("3,0")
    page.locator("#import-mapping").fill("ours")
    page.locator("#import-store-button").click()
    expect(page.locator("#import-store .hint")).to_contain_text("state of charge")
    page.locator("#import-soc").fill("40")
    looked_at(page, "import-ready")
    page.locator("#import-store-button").click()
    page.wait_for_url("**/runs/*")
    expect(page.locator("#run-facts")).to_contain_text("cell 7.txt")
    expect(page.locator("#run-notes")).to_contain_text("Imported from cell 7.txt")
    looked_at(page, "import-run")
    # On to a model of it: where there is none yet, making one is the way on.
    page.locator("#run-facts").get_by_role("link", name="Improve a model with it").click()
    page.wait_for_url("**/improve")
    expect(page.get_by_role("button", name="Fit a model")).to_have_class("primary")
    expect(page.get_by_role("button", name="Compare model and runs")).not_to_have_class("primary")
    # The next one is dropped, and read by what was remembered; there is nothing to ask.
    page.goto(f"{address}/import")
    held = "(text) => { const held = new DataTransfer(); held.items.add(new File([text], 'cell 8.txt')); return held; }"
    page.dispatch_event(".drop", "drop", {"dataTransfer": page.evaluate_handle(held, file.read_text())})
    expect(question).to_contain_text("which column holds voltage?")
    page.locator("#import-known").select_option("ours")
    expect(page.locator("#import-store")).to_be_visible()
    expect(question).to_have_count(0)
    expect(page.locator("#column-voltage_V")).to_have_value("Klemme")
    looked_at(page, "import-remembered")


def test_what_is_no_table_is_told_on_a_phone(open_page: OpenPage, address: str, tmp_path: Path) -> None:
    (tmp_path / "a.mpr").write_bytes(b"BIO-LOGIC MODULAR FILE\x1a  ")
    page = open_page("fast", PHONE)
    page.goto(f"{address}/import")
    page.locator("#import-file").set_input_files(tmp_path / "a.mpr")
    expect(page.locator("#import-message")).to_contain_text("a.mpr: is a BioLogic .mpr file")
    looked_at(page, "import-refused")
