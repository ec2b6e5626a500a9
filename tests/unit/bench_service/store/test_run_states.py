from typing import get_args

from bench_service.store.records import OPEN_RUN_STATES, RunState
from bench_service.store.run_states import WAYS, before


def test_every_state_has_its_ways_and_an_end_has_none() -> None:
    assert set(WAYS) == set(get_args(RunState))
    assert {state for state, ways in WAYS.items() if ways} == set(OPEN_RUN_STATES)
    assert all(set(ways) <= set(WAYS) for ways in WAYS.values())


def test_where_a_state_can_come_from() -> None:
    assert before("paused") == ("running",)
    assert set(before("running")) == {"created", "paused"}
    assert set(before("stopped")) == set(OPEN_RUN_STATES)
    assert before("created") == ()
