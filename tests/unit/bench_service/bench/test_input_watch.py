"""When the stop input is looked at between two ticks."""

from types import SimpleNamespace
from typing import cast

import pytest

from bench_service.bench import input_watch
from bench_service.bench.clock import Clock
from bench_service.bench.input_watch import InputWatch
from bench_service.bench.stop import StopSignal
from drivers.cycler import Cycler

TICK_S = 0.333


class Bench:
    """A clock of which all time is spent by what is asked and waited for; one answer of a cycler may be late."""

    def __init__(self, late_question: int) -> None:
        self.now_s, self.next_s, self.asked, self.late_question = 0.0, 0.0, 0, late_question

    def left_s(self) -> float:
        return self.next_s - self.now_s

    async def stop_input(self) -> bool:
        self.asked += 1
        self.now_s += 0.12 if self.asked == self.late_question else 0.001
        return False

    async def wait(self, seconds: float) -> bool:
        self.now_s += seconds
        return False

    async def tick(self, watch: InputWatch) -> int:
        """Return how often the input was looked at before a tick, and see that this is in time."""
        before, self.next_s = self.asked, self.next_s + TICK_S
        await watch.until(cast(Clock, self))
        assert self.now_s <= self.next_s
        self.now_s = self.next_s
        return self.asked - before


@pytest.mark.parametrize("late_question", [3, 8])
async def test_after_one_late_answer_the_input_is_looked_at_again(
    late_question: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, stop = Bench(late_question), StopSignal()
    monkeypatch.setattr(input_watch, "time", SimpleNamespace(monotonic=lambda: bench.now_s))
    monkeypatch.setattr(stop, "wait", bench.wait)
    watch = InputWatch("b", cast(Cycler, bench), stop)
    looks = [await bench.tick(watch) for _ in range(100)]
    assert min(looks[1:3]) < 3, "the late answer makes room at first"
    assert min(looks[10:]) >= 1 and looks[-1] >= 19
