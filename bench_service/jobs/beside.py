"""Many pieces of one job side by side, one process for each processor; a short series stays in its own."""

from __future__ import annotations

import io
import multiprocessing
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from bench_service.errors import ServiceError
from bench_service.jobs.runner import settle_worker

# A process takes two seconds to start, as long as it takes to weigh some thirty runs.
_FEWEST = 40
# Pieces that go to a process, and come back from it, at a time.
_AT_A_TIME = 8

_SHARED = "shared"
S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")
_given: list[Any] = []


def spread(function: Callable[[S, T], R], shared: S, pieces: Sequence[T]) -> Iterator[R]:
    """Do the same to many pieces, and give what became of each in their order.

    Parameters
    ----------
    function : of a module, called with what is shared and with a piece; gives the same in whatever process it runs
    shared : sent to each process once; what comes back holds the caller's own
    pieces : any number

    Raises
    ------
    ServiceError
        One of the processes has died.
    """
    processes = min(len(os.sched_getaffinity(0)), len(pieces) // (_FEWEST // 2))
    if processes < 2:
        yield from (function(shared, each) for each in pieces)
        return
    # spawn: a fork of a process with threads can hang in a lock that it copied.
    context = multiprocessing.get_context("spawn")
    parts = [pieces[first : first + _AT_A_TIME] for first in range(0, len(pieces), _AT_A_TIME)]
    pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_begin, initargs=(function, shared))
    try:
        for part in pool.map(_work, parts):
            yield from _Unpickler(io.BytesIO(part), shared).load()
    except BrokenProcessPool as error:
        raise ServiceError(
            f"one of {processes} processes that shared this work has died, most likely for lack of memory; free some, "
            "or give fewer runs"
        ) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begin(function: Callable[..., Any], shared: Any) -> None:
    settle_worker(0)
    threadpool_limits(limits=1)
    _given[:] = [function, shared]


def _work(part: Sequence[Any]) -> bytes:
    function, shared = _given
    out = io.BytesIO()
    _Pickler(out, shared).dump([function(shared, each) for each in part])
    return out.getvalue()


def _parts(shared: Any) -> list[Any]:
    return [shared, *shared] if isinstance(shared, tuple) else [shared]


class _Pickler(pickle.Pickler):
    """Names what is shared instead of writing it out with each piece."""

    def __init__(self, file: io.BytesIO, shared: Any) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._place = {id(each): k for k, each in enumerate(_parts(shared))}

    def persistent_id(self, obj: Any) -> tuple[str, int] | None:
        place = self._place.get(id(obj))
        return None if place is None else (_SHARED, place)


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: Any) -> None:
        super().__init__(file)
        self._parts = _parts(shared)

    def persistent_load(self, pid: tuple[str, int]) -> Any:
        return self._parts[pid[1]]
