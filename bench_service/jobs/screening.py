"""Long bodies are looked at in a process of their own: one that is refused costs the service's event loop nothing.

A parser of JSON holds the interpreter for half a second at 20 MB; beside three clients that send such bodies a stop
waited for seconds.
"""

from __future__ import annotations

import asyncio
import json
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import TYPE_CHECKING, Any

from bench_service.errors import ServiceError
from bench_service.jobs.runner import settle_worker
from bench_service.strict_json import parse_strictly

if TYPE_CHECKING:
    from models.module.network import ModuleNetwork
    from models.network.local_model_network import LocalModelNetwork

MODEL = "model"
# The memory that a long body took is given back with the process.
_BODIES_PER_PROCESS = 8
_NICE = 5

Fault = tuple[str, str, int]  # kind, text, position


class Screen:
    """One process, which starts with the first long body; bodies wait for each other."""

    def __init__(self) -> None:
        self._pool = _pool()

    async def check(self, body: bytes, kind: str) -> None:
        """See whether a body is JSON, and with kind ``model`` a model.

        Raises
        ------
        json.JSONDecodeError, models.data.errors.ModelError
            It is not.
        ServiceError
            It cannot be looked at: the process has died.
        """
        pool = self._pool
        try:
            fault = await asyncio.get_running_loop().run_in_executor(pool, find_fault, body, kind)
        except BrokenProcessPool as error:
            if pool is self._pool:
                self._pool = _pool()
            raise ServiceError("the body could not be read; send less at a time") from error
        if fault is None:
            return
        what, text, at = fault
        if what == "json":
            raise json.JSONDecodeError(text, "", at)
        from models.data.errors import ModelError  # lazy: numpy

        raise ModelError(text)

    def close(self) -> None:
        """End the process."""
        self._pool.shutdown(wait=True, cancel_futures=True)


def find_fault(body: bytes, kind: str) -> Fault | None:
    """Return what is wrong with a body; runs in the screening process."""
    try:
        document = parse_strictly(body)
    except json.JSONDecodeError as error:
        return "json", error.msg, error.pos
    if kind != MODEL:
        return None
    from models.data.errors import ModelError  # lazy: numba and scipy take 870 ms

    try:
        checked_any(document)
    except ModelError as error:
        return "model", str(error), 0
    return None


def checked_model(document: Any) -> LocalModelNetwork:
    """Read a MODEL.json with all its parts, those of the observer too, and try one that carries no seal.

    Raises
    ------
    ModelError
        It is none, was changed after it was written, or does not mean a cell that can be.
    """
    # Lazy: numba and scipy take 870 ms.
    from bench_service.jobs.trying import try_model
    from models.data.errors import ModelError
    from models.data.seal import SEAL
    from models.observer.filter.settings import default_settings
    from models.pipeline.validation import check_model

    network = check_model(document)
    try:
        default_settings(network)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"model document is damaged: record.observer cannot be read: {error!r:.100}") from error
    if SEAL not in document:
        try_model(network)
    return network


def checked_any(document: Any) -> LocalModelNetwork | ModuleNetwork:
    """Read the MODEL.json of a cell or of a module; see `checked_model`."""
    # Lazy: numba and scipy take 870 ms.
    from models.data.seal import SEAL
    from models.module.network import KIND, ModuleNetwork

    if not isinstance(document, dict) or document.get("kind") != KIND:
        return checked_model(document)
    module = ModuleNetwork.from_json(document)
    if SEAL not in document:
        checked_model(document["cell"])
    return module


def _pool() -> ProcessPoolExecutor:
    context = multiprocessing.get_context("spawn")
    arguments = {"initializer": settle_worker, "initargs": (_NICE,), "max_tasks_per_child": _BODIES_PER_PROCESS}
    return ProcessPoolExecutor(1, mp_context=context, **arguments)
