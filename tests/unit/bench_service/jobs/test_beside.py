import os
from dataclasses import dataclass

import pytest
from threadpoolctl import threadpool_limits

from bench_service.errors import ServiceError
from bench_service.jobs import beside
from models.data.errors import ModelError
from models.diagnosis.trend.trend import in_turn, trend
from tests.unit.models.diagnosis.cells import simple_network
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

MANY = list(range(100))


@dataclass(frozen=True)
class Shared:
    factor: int


def _where(shared, piece):
    return shared[0], shared[0].factor * piece, os.getpid()


def _refuse(_shared, piece):
    if piece == 57:
        raise ModelError("run 57: nothing in it")
    return piece


def _die(_shared, piece):
    if piece == 30:
        os._exit(1)
    return piece


@pytest.fixture
def two_processors(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: {0, 1})


def test_gives_what_became_of_each_piece_in_their_order_with_what_is_shared_itself(two_processors):
    shared = (Shared(3), None)
    found = list(beside.spread(_where, shared, MANY))
    assert [value for _, value, _ in found] == [3 * piece for piece in MANY]
    assert all(own is shared[0] for own, _, _ in found)
    processes = {pid for _, _, pid in found}
    assert os.getpid() not in processes
    assert len(processes) <= 2


@pytest.mark.parametrize(("processors", "pieces"), [({0}, MANY), ({0, 1}, MANY[:39])])
def test_one_processor_and_a_short_series_need_no_other_process(monkeypatch, processors, pieces):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: processors)
    found = list(beside.spread(_where, (Shared(1), None), pieces))
    assert {pid for _, _, pid in found} == {os.getpid()}


def test_what_a_piece_is_refused_for_is_told_as_it_is(two_processors):
    with pytest.raises(ModelError, match="run 57: nothing in it"):
        list(beside.spread(_refuse, None, MANY))


def test_a_process_that_dies_is_told_with_what_to_do(two_processors):
    with pytest.raises(ServiceError, match=r"one of 2 processes .* has died.*give fewer runs"):
        list(beside.spread(_die, None, MANY))


def test_a_life_is_told_alike_to_the_last_bit_whoever_weighs_its_runs(two_processors):
    runs = [true_run(steps_A(600, seed, largest_A=4.0), noise_V=5e-4, seed=seed) for seed in range(40)]

    def told(spread):
        with threadpool_limits(1, user_api="blas"):
            found = trend(simple_network(CAPACITY_AH), runs, [SOC] * len(runs), memory=known_runs(), spread=spread)
        return _timeless(found.to_json())

    assert told(beside.spread) == told(in_turn)


def _timeless(document):
    if isinstance(document, dict):
        return {name: _timeless(each) for name, each in document.items() if name != "seconds"}
    return [_timeless(each) for each in document] if isinstance(document, (list, tuple)) else document
