"""Cases of the ageing benchmark: one follows from its number, and what is named is held against what was lost."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[3] / "benchmarks"))

from ageing_pybamm import KINDS, RIGHT, beside_truth, measured, request_of, told  # noqa: E402

LAST = {"named": ["lithium_loss"], "values": [{"share_lost": 0.09, "capacity_Ah": 4.6}]}


def test_a_case_follows_from_its_number_and_ages_by_its_kind_alone() -> None:
    for kind in KINDS:
        request = request_of(3, 7, kind)
        assert request == request_of(3, 7, kind)
        fresh, half, whole = request["states"]
        grown = {name for name in whole if name != "cycles" and whole[name] > fresh[name]}
        wanted = {"resistance": {"contact_Ohm"}, "sei": {"lithium_lost", "film_Ohm"}}.get(kind, {f"{kind}_lost"})
        assert grown == wanted and all(fresh[name] < half[name] < whole[name] for name in grown)
    assert len(request_of(3, 7, "none")["states"]) == 1


def test_what_is_named_is_held_against_what_was_lost() -> None:
    request = request_of(3, 7, "lithium")
    whole = request["states"][-1] | {"lithium_lost": 0.1}
    assert beside_truth({"first": "lithium_loss"}, LAST, whole, request)["close"]
    assert not beside_truth({"first": "lithium_loss"}, LAST, whole | {"lithium_lost": 0.12}, request)["close"]
    other = request_of(3, 7, "negative")
    assert not beside_truth({"first": "lithium_loss"}, LAST, other["states"][-1], other)["right"]
    row = {"kind": "lithium", "drive": False, "parameters": "Chen2020", "false": [True, False], "right": True}
    assert told([row | {"close": True}])["false"] == 1
    assert set(RIGHT) == set(KINDS)


def test_sensors_are_what_a_bench_has() -> None:
    columns = np.column_stack([np.arange(500.0), np.full(500, -2.0), np.full(500, 3.7), np.full(500, 25.0)])
    run = measured(columns, request_of(3, 7, "none"), "x", np.random.default_rng(0), 1.001)
    assert abs(run.current_A.mean() + 2.002) < 1e-3 and 2e-4 < run.voltage_V.std() < 1e-3
