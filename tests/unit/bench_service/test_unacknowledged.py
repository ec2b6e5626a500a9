"""A bench whose last run ended badly waits for a person, also over a restart of the service."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.app.lifespan import unacknowledged
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent

LIMITS = {"duration_s": 10.0}


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    store = MetadataStore.open(tmp_path)
    yield store
    store.close()


def ended_run(store: MetadataStore, state: Any, bench: str = "a") -> str:
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
    return run.id


@pytest.mark.parametrize("state", ["completed", "stopped"])
def test_a_good_end_asks_for_nothing(store: MetadataStore, state: str) -> None:
    assert unacknowledged(store, "a") is None
    ended_run(store, state)
    assert unacknowledged(store, "a") is None


@pytest.mark.parametrize("state", ["fault", "interrupted"])
def test_a_bad_end_waits_until_it_is_acknowledged(store: MetadataStore, state: str) -> None:
    run_id = ended_run(store, state)
    assert unacknowledged(store, "a") == f"run {run_id} ended as {state}: too warm"
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
