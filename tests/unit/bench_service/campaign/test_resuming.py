"""What is left of a run that was cut off, and when it is played."""

from typing import Any

import numpy as np
import pytest

from bench_service.bench.latch import INTERRUPTIONS, OF_RUNS, Latch
from bench_service.bench.listener import BenchStatus
from bench_service.campaign import starting_again
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.resuming import Policy, check_resumable, left_to_resume, played_of, rest_of, tried
from bench_service.campaign.starting import Start
from bench_service.campaign.workshop import CampaignFailedError, CampaignStoppedError
from bench_service.errors import BenchBusyError, ConflictError
from bench_service.jobs.runner import WORKER_DIED
from bench_service.store.records import CampaignRecord
from bench_service.streams import Flag
from tests.unit.bench_service.api.route_rig import Store, run_record

TIME_S, CURRENT_A = np.array([0.0, 10.0, 20.0, 30.0]), np.array([1.0, -2.0, 0.5, 0.0])


@pytest.mark.parametrize(
    ("played_s", "time_s", "current_A"),
    [
        (0.0, [0, 10, 20, 30], [1, -2, 0.5, 0]),
        (4.0, [0, 6, 16, 26], [1, -2, 0.5, 0]),
        (10.0, [0, 10, 20], [-2, 0.5, 0]),  # the sample at 10 s was taken before the set-point of 10 s
        (13.3, [0, 7, 17], [-2, 0.5, 0]),  # late by a part of a tick
        (29.0, [0, 1], [0.5, 0]),
    ],
)
def test_it_goes_on_at_the_tick_of_the_last_sample(played_s: float, time_s: list, current_A: list) -> None:
    left = rest_of(TIME_S, CURRENT_A, played_s, 1.0)
    assert left is not None
    np.testing.assert_allclose(left[0], time_s)
    np.testing.assert_allclose(left[1], current_A)


def test_the_charge_of_both_parts_is_that_of_the_whole() -> None:
    def charge(time_s: np.ndarray, current_A: np.ndarray) -> float:
        return float(np.sum(np.diff(time_s) * current_A[:-1]))

    for played_s in np.arange(0.0, 29.5, 0.5):
        left = rest_of(TIME_S, CURRENT_A, played_s, 0.5)
        assert left is not None and left[0][-1] == pytest.approx(30.0 - played_s)
        ticks = np.arange(0.0, played_s, 0.5)
        before = 0.5 * sum(CURRENT_A[np.searchsorted(TIME_S, tick, side="right") - 1] for tick in ticks)
        assert before + charge(*left) == pytest.approx(charge(TIME_S, CURRENT_A))


@pytest.mark.parametrize(("n", "played_s"), [(4, 3.0), (5, 4.0), (7, 4.0), (8, 4.0), (9, 5.0), (12, 8.0)])
def test_a_pause_is_not_played(n: int, played_s: float) -> None:
    """Held at 4 s, let go at 7 s: the sample at 4 s is the first with the output off, that at 7 s the last."""
    flags = np.zeros(12, np.uint32)
    flags[[4, 5, 6]] = Flag.PAUSED | Flag.SETTLING
    time_s = np.arange(12) + np.tile([0.0, 0.3, -0.2], 4)  # late by parts of a tick
    assert played_of({"time_s": time_s[:n], "flags": flags[:n]}, 1.0) == played_s
    assert played_of({"time_s": time_s[:n], "flags": np.zeros(n, np.uint32)}, 1.0) == n - 1.0


@pytest.mark.parametrize("played_s", [29.6, 30.0, 31.0])
def test_nothing_is_left_of_one_that_was_all_but_played(played_s: float) -> None:
    assert rest_of(TIME_S, CURRENT_A, played_s, 1.0) is None


def ended(state: str, n_samples: int = 10, reason: str = "because"):  # noqa: ANN201
    return run_record(state=state, n_samples=n_samples, reason=reason)


def test_only_what_was_declared_goes_on() -> None:
    assert Policy(True).take("train", ended("interrupted")) == INTERRUPTIONS
    not_stored = ended("fault", reason="the recorder is gone; samples cannot be stored")
    assert Policy(True, retries=1).take("train", not_stored) == INTERRUPTIONS
    for policy, run in ((Policy(False), ended("interrupted")), (Policy(True), ended("fault", reason="too warm"))):
        with pytest.raises(CampaignFailedError, match="the train run ended as"):
            policy.take("train", run)
    with pytest.raises(CampaignStoppedError):
        Policy(True, 5).take("train", ended("stopped"))


def test_faults_are_tried_again_as_often_as_was_declared() -> None:
    policy = Policy(False, retries=2)
    assert policy.take("train", ended("fault")) == OF_RUNS
    policy.take("train", ended("fault"))
    with pytest.raises(CampaignFailedError):
        policy.take("train", ended("fault"))


def test_what_gets_no_further_ends() -> None:
    policy = Policy(True)
    policy.take("train", ended("interrupted", 0))
    policy.take("train", ended("interrupted", 0))
    policy.take("train", ended("interrupted", 5))
    policy.take("train", ended("interrupted", 0))
    policy.take("train", ended("interrupted", 0))
    with pytest.raises(CampaignFailedError):
        policy.take("train", ended("interrupted", 0))


def campaign(state: str, declared: str = "resume", **changes: object) -> CampaignRecord:
    fields: dict = {"id": "c", "name": "c", "bench": "a", "state": state, "stage": "run", "stages": ()}
    fields |= {"request": {"on_interruption": declared}, "created_utc": "", "code_version": "", "done": {}}
    return CampaignRecord(**(fields | changes))


def test_a_start_of_the_service_goes_on_with_the_last_campaign_of_a_bench_where_it_was_cut_off() -> None:
    def left(*records: CampaignRecord) -> CampaignRecord | None:
        return left_to_resume(Store(campaigns={"page": list(records)}), "a")  # pyright: ignore[reportArgumentType]

    cut_off = campaign("interrupted")
    assert left(campaign("queued"), cut_off) is cut_off
    assert left(campaign("completed", bench="b"), campaign("running")) is not None
    for other in ("stopped", "failed", "completed"):
        assert left(campaign(other), cut_off) is None
    assert left(campaign("interrupted", "stop")) is None and left() is None


def test_an_operator_goes_on_with_what_can_go_on() -> None:
    check_resumable(campaign("failed", "stop"), 0, run_record(number=7))
    for record, cell, told in (
        (campaign("completed"), 0, "nothing to go on with"),
        (campaign("failed", done=None), 0, "start it anew"),
        (campaign("interrupted"), 7, "begun anew"),
    ):
        with pytest.raises(ConflictError, match=told):
            check_resumable(record, cell, run_record(number=7))


@pytest.mark.parametrize(("policy", "deaths", "done"), [(Policy(True), 2, True), (Policy(True), 3, False)])
async def test_a_worker_that_died_is_replaced_where_that_was_declared(policy: Policy, deaths: int, done: bool) -> None:
    left = [deaths]

    async def work() -> str:
        if left[0]:
            left[0] -= 1
            raise CampaignFailedError(f"the fit failed: {WORKER_DIED}; see the log")
        return "made"

    if done:
        assert await tried(policy, work) == "made"
    else:
        with pytest.raises(CampaignFailedError):
            await tried(policy, work)


@pytest.mark.parametrize(("policy", "told"), [(Policy(False), WORKER_DIED), (Policy(True), "too few samples")])
async def test_any_other_failure_is_one_at_once(policy: Policy, told: str) -> None:
    calls: list[int] = []

    async def work() -> None:
        calls.append(1)
        raise CampaignFailedError(told)

    with pytest.raises(CampaignFailedError):
        await tried(policy, work)
    assert len(calls) == 1


class Latching:
    """A bench that is latched, its supervisor and all benches in one."""

    def __init__(self, *latches: Latch) -> None:
        self.latches, self.acknowledged = list(latches), []
        self.waiting = Start("b")

    supervisor = property(lambda self: self)

    def get(self, _name: str) -> "Latching":
        return self

    @property
    def status(self) -> BenchStatus:
        return BenchStatus.in_fault(self.latches[0]) if self.latches else BenchStatus("idle")

    async def acknowledge(self, _name: str) -> None:
        if self.latches:
            self.acknowledged.append(self.latches.pop(0).code)

    async def start(self, _order: RunOrder) -> Any:
        if self.latches:
            raise BenchBusyError(f"bench 'b' has a fault: {self.latches[0].text}; acknowledge it first")
        return run_record(id="r2")


async def started_again(bench: Latching, said: list[str], person: Any = None, timeout_s: float = 60.0) -> Any:
    order = RunOrder(bench="b", profile_id="p", dt_s=1.0, initial_soc=0.5)

    def say(text: str, waits: bool) -> None:
        said.append(text)
        if waits and person is not None:
            person()

    return await starting_again.start_again(
        bench,  # pyright: ignore[reportArgumentType]
        order,
        bench.waiting,
        bench.start,
        say,
        declared=INTERRUPTIONS,
        timeout_s=timeout_s,
    )


async def test_the_interruption_itself_is_acknowledged_and_nothing_else_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starting_again, "_TRY_S", 0.0)
    bench, said = Latching(Latch("interrupted", "run x was interrupted")), []
    assert (await started_again(bench, said)).id == "r2"
    assert bench.acknowledged == ["interrupted"] and "as soon as bench 'b' is ready" in said[0]
    for code in ("other_device", "at_rest", "run_fault", "commissioning", "unknown"):
        bench, said = Latching(Latch("interrupted", "run x was interrupted"), Latch(code, "look at it")), []
        with pytest.raises(BenchBusyError, match="look at it; acknowledge it first"):
            await started_again(bench, said, timeout_s=0.01)
        assert bench.acknowledged == ["interrupted"]
        assert said[-1] == "waits for a person, goes on when bench 'b' is acknowledged: look at it"


async def test_it_goes_on_when_a_person_has_acknowledged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starting_again, "_TRY_S", 0.0)
    bench, said = Latching(Latch("other_device", "another cycler than before")), []
    assert (await started_again(bench, said, person=bench.latches.clear)).id == "r2"
    assert bench.acknowledged == [] and "waits for a person" in said[0]


async def test_who_stops_the_bench_stops_what_waits_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(starting_again, "_TRY_S", 0.0)
    bench, said = Latching(Latch("other_device", "another cycler than before")), []

    def stop() -> None:
        bench.waiting.stop = "by a person"

    with pytest.raises(CampaignStoppedError, match="stopped while it waited for bench 'b': by a person"):
        await started_again(bench, said, person=stop)
    assert len(said) == 1
