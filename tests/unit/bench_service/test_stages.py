"""Which stages a campaign has, and which profiles they play."""

from dataclasses import replace

import pytest

from bench_service.bench.limits import Limits
from bench_service.campaign.designing import round_request
from bench_service.campaign.plan import CHANGED, CHANGED_VALIDATE, TRAIN, VALIDATE, plan_profiles
from bench_service.campaign.request import CampaignRequest
from bench_service.campaign.stages import overall_progress, stages_of
from models.design.request import read_request

PLAIN = CampaignRequest(
    bench="sim",
    name="test",
    seed=1,
    dt_s=1.0,
    duration_s=15_000.0,
    capacity_Ah=2.5,
    current_A=(-5.0, 2.5),
    soc=(0.1, 0.9),
    initial_soc=0.5,
    initial_soc_from="the request",
    structure="full",
)


def test_a_campaign_diagnoses_only_when_asked() -> None:
    assert stages_of(PLAIN) == ("design", "run", "fit", "observe", "compare", "report")
    assert stages_of(replace(PLAIN, rounds=2))[:5] == ("design", "run", "fit", "rounds", "observe")
    assert stages_of(replace(PLAIN, diagnose="structure"))[-2:] == ("diagnose", "report")
    assert stages_of(replace(PLAIN, diagnose="change"))[-3:] == ("change", "diagnose", "report")


def test_what_follows_the_rounds_is_planned_from_where_they_left_the_cell() -> None:
    request = replace(PLAIN, rounds=2, diagnose="change")
    profiles = plan_profiles(request, 0.81, played=True)
    assert tuple(profiles) == (VALIDATE, CHANGED, CHANGED_VALIDATE)
    soc = profiles[VALIDATE].soc(0.81, 2.5)
    assert 0.05 < soc.min() < soc.max() < 0.95


def test_a_round_asks_for_a_sequence_within_campaign_and_bench() -> None:
    limits = Limits((2.5, 4.2), (-6.0, 3.0), (0.0, 50.0), (0.05, 0.95), 4.0, 20_000.0)
    asked = round_request(PLAIN, limits, "model", 0.905, 2)
    written = read_request(asked)
    assert written.limits.current_A == (-5.0, 2.5) and written.limits.voltage_V == (2.5, 4.2)
    assert written.limits.soc == (0.1, 0.905) and written.limits.ramp_A_per_s == (-4.0, 4.0)
    assert written.model == "model" and len(written.soc_levels) == 8 and written.seed != PLAIN.seed
    assert "ramp_A_per_s" not in round_request(PLAIN, replace(limits, ramp_A_per_s=None), "model", 0.5, 2)["limits"]


@pytest.mark.parametrize("diagnose", [None, "structure", "change"])
def test_progress_grows_from_0_to_1_over_the_stages(diagnose: str | None) -> None:
    stages = stages_of(replace(PLAIN, diagnose=diagnose))  # type: ignore[arg-type]
    seen = [overall_progress(stages, stage, share) for stage in stages for share in (0.0, 0.5, 1.0)]
    assert seen == sorted(seen)
    assert seen[0] == 0.0
    assert seen[-1] == pytest.approx(1.0)


def test_what_has_changed_needs_two_more_profiles_from_where_that_cell_stands() -> None:
    request = replace(PLAIN, diagnose="change", changed_bench="later", changed_initial_soc=0.7)
    profiles = plan_profiles(request)
    assert tuple(profiles) == (TRAIN, VALIDATE, CHANGED, CHANGED_VALIDATE)
    soc = profiles[CHANGED].soc(0.7, request.capacity_Ah)
    assert 0.05 < soc.min() < soc.max() < 0.95
    assert plan_profiles(PLAIN)[TRAIN].current_A.tolist() == profiles[TRAIN].current_A.tolist()


def test_on_the_same_bench_the_next_profile_begins_where_the_last_one_ended() -> None:
    request = replace(PLAIN, diagnose="change")
    profiles = plan_profiles(request)
    end = profiles[VALIDATE].soc(profiles[TRAIN].soc(0.5, 2.5)[-1], 2.5)[-1]
    soc = profiles[CHANGED].soc(end, 2.5)
    assert 0.05 < soc.min() < soc.max() < 0.95
