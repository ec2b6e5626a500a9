"""What a stage of a campaign asks of those who do the work."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

from bench_service.campaign.modelling import FitOrder
from bench_service.campaign.plan import TRAIN
from bench_service.campaign.progress import Progress
from bench_service.campaign.stages import stages_of
from bench_service.campaign.story import Story
from bench_service.campaign.workshop import Workshop
from bench_service.jobs.runner import Job
from tests.unit.bench_service.api.route_rig import run_record
from tests.unit.bench_service.test_stages import PLAIN

METRICS = {"n_local_models": 50, "seconds": 1.0, "train": {"rmse_mV": 2.0}, "expected_rmse_mV": 2.5}


def test_a_fit_leaves_out_what_the_campaign_was_asked_to_leave_out() -> None:
    orders: list[FitOrder] = []

    async def start_fit(order: FitOrder) -> Job:
        orders.append(order)
        return Job("j1", "fit", "done", result={"model_id": "m1", "metrics": METRICS})

    bench = SimpleNamespace(summary=lambda: {"lock_step": True})
    parts: dict[str, Any] = {
        "modelling": SimpleNamespace(start_fit=start_fit),
        "benches": SimpleNamespace(get=lambda _name: bench),
    }
    nothing = dict.fromkeys(("store", "samples", "runs", "diagnosing", "designing", "jobs"))
    workshop = cast(Workshop, SimpleNamespace(**(nothing | parts)))
    request = replace(PLAIN, structure="bounded", without=("hysteresis", "relaxation"))
    story = Story(
        workshop, "c1", request, lambda *_news: None, Progress(parts={TRAIN: [run_record(id="r1", n_samples=100)]})
    )
    asyncio.run(story.tell([stage for stage in stages_of(request) if stage != "fit"]))
    (order,) = orders
    assert (order.structure, order.without, order.train) == ("bounded", ("hysteresis", "relaxation"), ["r1"])
