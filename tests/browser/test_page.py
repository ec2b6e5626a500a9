"""The page in Chromium against the real service: a process of its own, simulated benches over real sockets."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser_rig import PHONE, LiveLink, OpenPage, looked_at, served
from playwright.sync_api import Page, expect
from playwright.sync_api import TimeoutError as PlaywrightTimeoutError

from tests.patience import LONG_S, PATIENCE_S

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(3 * PATIENCE_S)]

# One bench on the wall clock, whose runs last long enough to be stopped, and one in lock-step.
_CONFIG = """
[bench.slow.simulate]
lock_step = false
[bench.fast.simulate]
lock_step = true
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the service is started."""
    return tmp_path_factory.mktemp("service")


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """Address of a service that runs until the module's last test has ended."""
    with served(folder, _CONFIG) as found:
        yield found


def _reading(page: Page, name: str) -> float:
    text = page.locator(f"[data-reading={name}] .number").inner_text()
    return float(text.replace("\u2212", "-"))


def _fill_campaign(page: Page, name: str) -> None:
    """Fill the form with a campaign that is short because it stays in the middle of the SoC range."""
    expect(page.locator("#campaign-body :is(.campaign-form, .stages)")).to_be_attached()
    if page.locator("#campaign-new").is_visible():  # an earlier campaign is shown
        page.locator("#campaign-new").click()
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_label("Duration per run / s").fill("4200")
    page.get_by_text("Cell and ranges").click()
    page.get_by_label("Lowest SoC / %").fill("40")
    page.get_by_label("Highest SoC / %").fill("60")
    page.get_by_label("Model structure").select_option("minimal")


def test_idle_bench_is_shown_with_state_in_words_and_live_values(open_page: OpenPage) -> None:
    page = open_page("slow")
    panel = page.get_by_role("region", name="Bench slow")
    expect(panel.locator(".bench-head .chip")).to_have_text("idle")
    expect(page.locator("#service")).to_have_text("Live, service ok")
    expect(panel.locator("[data-reading=current] .note")).to_have_text("at rest")
    assert 2.5 < _reading(page, "voltage") < 4.2
    first = page.locator("[data-reading=voltage] .number").inner_text()
    expect(page.locator("[data-reading=voltage] .number")).not_to_have_text(first)  # the sensor's noise moves it
    looked_at(page, "bench-idle")


def test_every_page_has_the_same_menu(open_page: OpenPage) -> None:
    menu = ["Benches", "Runs", "Cells", "Import", "Improve", "Life"]
    for path in ("/", "/cells", "/import", "/improve", "/life", "/reference", "/runs/none", "/cells/none"):
        page = open_page("fast", path=path)
        links = page.get_by_role("navigation", name="Pages").get_by_role("link")
        assert links.all_inner_texts() == menu
        assert links.evaluate_all("(all) => all.filter((each) => each.ariaCurrent).map((each) => each.pathname)") == (
            [path] if path in ("/", "/cells", "/import", "/improve", "/life") else []
        )


def test_the_length_of_a_campaign_is_that_of_the_bench_that_is_looked_at(open_page: OpenPage) -> None:
    page = open_page("fast")
    told = page.locator("#campaign-length")
    expect(told).to_contain_text("of test time")
    page.locator("#card-slow").click()
    expect(page.locator("#campaign-bench")).to_have_value("slow")
    expect(told).to_contain_text("of real time")
    page.locator("#card-fast").click()
    expect(told).not_to_contain_text("of real time")


def test_stop_ends_a_run_at_once_and_shows_the_answer_on_a_phone(open_page: OpenPage) -> None:
    page = open_page("slow", PHONE)
    stop = page.get_by_role("button", name="STOP slow")
    # In sight, also where nothing moves.
    expect(stop).to_be_in_viewport()
    expect(stop).to_have_attribute("data-moves", "false")
    _fill_campaign(page, "to be stopped")
    page.get_by_role("button", name="Start campaign").click()
    expect(stop).to_have_attribute("data-moves", "true")
    page.locator("#events-section").scroll_into_view_if_needed()
    expect(stop).to_be_in_viewport()
    expect(page.locator(".plot-box canvas")).to_be_attached()
    expect(page.locator("[data-reading=soc] .number")).not_to_have_text("–")
    stop.click()
    expect(page.locator(".answer")).to_contain_text("Bench idle after")
    expect(stop).to_have_attribute("data-moves", "false")
    expect(page.locator(".bench-head .chip")).to_have_text("idle")
    expect(page.locator("#runs-body tbody tr").first).to_contain_text("stopped")
    expect(page.locator("#campaign-body .campaign-head .chip")).to_have_text("stopped")
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    looked_at(page, "bench-stopped-phone")


def test_stop_works_while_the_service_is_stopped(open_page: OpenPage, folder: Path) -> None:
    page = open_page("slow")
    _fill_campaign(page, "without a service")
    with page.expect_response("**/stop-port"):
        page.reload()  # the ways past the service are learnt with the page
    _fill_campaign(page, "without a service")
    page.get_by_role("button", name="Start campaign").click()
    stop = page.get_by_role("button", name="STOP slow")
    expect(stop).to_have_attribute("data-moves", "true")
    pid = json.loads((folder / "bench-data" / "meta.lock").read_text())["pid"]
    os.kill(pid, signal.SIGSTOP)
    try:
        stop.click()
        expect(page.locator(".answer")).to_contain_text("STOP: taken after")
    finally:
        os.kill(pid, signal.SIGCONT)
    expect(page.locator(".answer")).to_contain_text("Bench idle after")


@pytest.mark.timeout(2 * LONG_S)
def test_campaign_runs_through_to_figures_and_pictures(open_page: OpenPage) -> None:
    page = open_page("fast")
    _fill_campaign(page, "in lock-step")
    capacity = page.get_by_label("Capacity / Ah")
    stated = capacity.input_value()
    capacity.fill("0")
    page.get_by_role("button", name="Start campaign").click()
    expect(page.locator("#campaign-capacity_Ah-error")).to_contain_text("greater than 0")
    capacity.fill(stated)
    left_out = page.get_by_label("Effects left out of the model")
    left_out.fill("hysteresis, relaxation")
    page.get_by_role("button", name="Start campaign").click()
    expect(page.locator("#campaign-without-error")).to_contain_text("not of structure 'minimal'")
    left_out.fill("")
    page.get_by_role("button", name="Start campaign").click()
    expect(page.locator(".stage .chip", has_text="done")).to_have_count(6, timeout=1000 * LONG_S)
    result = page.locator("#campaign-result")
    expect(result.locator(".figure").first).to_contain_text("mV")
    expect(result.locator(".result-chart canvas")).to_have_count(2)
    expect(page.get_by_role("table", name="Runs of the campaign").locator("tbody tr")).to_have_count(2)
    looked_at(page, "campaign-done")
    with page.expect_download() as download:
        page.get_by_role("link", name="BDF of in lock-step: validate").click()
    assert download.value.path().read_text(encoding="utf-8").startswith("Test Time / s")


def test_values_are_marked_old_while_the_service_cannot_be_heard(open_page: OpenPage) -> None:
    link = LiveLink()
    page = open_page("slow", prepare=link.attach)
    banner = page.locator("#offline-banner")
    expect(page.locator("#service")).to_have_text("Live, service ok")
    expect(banner).to_be_hidden()
    # Only a reading that has been there can grow old.
    expect(page.locator("[data-reading=voltage] .number")).not_to_have_text("–")
    link.cut()
    expect(banner).to_contain_text("Disconnected, values are old")
    expect(page.locator(".age")).to_contain_text("Last reading")
    expect(page.locator(".bench-head .chip")).to_contain_text("was")
    looked_at(page, "bench-offline")
    link.mend()
    # The page also tries by itself: it may have come back, and the button have gone, before the click.
    with contextlib.suppress(PlaywrightTimeoutError):
        page.get_by_role("button", name="Try now").click(timeout=3_000)
    expect(banner).to_be_hidden()
    expect(page.locator("#service")).to_have_text("Live, service ok")


def test_page_forbids_foreign_sources(open_page: OpenPage) -> None:
    page = open_page("fast")
    policy = page.request.get(page.url).headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    # Beside the service itself only the stop ports of its two benches.
    assert len(re.findall(r" http://127\.0\.0\.1:\d+", policy)) == policy.count("http") == 2
    assert page.request.get(f"{page.url.split('?')[0]}static/../routes.py").status == 404
    assert page.request.get(f"{page.url.split('?')[0]}static/%2e%2e/routes.py").status == 404
