"""A demo tells all that its campaign came to, also where the last step failed, and opens the seal."""

import io
from typing import Any

import pytest
from rich.console import Console

from bench_service.campaign.progress import campaign_result
from bench_service.cli.commands.demo import watcher
from bench_service.cli.demo_report import demo_answer, show_demo
from simulators.hidden_effect import HiddenEffect
from tests.unit.bench_service.campaign.test_progress import SOC, ended

HIDDEN = HiddenEffect("hysteresis", 0.03, 0.004, "salt")
DIAGNOSIS = {
    "verdict": "missing",
    "findings": [{"effect": "hysteresis", "rank": 1, "confidence": 0.9, "explanation": "a loop"}],
}


def record(state: str, result: dict[str, Any] | None) -> dict[str, Any]:
    stages = [{"name": "diagnose", "state": state, "detail": "", "seconds": 1.0}]
    return {"state": state, "message": "the addition broke", "stages": stages, "result": result}


def told(found: dict[str, Any]) -> tuple[dict[str, Any], str]:
    answer = demo_answer(found, HIDDEN, 12.0) | {"data": "there"}
    out = io.StringIO()
    show_demo(Console(file=out, width=200), found, answer)
    return answer, out.getvalue()


@pytest.mark.parametrize("state", ["completed", "failed"])
def test_a_diagnosis_is_told_whatever_came_after_it(state: str) -> None:
    answer, text = told(record(state, campaign_result(ended(diagnosis=DIAGNOSIS), SOC)))
    assert answer["diagnosed_effect"] == "hysteresis" and len(answer["model_chain"]) == 2
    assert "1. hysteresis, confidence 90 %" in text and "5.00 mV on a run that it never saw" in text
    assert ("ended as failed: the addition broke" in text) == (state == "failed")
    assert "The seal is opened: hysteresis, 0.03 V where the cell had 0.004" in text
    assert HIDDEN.seal in text


def test_the_seal_is_opened_where_there_is_nothing_else() -> None:
    answer, text = told(record("failed", None))
    assert answer["runs"] == [] and answer["diagnosed_effect"] is None
    assert answer["seal"]["contents"] == HIDDEN.contents
    assert "The seal is opened" in text


def test_figures_of_stages_that_were_not_reached_are_left_out() -> None:
    _, text = told(record("failed", campaign_result(ended(comparison=None), None)))
    assert "training run" in text and "never saw" not in text and "observer" not in text


def test_stages_are_told_once_as_they_end_where_no_bar_is_seen(capsys: pytest.CaptureFixture[str]) -> None:
    stages = [{"name": "design", "state": "running", "detail": "half", "seconds": 3.0}]
    stages.append({"name": "play", "state": "waiting", "detail": "", "seconds": None})
    found = {"progress": 0.1, "stage": "design", "message": "half", "stages": stages}
    seen: list[float] = []
    watch = watcher(lambda share, _text: seen.append(share), in_lines=True)
    watch(found)
    stages[0] |= {"state": "done", "detail": "1200 s", "seconds": 4.4}
    watch(found)
    watch(found | {"progress": 0.2})
    assert capsys.readouterr().out == "design: done after 4 s. 1200 s\n"
    watcher(lambda *_: None, in_lines=False)(found)
    assert capsys.readouterr().out == "" and seen == [0.1, 0.1, 0.2]
