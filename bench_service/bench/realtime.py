"""What makes a process punctual during a run: no garbage collection, real-time priority where allowed."""

import contextlib
import gc
import os
from collections.abc import Iterator

_FIFO_PRIORITY = 10


@contextlib.contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Keep the collector from stopping the loop; what is alive now is not looked at again."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


@contextlib.contextmanager
def real_time_priority(priority: int = _FIFO_PRIORITY) -> Iterator[str | None]:
    """Run under SCHED_FIFO if the system allows it.

    Yields
    ------
    None, or why it is not allowed.
    """
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        yield f"no real-time priority ({error.strerror}); ticks may be late on a busy computer"
        return
    try:
        yield None
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
