"""The whole way in Chromium as a laboratory goes it: cyclers' files dropped, a model made and bettered, its report.

Each step is reloaded: what was found stands in the address.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from browser_rig import OpenPage, looked_at, served
from playwright.sync_api import Locator, Page, expect

from tests.patience import LONG_S, PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(2 * LONG_S)]

_DATA = Path(__file__).parents[1] / "data"
_LONG_MS = 1000 * LONG_S
_HELD = """([name, text]) => {
    const held = new DataTransfer();
    held.items.add(new File([Uint8Array.from(atob(text), (each) => each.charCodeAt(0))], name));
    return held;
}"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("journey"), "[bench.fast.simulate]\nlock_step = true\n") as found:
        yield found


def dropped(page: Page, file: Path, name: str) -> None:
    held = page.evaluate_handle(_HELD, [name, base64.b64encode(file.read_bytes()).decode()])
    page.dispatch_event(".drop", "drop", {"dataTransfer": held})
    expect(page.locator("#import-store")).to_be_visible()


def stored(page: Page, capacity_Ah: str, soc: str) -> None:
    page.locator("#import-capacity").fill(capacity_Ah)
    page.locator("#import-soc").fill(soc)
    page.locator("#import-store-button").click()
    page.wait_for_url("**/runs/*")


def step(page: Page, name: str) -> Locator:
    return page.locator(f"#improve-{name}")


def on_paper(page: Page, address: str, what: str) -> bytes:
    link = page.get_by_role("link", name=f"Report as PDF of {what}").get_attribute("href")
    answer = page.request.get(f"{address}{link}", timeout=1000 * PATIENCE_S)
    assert answer.headers["content-type"] == "application/pdf"
    return answer.body()


def test_an_ndax_file_is_dropped_corrected_and_seen(open_page: OpenPage, address: str) -> None:
    page = open_page("fast", path="/import")
    dropped(page, _DATA / "neware" / "rest.ndax", "rest.ndax")
    expect(page.locator("#import-body")).to_contain_text("Neware, .ndax, .nda or CSV of BTSDA, 67 samples")
    page.locator("#column-step_count").select_option("step_index")
    expect(page.locator("#import-busy")).to_be_empty()
    page.reload()
    expect(page.locator("#column-step_count")).to_have_value("step_index")
    expect(page.locator("#import-body")).to_contain_text("67 samples")
    expect(page.locator(".import-plot canvas").first).to_be_attached()
    looked_at(page, "journey-1-ndax")
    stored(page, "0,004", "50")
    page.reload()
    expect(page.locator("#run-facts")).to_contain_text("rest.ndax")
    expect(page.locator("#run-notes")).to_contain_text("Imported from rest.ndax")
    expect(page.locator("#run-facts")).not_to_contain_text("limits")
    expect(page.locator("#run-facts")).to_contain_text("0.00400 Ah")
    looked_at(page, "journey-2-run")
    page.go_back()
    expect(page.locator("#import-seen")).to_be_hidden()


def test_two_records_of_a_cell_become_a_model_that_gets_better(open_page: OpenPage, address: str) -> None:
    httpx.post(f"{address}/api/v1/cells", json={"id": "P1", "capacity_Ah": 2.968}).raise_for_status()
    page = open_page("fast", path="/cells/P1")
    for name, file in (("train", "drive_25degC_Cycle_1"), ("judge", "drive_10degC_US06")):
        page.goto(f"{address}/import?cell=P1")
        dropped(page, _DATA / "panasonic_18650pf" / f"{file}.csv.gz", f"{name}.csv.gz")
        expect(page.locator("#import-capacity")).to_have_value("2.968")
        stored(page, "2.968", "100")
    page.goto(f"{address}/improve")
    fits(page)
    better(page)
    assert on_paper(page, address, "the comparison").startswith(b"%PDF-")
    assert on_paper(page, address, "the diagnosis").startswith(b"%PDF-")


def fits(page: Page) -> None:
    """A model of the first record, held against the second: what each is used for is proposed."""
    form = page.get_by_role("form", name="Fit a model")
    expect(form).to_contain_text("Learns from: train.csv.gz. Judged by: judge.csv.gz.")
    expect(form.get_by_label("Capacity of the cell / Ah")).to_have_value("2.968")
    form.get_by_label("Structure").select_option("minimal")
    looked_at(page, "journey-3-choose")
    form.get_by_role("button", name="Fit a model").click()
    page.wait_for_url(re.compile("doing=fit"))
    page.reload()
    expect(step(page, "compare").locator(".figure strong").first).to_contain_text("mV", timeout=_LONG_MS)
    expect(step(page, "where").locator(".regions li").first).to_be_visible()
    page.reload()
    expect(step(page, "compare").locator(".figure strong").first).to_contain_text("mV")
    expect(step(page, "where").locator(".regions li").first).to_be_visible()
    expect(step(page, "compare").locator("abbr", has_text="Cannot be foretold")).to_have_attribute(
        "title", re.compile("looks like noise")
    )
    looked_at(page, "journey-4-where")


def better(page: Page) -> None:
    """What is missing, put in; the error falls on the record that the fit did not see."""
    page.get_by_role("button", name="Find out what is missing").click()
    page.wait_for_url(re.compile("doing=which"))
    page.reload()
    first = step(page, "which").locator(".finding").first
    expect(first).to_contain_text("Confidence", timeout=_LONG_MS)
    page.reload()
    expect(first).to_contain_text("Confidence")
    looked_at(page, "journey-5-which")
    first.locator("button[data-effect]").click()
    page.wait_for_url(re.compile("doing=add"))
    page.reload()
    added = step(page, "add").locator(".notice")
    expect(added).to_contain_text("is in the model", timeout=_LONG_MS)
    page.reload()
    expect(added).to_contain_text("is in the model")
    before, after = map(float, re.findall(r"(\d+\.\d+)\s*mV", added.locator("strong").inner_text()))
    assert after < before
    expect(step(page, "watch").locator("tbody tr")).to_have_count(2)
    # Names of the program are no words of a laboratory.
    assert not re.findall(r"\b[a-z]+_\w+", page.locator("#improve-body").inner_text())
    looked_at(page, "journey-6-watch")
