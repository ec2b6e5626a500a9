"""Threads for what may take seconds of a request: nothing that is short, and no stop, ever stands behind it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

ParametersT = ParamSpec("ParametersT")
ResultT = TypeVar("ResultT")
_THREADS = 2


class Aside:
    """A few threads of their own, beside those that the event loop shares out."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(_THREADS, thread_name_prefix="aside")

    async def call(
        self, function: Callable[ParametersT, ResultT], *arguments: ParametersT.args, **named: ParametersT.kwargs
    ) -> ResultT:
        """Call a function in one of the threads, after those that wait already."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._threads, lambda: function(*arguments, **named))

    def close(self) -> None:
        """Take nothing more; what waits is dropped, what is under way is not waited for."""
        self._threads.shutdown(wait=False, cancel_futures=True)
