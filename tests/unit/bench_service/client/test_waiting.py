"""Waiting for an end: what is seen is told, a short silence is borne, a refusal is not."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from bench_service.client import BenchClient, ClientError
from bench_service.client import waiting as module
from bench_service.client.waiting import Look, wait_until

ENDED = frozenset({"done"})


class Time:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def monotonic(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Time:
    clock = Time()
    monkeypatch.setattr(module, "time", clock)
    return clock


def seen(*answers: dict[str, Any] | Exception) -> Callable[[], dict[str, Any]]:
    """Give these one after the other, the last for ever."""
    left: Iterator[dict[str, Any] | Exception] = iter(answers)
    last = answers[-1]

    def see() -> dict[str, Any]:
        answer = next(left, last)
        if isinstance(answer, Exception):
            raise answer
        return answer

    return see


def test_each_look_is_told_until_the_end(clock: Time) -> None:
    told: list[str] = []
    look = Look(
        "job 1", seen({"state": "a"}, {"state": "b"}, {"state": "done"}), ENDED, lambda r: told.append(r["state"])
    )
    assert wait_until(look, None, 0.5) == {"state": "done"}
    assert told == ["a", "b", "done"] and clock.now_s == 1.0


def test_patience_has_an_end_and_says_that_the_work_goes_on(clock: Time) -> None:
    with pytest.raises(ClientError, match="job 1 has not ended within 2 s; it goes on") as refusal:
        wait_until(Look("job 1", seen({"state": "a"}), ENDED, None), 2.0, 0.5)
    assert refusal.value.code == "timeout" and clock.now_s == pytest.approx(2.5)


def test_a_service_may_be_restarted_meanwhile(clock: Time) -> None:
    silent = [ClientError("no answer")] * 50
    assert wait_until(Look("job 1", seen(*silent, {"state": "done"}), ENDED, None), None, 0.5) == {"state": "done"}


def test_a_long_silence_is_an_error(clock: Time) -> None:
    with pytest.raises(ClientError, match="no answer"):
        wait_until(Look("job 1", seen(ClientError("no answer")), ENDED, None), None, 0.5)
    assert clock.now_s == pytest.approx(30.5)


def test_a_refusal_ends_the_wait_at_once(clock: Time) -> None:
    with pytest.raises(ClientError, match="unknown job"):
        wait_until(Look("job 1", seen(ClientError("unknown job", 404)), ENDED, None), None, 0.5)
    assert clock.now_s == 0.0


def test_options_that_nobody_states_are_not_sent(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[str, Any]] = []
    with BenchClient("http://h/") as client:
        monkeypatch.setattr("bench_service.client.connection.Connection.post", lambda _, *call: sent.append(call))
        client.start_run("sim", "p1", dt_s=1, initial_soc=0.5, name=None, seed=7)
    stated = {"bench": "sim", "profile_id": "p1", "dt_s": 1.0, "initial_soc": 0.5, "seed": 7}
    assert sent == [("/api/v1/runs", stated)]
