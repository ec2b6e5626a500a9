from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import get_args

import pytest

from bench_service.errors import ConflictError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import OPEN_RUN_STATES, RunIntent, RunState
from bench_service.store.run_states import WAYS, before

STATES: tuple[RunState, ...] = get_args(RunState)
# How a run comes into each state, from where it is created.
COURSES: dict[RunState, tuple[str, ...]] = {
    "created": (),
    "running": ("start",),
    "paused": ("start", "pause"),
    **{state: ("start", state) for state in WAYS["created"] if state != "running"},
}


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MetadataStore]:
    folder: Path = tmp_path_factory.mktemp("states")
    with closing(MetadataStore.open(folder / "data")) as opened:
        yield opened


def test_every_state_has_its_ways_and_an_end_has_none() -> None:
    assert set(WAYS) == set(STATES)
    assert {state for state, ways in WAYS.items() if ways} == set(OPEN_RUN_STATES)
    assert all(set(ways) <= set(WAYS) for ways in WAYS.values())


def test_where_a_state_can_come_from() -> None:
    assert before("paused") == ("running",)
    assert set(before("running")) == {"created", "paused"}
    assert set(before("stopped")) == set(OPEN_RUN_STATES)
    assert before("created") == ()


def moved(store: MetadataStore, run_id: str, step: str) -> RunState:
    """Take a step by its name: a method, or the state to end in."""
    if step in ("start", "pause", "resume"):
        return getattr(store.runs, step)(run_id).state
    return store.runs.end(run_id, step, "for a reason").state  # pyright: ignore[reportArgumentType]


def brought_to(store: MetadataStore, state: RunState) -> str:
    intent = RunIntent(
        bench="sim", profile_id=None, dt_s=0.1, initial_soc=0.5, capacity_Ah=3.0, limits={}, code_version="1"
    )
    run_id = store.runs.add(intent).id
    for step in COURSES[state]:
        moved(store, run_id, step)
    assert store.runs.get(run_id).state == state
    return run_id


@pytest.mark.parametrize("state", STATES)
def test_no_other_way_is_stored(store: MetadataStore, state: RunState) -> None:
    stays = brought_to(store, state)
    for step in (*STATES, "start", "pause", "resume"):
        target = {"start": "running", "pause": "paused", "resume": "running"}.get(step, step)
        if target in WAYS[state] and {"start": "created", "resume": "paused"}.get(step, state) == state:
            assert moved(store, brought_to(store, state), step) == target
        else:
            with pytest.raises(ConflictError, match=f"is {state} and cannot become {target}"):
                moved(store, stays, step)
            assert store.runs.get(stays).state == state
