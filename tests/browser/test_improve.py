"""The whole path in Chromium: a model that is off, where, why, the effect added, and the bar that falls."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser_rig import PHONE, OpenPage, looked_at, served
from playwright.sync_api import Page, Route, expect

from bench_service.client import BenchClient
from tests.patience import LONG_S
from tests.unit.models.module import synthetic_module as truth

pytestmark = [pytest.mark.needs_program("chromium"), pytest.mark.timeout(2 * LONG_S)]

# A cell whose hysteresis is far larger than anything that the small structure can take in; the page does not know,
# nor does anybody else before the seal is opened.
_CONFIG = """
[bench.sim.simulate]
seed = 3
effects = { relaxation = 0.0 }
hidden_effect = "hysteresis"
"""
_CAMPAIGN = {
    "bench": "sim",
    "name": "hidden",
    "structure": "minimal",
    "seed": 3,
    "soc": [0.3, 0.7],
    "duration_s": 9000.0,
}
_LONG_MS = 1000 * LONG_S


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("improve"), _CONFIG) as found:
        yield found


@pytest.fixture(scope="module")
def campaign(address: str) -> dict[str, Any]:
    """A completed campaign: two runs, and a model of one of them."""
    with BenchClient(address) as client:
        ended = client.wait_campaign(client.start_campaign(_CAMPAIGN)["id"], timeout_s=LONG_S)
    assert ended["state"] == "completed", ended["message"]
    return ended["result"]


def millivolts(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"(\d+\.\d+)\s*mV", text)]


def step(page: Page, name: str) -> Any:
    return page.locator(f"#improve-{name}")


def complaint(page: Page) -> Any:
    return page.get_by_role("form", name="Choose model and runs").locator(".form-message")


def test_the_path_from_a_model_that_is_off_to_a_better_one(
    open_page: OpenPage, address: str, campaign: dict[str, Any]
) -> None:
    page = open_page("sim", path="/improve")
    # Choose: the campaign's model and both of its runs are proposed.
    expect(page.get_by_label("Use of hidden: validate")).to_have_value("judge")
    expect(page.get_by_label("Use of hidden: train")).to_have_value("train")
    for name in ("compare", "where", "which", "add", "watch"):
        expect(step(page, name)).to_be_hidden()
    page.get_by_role("button", name="Compare model and runs").click()
    # Compare and where.
    expect(step(page, "compare").locator(".figure").first).to_contain_text("times the noise floor")
    white = step(page, "compare").locator(".figure", has_text="Cannot be foretold")
    expect(white).to_contain_text("of the squared error hangs together")
    assert 0.9 < millivolts(white.inner_text())[0] < 4.0  # the simulated sensor has 1 mV
    expect(step(page, "compare").locator("canvas").first).to_be_attached()
    expect(step(page, "where").locator(".regions li").first).to_contain_text("of the squared error in")
    expect(step(page, "where").locator(".heat canvas").first).to_be_attached()
    step(page, "where").get_by_label("What the map shows").select_option("bias_mV")
    # Which: a bar while it is looked for, then words, evidence, and a button.
    page.get_by_role("button", name="Find out what is missing").click()
    expect(step(page, "which").get_by_role("progressbar")).to_be_visible()
    expect(step(page, "which").locator(".verdict")).to_contain_text("hysteresis", timeout=_LONG_MS)
    finding = step(page, "which").locator(".finding[data-effect=hysteresis]")
    expect(finding).to_contain_text("Confidence")
    expect(finding.locator(".promise")).to_contain_text("forecast by the training runs")
    expect(finding).to_contain_text("The same refit without the effect")
    expect(finding.locator(".parameter", has_text="amplitude")).to_contain_text("mV")
    # The sealed game: what was hidden is told now, and beside it what was found.
    seal = page.locator(".seal[data-seal=sim]")
    expect(seal).to_contain_text("An effect is hidden")
    assert "hysteresis" not in seal.inner_text()
    seal.get_by_role("button", name="Open the seal").click()
    expect(seal.locator("strong")).to_contain_text("voltage hysteresis, 3")
    expect(seal).to_contain_text("That is what the diagnosis named: amplitude")
    # What was found stands in the address: a reload is where one was, even while something is added.
    page.reload()
    expect(step(page, "which").locator(".verdict")).to_contain_text("hysteresis")
    expect(step(page, "where").locator(".regions li").first).to_contain_text("of the squared error in")
    # Add.
    finding.get_by_role("button", name="Add voltage hysteresis").click()
    expect(step(page, "add").get_by_role("progressbar")).to_be_visible()
    page.wait_for_url(re.compile("doing=add"))
    page.reload()
    added = step(page, "add").locator(".notice")
    expect(added).to_contain_text("is in the model", timeout=_LONG_MS)
    before, after = millivolts(added.locator("strong").inner_text())
    assert after < 0.6 * before
    # Watch: what the page says is what the service has stored, judged on the run that the fit never saw.
    expect(step(page, "watch").locator("canvas").first).to_be_attached()
    rows = step(page, "watch").locator("tbody tr")
    expect(rows).to_have_count(2)
    assert [millivolts(text)[0] for text in rows.all_inner_texts()] == [before, after]
    child = rows.nth(1).get_attribute("data-model")
    with BenchClient(address) as client:
        record = client.model(str(child))
        assert record["parent_id"] == campaign["model_id"] and record["metrics"]["effect"] == "hysteresis"
        judged = client.compare(str(child), [campaign["runs"][1]["run_id"]])["result"]["overall"]["rmse_mV"]
    assert judged == pytest.approx(after, abs=0.006)
    expect(added).to_have_attribute("data-tone", "good")
    expect(added.locator(".outcome")).to_contain_text("the forecast held")
    expect(added.get_by_role("list", name="Error inside and outside")).to_contain_text("Inside of the trained ranges")
    looked_at(page, "improved")
    a_promise_that_was_not_kept(page, str(child), before)
    page.reload()
    expect(added).to_contain_text("is in the model")
    expect(rows).to_have_count(2)
    # Undo is choosing the parent.
    added.get_by_role("button", name="Go on with the new version").click()
    expect(step(page, "compare").locator(".figure strong").first).to_contain_text(f"{after:.2f}")
    step(page, "watch").get_by_role("button", name="Back to this one").click()
    expect(step(page, "compare").locator(".figure strong").first).to_contain_text(f"{before:.2f}")
    expect(page.get_by_label("Model", exact=True)).to_have_value(campaign["model_id"])


def a_promise_that_was_not_kept(page: Page, child: str, before_mV: float) -> None:
    """What fell by next to nothing, or rose where the model should know, is told as such, and in no green."""
    address = f"**/api/v1/models/{child}"

    def with_little_of_it(route: Route) -> None:
        told = route.fetch().json()
        told["metrics"] |= {
            "error_after_mV": 0.998 * before_mV,
            "inside": {"before_mV": before_mV, "after_mV": 1.3 * before_mV},
            "outside": {"before_mV": 9.0 * before_mV, "after_mV": 8.0 * before_mV},
        }
        route.fulfill(json=told)

    def with_much_outside(route: Route) -> None:
        told = route.fetch().json()
        if "result" in told:
            overall = told["result"]["overall"]
            told["result"]["outside"] = {"rmse_mV": 3.0 * overall["rmse_mV"], "n_samples": overall["n_samples"] / 10}
        else:
            told["outside_training"] = 0.1
        route.fulfill(json=told)

    page.route(address, with_little_of_it)
    page.route("**/api/v1/comparisons/**", with_much_outside)
    page.reload()
    # What the regions leave out is said before them.
    said = "90\u202f% of the squared error lies outside what the model was trained on, in 10.0\u202f% of the samples"
    expect(step(page, "where").locator(".outside")).to_contain_text(said)
    added = step(page, "add").locator(".notice")
    expect(added).to_have_attribute("data-tone", "warn")
    expect(added.locator(".outcome")).to_contain_text("the forecast did not hold")
    expect(added.locator(".outcome")).to_contain_text("Inside of what the model was trained on the error rose")
    expect(added.locator("[data-side=outside]")).to_contain_text(f"{9.0 * before_mV:.1f}")
    looked_at(page, "improve-not-as-promised")
    page.unroute_all()


def test_an_outcome_is_held_against_what_was_promised(open_page: OpenPage) -> None:
    page = open_page("sim", path="/improve")

    def judged(diagnosis: dict[str, Any], evidence: dict[str, float], *errors_mV: float) -> dict[str, Any]:
        before, after, inside_before, inside_after = errors_mV
        finding = {"evidence": evidence, "error_before_mV": 53.2, "error_after_mV": 9.0}
        added = {
            "error_before_mV": before,
            "error_after_mV": after,
            "inside": {"before_mV": inside_before, "after_mV": inside_after},
        }
        script = """async ([finding, diagnosis, added]) => {
            const { outcome, promise } = await import("/static/improve-forecast.js");
            const told = promise(finding, diagnosis);
            const { good, words } = outcome(added, told);
            return { good, words: words.join(" "), before_mV: told.before_mV };
        }"""
        return page.evaluate(script, [finding, diagnosis, added])

    trained = {"mode": "structure", "train_run_ids": ["a"]}
    own = {"forecast_samples_before_mV": 27.3, "forecast_without_mV": 9.8}
    # Measured drives of a Panasonic cell: next to nothing came, and inside of what the model knew it got worse.
    found = judged(trained, own, 53.15, 53.06, 26.5, 35.8)
    assert found["good"] is False and found["before_mV"] == 27.3
    assert "Forecast 9.0\u202fmV within the trained state of charge, got 35.8\u202fmV there" in found["words"]
    assert "the forecast did not hold" in found["words"] and "the error rose" in found["words"]
    found = judged(trained, own, 53.15, 46.0, 26.5, 9.5)
    assert found["good"] is True and "the forecast held." in found["words"]
    found = judged(trained, {}, 53.2, 33.0, 50.0, 30.0)
    assert found["good"] is True and "held in part" in found["words"]
    # What fell as promised over all, but rose where the model should know, is not well.
    assert judged(trained, {}, 53.2, 10.0, 8.0, 9.0)["good"] is False
    # What was fitted to the very runs is no forecast.
    for diagnosis in ({"mode": "change", "train_run_ids": ["a"]}, {"mode": "structure", "train_run_ids": []}):
        found = judged(diagnosis, {}, 53.2, 50.0, 30.0, 29.0)
        assert found["good"] is False and "orecast" not in found["words"] and "does not carry over" in found["words"]


def test_a_model_from_a_file_and_a_choice_that_cannot_be(
    open_page: OpenPage, address: str, campaign: dict[str, Any], tmp_path: Any
) -> None:
    with BenchClient(address) as client:
        document = client.model_document(campaign["model_id"])
    (tmp_path / "mine.json").write_text(json.dumps(document), encoding="utf-8")
    (tmp_path / "cake.json").write_text('{"kind": "cake"}', encoding="utf-8")
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    page = open_page("sim", PHONE, path="/improve")
    expect(page.get_by_label("Use of hidden: validate")).to_be_visible()
    for name, words in (("cake.json", "not"), ("broken.json", "is not JSON")):
        page.locator("#improve-file").set_input_files(tmp_path / name)
        # The first model that the service reads takes it some seconds.
        expect(complaint(page)).to_contain_text(words)
    page.locator("#improve-file").set_input_files(tmp_path / "mine.json")
    expect(page.get_by_label("Model", exact=True).locator("option:checked")).to_contain_text("mine")
    # Nobody knows what it was made from: no run is proposed.
    expect(page.get_by_label("Use of hidden: validate")).to_have_value("")
    # The card of a run is headed by its name.
    card = page.locator(".run-choice tbody tr").first.locator("td")
    assert card.nth(0).evaluate("(cell) => getComputedStyle(cell).fontWeight") == "600"
    assert card.nth(1).evaluate("(cell) => getComputedStyle(cell).fontWeight") != "600"
    page.get_by_role("button", name="Compare model and runs").click()
    expect(complaint(page)).to_contain_text("at least one run")
    page.get_by_label("Use of hidden: validate").select_option("judge")
    page.get_by_role("button", name="Compare model and runs").click()
    expect(step(page, "compare").locator(".figure strong").first).to_contain_text("mV")
    assert page.evaluate("document.documentElement.scrollWidth") == PHONE["width"]
    looked_at(page, "improve-phone")


def test_a_model_is_made_from_runs_that_are_there(open_page: OpenPage, address: str, campaign: dict[str, Any]) -> None:
    page = open_page("sim", path="/improve")
    page.get_by_label("Model", exact=True).select_option(campaign["model_id"])
    page.get_by_text("Make a model from runs").click()
    form = page.get_by_role("form", name="Fit a model")
    expect(form).to_contain_text("Learns from: hidden: train. Judged by: hidden: validate.")
    expect(form.get_by_label("Capacity of the cell / Ah")).to_have_value("2.5")
    form.get_by_label("Name of the model").fill("made here")
    form.get_by_label("Structure").select_option("minimal")
    form.get_by_label("SoC at the start known within / %").fill("90")
    form.get_by_role("button", name="Fit a model").click()
    expect(form.locator(".form-message")).to_contain_text("0 to 50 %")
    form.get_by_label("SoC at the start known within / %").fill("1")
    form.get_by_role("button", name="Fit a model").click()
    expect(page.get_by_role("progressbar", name="Fitting the model")).to_be_visible()
    expect(page.locator("[data-stage=choose] .chip")).to_have_text("running")
    page.get_by_role("button", name="Cancel: Fitting the model").click()
    expect(page.get_by_text("Fitting the model: cancelled")).to_be_visible()
    expect(page.locator("[data-stage=choose] .chip")).not_to_have_text("running")
    form.get_by_role("button", name="Fit a model").click()
    expect(page.get_by_role("progressbar", name="Fitting the model")).to_be_visible()
    page.reload()
    # A reload follows the work; in the end the new model is compared with the run that it has not seen.
    expect(page.get_by_label("Model", exact=True).locator("option:checked")).to_contain_text(
        "made here", timeout=_LONG_MS
    )
    expect(step(page, "compare").locator(".figure strong").first).to_contain_text("mV", timeout=_LONG_MS)
    looked_at(page, "improve-made")


def test_news_wipe_neither_a_message_nor_what_was_set(
    open_page: OpenPage, address: str, campaign: dict[str, Any], tmp_path: Any
) -> None:
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    late: list[Route] = []

    def hold_all_but_the_first(page: Page) -> None:
        seen = 0

        def answer(route: Route) -> None:
            nonlocal seen
            seen += 1
            if seen == 1:
                route.continue_()
            else:
                late.append(route)

        page.route("**/api/v1/models?limit=200", answer)

    page = open_page("sim", prepare=hold_all_but_the_first, path="/improve")
    page.get_by_label("Use of hidden: train").select_option("judge")
    page.locator("#improve-file").set_input_files(tmp_path / "broken.json")
    message = complaint(page)
    expect(message).to_contain_text("is not JSON")
    assert late, "the page asks for the models again as soon as the benches are known"
    with BenchClient(address) as client:
        newer = client.import_model(client.model_document(campaign["model_id"]))
    for route in late:
        route.continue_()
    expect(page.get_by_label("Model", exact=True).locator(f"option[value='{newer['id']}']")).to_be_attached()
    expect(message).to_contain_text("is not JSON")
    expect(page.get_by_label("Use of hidden: train")).to_have_value("judge")


def test_a_change_is_looked_for_in_runs_that_the_model_was_not_made_from(
    open_page: OpenPage, campaign: dict[str, Any]
) -> None:
    page = open_page("sim", path="/improve")
    page.get_by_label("Model", exact=True).select_option(campaign["model_id"])
    page.get_by_text("What has changed?").click()
    expect(page.get_by_label("Use of hidden: train")).to_have_value("")
    expect(page.get_by_label("Use of hidden: validate")).to_have_value("judge")
    page.get_by_role("button", name="Compare model and runs").click()
    page.get_by_role("button", name="Find out what has changed").click()
    # Nothing has: the run that was held out is of the same cell on the same day.
    expect(step(page, "which").locator(".verdict")).to_contain_text("Nothing significant has changed", timeout=_LONG_MS)
    expect(step(page, "which").locator(".finding")).to_have_count(0)


@pytest.mark.usefixtures("campaign")
def test_a_module_is_made_from_runs_and_its_weak_group_named(open_page: OpenPage, address: str, tmp_path: Path) -> None:
    with BenchClient(address) as client:
        for name, seed in (("module a", 1), ("module b", 2)):
            upload = client.upload_file(truth.written(tmp_path / f"{name}.csv", seed))
            client.store_import(upload["id"], truth.CAPACITY_AH, 0.6, name=name, timeout_s=LONG_S)
    page = open_page("sim", path="/improve")
    for use in page.get_by_role("combobox", name=re.compile("^Use of hidden")).all():
        use.select_option("")
    page.get_by_label("Use of module a").select_option("train")
    page.get_by_label("Use of module b").select_option("judge")
    page.get_by_text("Make a model from runs").click()
    form = page.get_by_role("form", name="Fit a model")
    expect(form.get_by_label("Cells in parallel")).to_be_hidden()
    form.get_by_label("The runs are of a module").check()
    form.get_by_label("Capacity of the module / Ah").fill(str(truth.CAPACITY_AH))
    form.get_by_label("Structure").select_option("minimal")
    form.get_by_label("Cells in parallel").fill("two")
    form.get_by_role("button", name="Fit a model").click()
    expect(form.locator(".form-message")).to_contain_text("cells in parallel as a whole number")
    looked_at(page, "improve-module-form")
    form.get_by_label("Cells in parallel").fill(str(truth.PARALLEL))
    form.get_by_role("button", name="Fit a model").click()
    compared = step(page, "compare")
    kinds = compared.get_by_role("region", name="Module models")
    expect(kinds.locator("tbody tr")).to_have_count(4, timeout=_LONG_MS)
    expect(kinds).to_contain_text("S3 (taken)")
    expect(compared.get_by_role("region", name="Groups in series").locator("tbody tr")).to_have_count(truth.SERIES)
    expect(compared.locator(".weak-group")).to_contain_text("Weak: group 2 is empty after")
    expect(step(page, "where")).to_contain_text("A diagnosis is of one cell's model")
    expect(page.get_by_role("button", name="Find out what")).to_have_count(0)
    looked_at(page, "improve-module")
