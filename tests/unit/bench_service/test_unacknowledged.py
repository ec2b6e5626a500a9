"""A bench whose last run ended badly waits for a person, also over a restart of the service."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.bench.latch import Latch
from bench_service.campaign.latches import unacknowledged
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent

LIMITS = {"duration_s": 10.0}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    store = MetadataStore.open(tmp_path)
    yield store
    store.close()


def ended_run(store: MetadataStore, state: Any, bench: str = "a", *, noted: bool = True) -> str:
    profile = store.profiles.add("p", np.array([0.0, 1.0]), np.array([0.0, 0.0]))
    run = store.runs.add(
        RunIntent(
            bench=bench,
            profile_id=profile.id,
            dt_s=1.0,
            initial_soc=0.5,
            capacity_Ah=1.0,
            limits=LIMITS,
            code_version="0",
        ),
    )
    store.runs.start(run.id)
    store.runs.end(run.id, state, "too warm")
    if noted:
        store.events.add("error", f"run_{state}", "too warm", bench=bench, run_id=run.id)
    return run.id


@pytest.mark.parametrize("state", ["completed", "stopped"])
def test_a_good_end_asks_for_nothing(store: MetadataStore, state: str) -> None:
    assert unacknowledged(store, "a") is None
    ended_run(store, state)
    assert unacknowledged(store, "a") is None


@pytest.mark.parametrize("state", ["fault", "interrupted"])
def test_a_bad_end_waits_until_it_is_acknowledged(store: MetadataStore, state: str) -> None:
    run_id = ended_run(store, state)
    code = "interrupted" if state == "interrupted" else "run_fault"
    assert unacknowledged(store, "a") == Latch(code, f"run {run_id} ended as {state}: too warm")
    assert unacknowledged(store, "b") is None
    store.events.add("info", "acknowledged", "by somebody", bench="b")
    assert unacknowledged(store, "a") is not None
    store.events.add("info", "acknowledged", "by somebody", bench="a")
    assert unacknowledged(store, "a") is None
    ended_run(store, state)
    assert unacknowledged(store, "a") is not None


def test_a_run_that_was_refused_never_began(store: MetadataStore) -> None:
    run_id = ended_run(store, "fault")
    store.events.add("error", "refused", "the run's limits leave the bench's", bench="a", run_id=run_id)
    assert unacknowledged(store, "a") is None


class SteppingClock:
    """Each look finds the clock set back by an hour."""

    def __init__(self) -> None:
        self.now = datetime(2026, 3, 1, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.now -= timedelta(hours=1)
        return self.now


def test_no_clock_that_is_set_back_makes_a_fault_vanish_or_hides_an_acknowledgement(tmp_path: Path) -> None:
    store = MetadataStore.open(tmp_path, clock=SteppingClock())
    ended_run(store, "completed")
    store.events.add("info", "acknowledged", "an earlier one", bench="a")
    run_id = ended_run(store, "fault")
    assert unacknowledged(store, "a") == Latch("run_fault", f"run {run_id} ended as fault: too warm")
    store.events.add("info", "acknowledged", "by somebody", bench="a")
    assert unacknowledged(store, "a") is None
    ended = store.runs.get(run_id)
    assert ended.started_utc is not None and ended.ended_utc is not None
    assert ended.created_utc > ended.started_utc  # by the clock
    assert ended.ended_utc >= ended.started_utc and ended.elapsed_s is not None and ended.elapsed_s >= 0
    assert [run.id for run in store.runs.page()][0] == run_id
    store.close()


@pytest.mark.parametrize(("code", "latched"), [("latched", "unknown"), ("latched_at_rest", "at_rest")])
def test_a_fault_without_a_run_waits_too(store: MetadataStore, code: str, latched: str) -> None:
    store.events.add("info", code, "the output was on", bench="a")
    assert unacknowledged(store, "a") == Latch(latched, "the output was on")
    assert unacknowledged(store, "b") is None
    store.events.add("info", "acknowledged", "by somebody", bench="a")
    assert unacknowledged(store, "a") is None


def test_a_service_that_died_before_it_wrote_of_the_end_still_waits(store: MetadataStore) -> None:
    store.events.add("info", "acknowledged", "an earlier one", bench="a")
    run_id = ended_run(store, "fault", noted=False)
    store.events.add("info", "run_started", "it begins", bench="a", run_id=run_id)
    assert unacknowledged(store, "a") == Latch("run_fault", f"run {run_id} ended as fault: too warm")


def test_what_takes_a_person_is_not_hidden_by_the_run_that_was_cut_off(store: MetadataStore) -> None:
    run_id = ended_run(store, "interrupted")
    store.events.add("info", "latched_interrupted", "run was interrupted", bench="a")
    assert unacknowledged(store, "a") == Latch("interrupted", f"run {run_id} ended as interrupted: too warm")
    store.events.add("info", "latched_other_device", "another cycler", bench="a")
    assert unacknowledged(store, "a") == Latch("other_device", "another cycler")
    store.events.add("info", "acknowledged", "by somebody", bench="a")
    assert unacknowledged(store, "a") is None
