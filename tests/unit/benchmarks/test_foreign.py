"""Cells outside of the models' class: logs, effects of a wanted size, and what is counted."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

from foreign_cells import KINDS, SOC, changed, effects_of, logged, make_plan, profile_A, random_rig, true_columns  # noqa: E402
from foreign_summary import figures, not_misled, wrong_and_sure  # noqa: E402


@pytest.mark.parametrize("kind", KINDS)
def test_a_profile_stays_in_its_window_and_moves(kind: str) -> None:
    for seed in range(5):
        current = profile_A(kind, 2.0, 0.5, np.random.default_rng(seed), 4000)
        soc = 0.5 + np.cumsum(current) / 7200.0
        assert len(current) == 4000 and np.ptp(soc) > 0.05
        # The least of a segment is played on before it turns round.
        assert soc.min() > SOC[0] - 0.05 and soc.max() < SOC[1] + 0.05


@pytest.mark.parametrize("family", ["particle", "spread"])
def test_a_log_begins_in_the_middle_and_is_the_same_for_the_same_seed(family: str) -> None:
    rig, plan = (
        random_rig(family, np.random.default_rng(1)),
        make_plan("drive", 3.0, np.random.default_rng(2), 200),
    )
    columns = true_columns(rig, plan)
    again = true_columns(rig, plan)
    np.testing.assert_array_equal(columns[0], again[0])
    run = logged(rig, plan, columns, 5)
    assert np.sqrt(np.mean((run.voltage_V - columns[0]) ** 2)) < 0.01
    np.testing.assert_array_equal(run.voltage_V, logged(rig, plan, columns, 5).voltage_V)
    # What was before the log still relaxes in it.
    rested = true_columns(rig, type(plan)(columns[3], plan.history_A[:0], plan.logged_A, plan.phase))
    assert np.abs(rested[0] - columns[0]).max() > 1e-4


def test_each_effect_of_the_bench_changes_the_log() -> None:
    rig, plan = random_rig("spread", np.random.default_rng(1)), make_plan("pulses", 3.0, np.random.default_rng(2), 100)
    columns = true_columns(rig, plan)
    before = logged(rig, plan, columns, 5)
    for name in ("current_offset", "dead_time", "temperature_sensor", "voltage_offset"):
        assert name in effects_of("spread")
        after = logged(changed(rig, name, 0.5), plan, columns, 5)
        assert any(
            not np.array_equal(getattr(before, column), getattr(after, column))
            for column in ("voltage_V", "current_A", "temperature_degC")
        )


def row(truth: str | None, named: str, **more: object) -> dict[str, object]:
    right = named == (truth or "none")
    given = {
        "family": "spread",
        "truth": [truth] if truth else [],
        "named": [named],
        "right": right,
        "verdict": "missing",
        "rivals": [],
        "ambiguous_with_truth": False,
        "confidence": [0.95],
        "size": None,
        "change": None,
        "power": None,
        "shows": 0.0,
        "diagnosis_s": 1.0,
    }
    return given | more


def test_what_is_counted() -> None:
    rows = [
        row(None, "none", confidence=[]),
        row(None, "unknown_effect", confidence=[]),
        row("capacity", "capacity", size={"true": 1.0, "value": 1.3, "std": 0.2}),
        row("hysteresis", "relaxation"),
        row("hysteresis", "relaxation", ambiguous_with_truth=True, rivals=["hysteresis"], confidence=[0.6]),
        row("hysteresis", "none", verdict="nothing_missing", confidence=[]),
        row("hysteresis", "unknown_effect", confidence=[]),
    ]
    found = figures(rows)
    assert (found["nulls"], found["false_alarms"]) == (2, 1)
    assert (found["cases"], found["named_first"], found["not_misled"], found["nothing_found"]) == (5, 1, 3, 1)
    assert (found["wrong_above_0.9"], found["sizes"], found["sizes_within_two_std"]) == (1, 1, 1)
    assert [(each["findings"], each["right"]) for each in found["reliability"]] == [(1, 0.0), (2, 0.5)]
    assert found["by_effect"]["hysteresis"] == [0, 4]


def test_four_names_are_as_good_as_none() -> None:
    several = row("hysteresis", "relaxation", ambiguous_with_truth=True, rivals=["a", "b", "hysteresis"])
    assert not not_misled(several) and wrong_and_sure(several)


def test_sizes_below_the_stated_power_are_told_apart() -> None:
    seen = {"size": 0.003, "rms_mV": 5.0, "rms_K": 0.8}
    below = [
        row("a", "a", change=0.001, power=seen),
        row("a", "a", shows=4.0, power=seen),
        row("heat_transfer", "a", shows=0.7, power=seen),
        row("a", "a", shows=20.0, power=seen | {"size": None, "rms_mV": None}),
    ]
    above = [
        row("a", "none", change=-0.004, power=seen),
        row("a", "none", shows=6.0, power=seen),
        row("heat_transfer", "a", shows=0.9, power=seen),
        row("a", "a"),
    ]
    assert figures(below)["above_power"] == {"cases": 0, "named_first": 0, "not_misled": 0}
    assert figures([*above, *below])["above_power"] == {"cases": 4, "named_first": 1, "not_misled": 1}
