"""Which stages a campaign has, and which profiles they play."""

from dataclasses import replace

import pytest

from bench_service.campaign.plan import CHANGED, CHANGED_VALIDATE, TRAIN, VALIDATE, plan_profiles
from bench_service.campaign.request import CampaignRequest
from bench_service.campaign.story import overall_progress, stages_of

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
    assert stages_of(replace(PLAIN, diagnose="structure"))[-2:] == ("diagnose", "report")
    assert stages_of(replace(PLAIN, diagnose="change"))[-3:] == ("change", "diagnose", "report")


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
