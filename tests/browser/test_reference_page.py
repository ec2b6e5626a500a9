"""The page of the REST interface in Chromium: read without any other host, and opened at an operation."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from browser_rig import PHONE, OpenPage, looked_at, served
from playwright.sync_api import expect

from tests.patience import PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(2 * PATIENCE_S)]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("reference"), "[bench.sim.simulate]\n") as found:
        yield found


def test_every_operation_stands_on_the_page_and_the_address_opens_one(open_page: OpenPage, address: str) -> None:
    page = open_page("sim")
    page.get_by_role("link", name="REST interface").click()
    expect(page.get_by_role("heading", name="REST interface")).to_be_visible()
    paths = page.request.get(f"{address}/api/v1/openapi.json").json()["paths"]
    expect(page.locator("details.operation")).to_have_count(sum(len(methods) for methods in paths.values()))
    named = paths["/api/v1/runs"]["post"]["operationId"]
    page.goto(f"{address}/reference#{named}")
    start = page.locator(f"#{named}")
    expect(start.get_by_text('"initial_soc": 0.5').first).to_be_visible()
    expect(page.get_by_role("button", name="STOP sim")).to_be_visible()
    looked_at(page, "reference")


def test_it_is_read_on_a_phone(open_page: OpenPage, address: str) -> None:
    page = open_page("sim", PHONE)
    page.goto(f"{address}/reference")
    expect(page.get_by_role("heading", name="Runs", exact=True)).to_be_visible()
    looked_at(page, "reference-phone")
