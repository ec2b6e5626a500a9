"""What a campaign may ask of a bench, and what is filled in for it."""

import json
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from bench_service.bench.limits import Limits
from bench_service.bench.listener import BenchStatus
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.campaign.benches import Bench
from bench_service.campaign.plan import check_plan, plan_profiles
from bench_service.campaign.request import CampaignRequest, complete
from bench_service.campaign.standing import Standing
from bench_service.config import BenchConfig, LimitsConfig, SimulateConfig
from bench_service.errors import BadRequestError
from models.data.errors import ModelError

LIMITS = Limits((2.5, 4.2), (-6.0, 3.0), (-20.0, 60.0), (0.05, 0.95), None, 20_000.0)
REQUEST = CampaignRequest(
    bench="b",
    name="c",
    seed=1,
    dt_s=1.0,
    duration_s=15_000.0,
    capacity_Ah=2.5,
    current_A=(-5.0, 2.5),
    soc=(0.1, 0.9),
    initial_soc=0.5,
    initial_soc_from="the request",
    structure="minimal",
)


class NamedOnly:
    """As much of a supervisor as a request looks at."""

    name = "b"
    status = BenchStatus("idle")


def bench(config: BenchConfig) -> Bench:
    limits = Limits.from_json(config.limits.model_dump())
    return Bench(config, "modbus-tcp://127.0.0.1:1", limits, cast(BenchSupervisor, NamedOnly()))


SIMULATED = BenchConfig(simulate=SimulateConfig(initial_soc=0.7))
REAL = BenchConfig(
    url="modbus-tcp://127.0.0.1:1",
    capacity_Ah=2.5,
    limits=LimitsConfig(voltage_V=(2.5, 4.2), current_A=(-10.0, 5.0), temperature_degC=(-20.0, 60.0)),
)


def test_a_plan_within_the_limits_is_admitted_and_always_the_same() -> None:
    check_plan(REQUEST, LIMITS, 2.5)
    once, again = plan_profiles(REQUEST), plan_profiles(REQUEST)
    assert list(once) == ["train", "validate"]
    for role, profile in once.items():
        np.testing.assert_array_equal(profile.current_A, again[role].current_A)
    assert (
        len(once["train"].time_s) != len(once["validate"].time_s)
        or (once["train"].current_A != once["validate"].current_A).any()
    )


@pytest.mark.parametrize(
    ("changes", "where", "message"),
    [
        (
            {"current_A": (-6.1, 2.0)},
            ("current_A",),
            "allows at current_A: -6.1 to 2 A, limit -6 to 3 A",
        ),
        ({"current_A": (-5.0, 3.1)}, ("current_A",), "wider than the bench"),
        ({"current_A": (2.0, -2.0)}, ("current_A",), "low end must be below"),
        ({"soc": (0.0, 0.9)}, ("soc",), "wider than the bench"),
        ({"soc": (0.9, 0.1)}, ("soc",), "low end must be below"),
        (
            {"initial_soc": 0.95},
            ("initial_soc",),
            "outside the window .*: 0.95, limit 0.1 to 0.9",
        ),
        ({"duration_s": 20_001.0}, ("duration_s",), "limit 20000 s; shorten"),
        ({"duration_s": 1e300}, ("duration_s",), "limit 20000 s; shorten"),
        ({"dt_s": 16.0}, ("dt_s",), "15000 s hold 938 samples"),
        ({"dt_s": 1e-4}, ("dt_s",), "hold 150000000 samples"),
    ],
)
def test_what_leaves_the_bench_is_refused_by_name(changes: dict[str, Any], where: tuple[str], message: str) -> None:
    with pytest.raises(BadRequestError, match=message) as refusal:
        check_plan(replace(REQUEST, **changes), LIMITS, 2.5)
    assert refusal.value.where == where


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"duration_s": 3000.0}, "3000 s do not suffice .* at least [0-9]+ s are needed"),
        ({"current_A": (-5.0, 0.0)}, "must have 0 between them"),
        ({"soc": (0.45, 0.5)}, "narrower"),
    ],
)
def test_a_plan_that_contradicts_itself_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        check_plan(replace(REQUEST, **changes), LIMITS, 2.5)


def test_both_profiles_are_checked_as_their_runs_will_be() -> None:
    with pytest.raises(BadRequestError, match="changes too fast"):
        check_plan(REQUEST, replace(LIMITS, ramp_A_per_s=0.5), 2.5)
    # The bench counts with its own capacity: of a cell believed to be larger, the plan would empty this one.
    with pytest.raises(BadRequestError, match="state of charge leaves the window"):
        check_plan(replace(REQUEST, capacity_Ah=3.5, duration_s=20_000.0), LIMITS, 2.5)


def test_a_start_that_counting_has_put_just_outside_the_window_is_taken() -> None:
    check_plan(replace(REQUEST, initial_soc=0.0995, duration_s=17_500.0), LIMITS, 2.5)


def test_the_start_is_the_requests_then_the_last_runs_then_the_configurations() -> None:
    last = Standing(0.31, "the end of run r")
    stated = complete(bench(SIMULATED), {"bench": "b", "initial_soc": 0.2}, last)
    assert (stated.initial_soc, stated.initial_soc_from) == (0.2, "the request")
    for config in (SIMULATED, REAL):
        followed = complete(bench(config), {"bench": "b"}, last)
        assert (followed.initial_soc, followed.initial_soc_from) == (0.31, "the end of run r")
    assert complete(bench(SIMULATED), {"bench": "b"}, None).initial_soc == 0.7
    with pytest.raises(BadRequestError, match="give initial_soc") as refusal:
        complete(bench(REAL), {"bench": "b"}, None)
    assert refusal.value.where == ("initial_soc",)


def test_what_is_left_out_lies_within_the_bench() -> None:
    request = complete(bench(SIMULATED), {"bench": "b", "name": None, "current_A": (-1.0, 1.0)}, None)
    assert (request.current_A, request.soc, request.name) == ((-1.0, 1.0), (0.1, 0.9), "campaign on b")
    check_plan(complete(bench(SIMULATED), {"bench": "b"}, None), bench(SIMULATED).limits, 2.5)


def test_what_follows_the_rounds_is_checked_before_they_are_played() -> None:
    tight = replace(REQUEST, initial_soc=0.9, duration_s=12_500.0)
    check_plan(tight, LIMITS, 2.5)
    with pytest.raises(ModelError, match="do not suffice"):
        check_plan(replace(tight, rounds=2), LIMITS, 2.5)


@pytest.mark.parametrize(
    "changes",
    [{}, {"initial_soc": 0.1}, {"initial_soc": 0.9}, {"current_A": (-1.0, 0.5)}, {"initial_soc": 0.9, "rounds": 2}],
)
def test_the_duration_that_is_left_out_suffices(changes: dict[str, Any]) -> None:
    request = complete(bench(SIMULATED), {"bench": "b"} | changes, None)
    check_plan(request, bench(SIMULATED).limits, 2.5)
    assert request.duration_s >= 14_000.0


def test_effects_are_left_out_of_a_campaign_s_model_and_kept_in_its_record() -> None:
    given = {"bench": "b", "structure": "bounded", "without": ["relaxation", "hysteresis", "relaxation"]}
    request = complete(bench(SIMULATED), given, None)
    assert request.without == ("relaxation", "hysteresis")
    assert CampaignRequest.from_json(json.loads(json.dumps(request.to_json()))) == request
    assert complete(bench(SIMULATED), {"bench": "b", "without": ["hysteresis"]}, None).structure == "auto"
    plain = complete(bench(SIMULATED), {"bench": "b"}, None)
    assert plain.without == ()
    former = {name: value for name, value in plain.to_json().items() if name != "without"}
    assert CampaignRequest.from_json(former) == plain


@pytest.mark.parametrize(
    ("structure", "without", "told"),
    [
        (
            "full",
            ["hysteresis"],
            "out of a bounded network only, not of structure 'full'.*choose structure bounded or auto",
        ),
        (
            "bounded",
            ["capacity"],
            "effect capacity cannot be left out of a bounded network; it can do without .*relaxation",
        ),
        ("auto", ["phlogiston"], "effect phlogiston cannot be left out"),
    ],
)
def test_what_cannot_be_left_out_is_refused_before_anything_is_played(
    structure: str, without: list[str], told: str
) -> None:
    with pytest.raises(BadRequestError, match=told) as refused:
        complete(bench(SIMULATED), {"bench": "b", "structure": structure, "without": without}, None)
    assert refused.value.where == ("without",)


def test_a_bench_with_a_watchdog_has_ticks_between_its_samples() -> None:
    real, simulated = bench(REAL), bench(SIMULATED)
    assert real.tick_s(3.0) == pytest.approx(1 / 3) and simulated.tick_s(3.0) == 3.0
    steep = Limits((2.5, 4.2), (-6.0, 3.0), (-20.0, 60.0), (0.05, 0.95), 0.9, 20_000.0)
    real.limits = simulated.limits = steep
    # What a design may change by in a sample is what one tick may.
    assert real.sampled_limits(3.0).ramp_A_per_s == pytest.approx(0.1)
    assert simulated.sampled_limits(3.0).ramp_A_per_s == 0.9
    real.limits = LIMITS
    assert real.sampled_limits(3.0).ramp_A_per_s is None


def test_the_ramp_of_a_plan_counts_between_its_ticks() -> None:
    steep = replace(LIMITS, ramp_A_per_s=8.0)
    check_plan(REQUEST, steep, 2.5)
    with pytest.raises(BadRequestError, match=r"changes too fast .*limit 8 A/s"):
        check_plan(REQUEST, steep, 2.5, tick_s=1 / 3)
