"""The client for programs that do several things at a time: the calls of `BenchClient`, each to be awaited.

Requests are made by threads of the client's own, so that they look, wait and refuse as those of `BenchClient` do. A
wait whose task is cancelled ends at its next look; what was asked of the service goes on there.
"""

from __future__ import annotations

import contextvars
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

from bench_service.client.bench_client import BenchClient
from bench_service.client.connection import Record
from bench_service.client.waiting import PAUSE, Cancelled

P = ParamSpec("P")
R = TypeVar("R")

# Each wait for a run, a job or a campaign keeps one thread busy.
_MOST_AT_A_TIME = 64


class AsyncBenchClient:
    """Talks to one service; to be closed, or used in an ``async with`` statement.

    Parameters
    ----------
    url : str
        Address that the service printed, for example ``http://127.0.0.1:8000``.
    timeout_s : float
        Longest wait for one answer.
    token : str, optional
        Of a service that listens beyond its own machine; by default what ``BENCH_TOKEN`` says.
    """

    def __init__(self, url: str, timeout_s: float = 30.0, *, token: str | None = None) -> None:
        self._client = BenchClient(url, timeout_s, token=token)
        self._threads = ThreadPoolExecutor(_MOST_AT_A_TIME, thread_name_prefix="bench-client")
        self.url = self._client.url
        self._take_benches_and_runs()
        self._take_models()
        self._take_others()

    async def __aenter__(self) -> Self:
        """Give itself."""
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        await self.close()

    async def close(self) -> None:
        """Close the connections, once what is under way has been answered."""
        import asyncio  # 30 ms of every command that asks a service

        await asyncio.to_thread(self._threads.shutdown)
        self._client.close()

    def _later(self, call: Callable[P, R]) -> Callable[P, Coroutine[Any, Any, R]]:
        async def called(*args: P.args, **options: P.kwargs) -> R:
            import asyncio  # as in `close`

            given_up = threading.Event()
            context = contextvars.copy_context()
            context.run(PAUSE.set, partial(_pause, given_up))
            work = partial(context.run, partial(call, *args, **options))
            try:
                return await asyncio.get_running_loop().run_in_executor(self._threads, work)
            finally:
                given_up.set()

        called.__name__, called.__doc__ = call.__name__, call.__doc__
        return called

    def _take_benches_and_runs(self) -> None:
        client, later = self._client, self._later
        self.health = later(client.health)
        self.benches = later(client.benches)
        self.bench = later(client.bench)
        self.standing = later(client.standing)
        self.stop_bench = later(client.stop_bench)
        self.pause_bench = later(client.pause_bench)
        self.resume_bench = later(client.resume_bench)
        self.skip_step = later(client.skip_step)
        self.open_seal = later(client.open_seal)
        self.acknowledge = later(client.acknowledge)
        self.commissioning = later(client.commissioning)
        self.commission = later(client.commission)
        self.upload_profile = later(client.upload_profile)
        self.profiles = later(client.profiles)
        self.profile = later(client.profile)
        self.start_run = later(client.start_run)
        self.runs = later(client.runs)
        self.run = later(client.run)
        self.stop_run = later(client.stop_run)
        self.wait_run = later(client.wait_run)
        self.samples = later(client.samples)
        self.incremental = later(client.incremental)
        self.describe_run = later(client.describe_run)
        self.export = later(client.export)
        self.export_named = later(client.export_named)
        self.metadata = later(client.metadata)
        self.events = later(client.events)

    def _take_models(self) -> None:
        client, later = self._client, self._later
        self.fit = later(client.fit)
        self.wait_job = later(client.wait_job)
        self.models = later(client.models)
        self.model = later(client.model)
        self.model_document = later(client.model_document)
        self.model_tables = later(client.model_tables)
        self.import_model = later(client.import_model)
        self.design = later(client.design)
        self.compare = later(client.compare)
        self.observe = later(client.observe)
        self.comparison = later(client.comparison)
        self.comparison_series = later(client.comparison_series)
        self.comparison_table = later(client.comparison_table)
        self.comparison_where = later(client.comparison_where)
        self.effects = later(client.effects)
        self.diagnose = later(client.diagnose)
        self.trend = later(client.trend)
        self.add_effect = later(client.add_effect)
        self.refit = later(client.refit)
        self.learn = later(client.learn)
        self.model_chain = later(client.model_chain)
        self.comparisons = later(client.comparisons)
        self.diagnoses = later(client.diagnoses)
        self.diagnosis = later(client.diagnosis)
        self.design_experiment = later(client.design_experiment)
        self.trend_table = later(client.trend_table)
        self.run_report = later(client.run_report)
        self.campaign_report = later(client.campaign_report)
        self.comparison_report = later(client.comparison_report)
        self.diagnosis_report = later(client.diagnosis_report)
        self.trend_report = later(client.trend_report)
        self.design_report = later(client.design_report)
        self.job = later(client.job)
        self.cancel_job = later(client.cancel_job)
        self.formats = later(client.formats)

    def _take_others(self) -> None:
        client, later = self._client, self._later
        self.get_import = later(client.get_import)
        self.upload_file = later(client.upload_file)
        self.look_at_import = later(client.look_at_import)
        self.store_import = later(client.store_import)
        self.drop_import = later(client.drop_import)
        self.mappings = later(client.mappings)
        self.save_mapping = later(client.save_mapping)
        self.start_campaign = later(client.start_campaign)
        self.campaigns = later(client.campaigns)
        self.campaign = later(client.campaign)
        self.stop_campaign = later(client.stop_campaign)
        self.estimate_campaign = later(client.estimate_campaign)
        self.queue = later(client.queue)
        self.start_queue = later(client.start_queue)
        self.resume_campaign = later(client.resume_campaign)
        self.wait_campaign = later(client.wait_campaign)
        self.add_cell = later(client.add_cell)

        def cells(q: str | None = None, *, retired: bool = False, limit: int = 1000) -> list[Record]:
            """All cells, or those with a word in them."""
            return list(client.cells(q, retired=retired, limit=limit))

        def every(kind: str, **filters: object) -> list[Record]:
            """A whole list, read page by page."""
            return list(client.every(kind, **filters))

        self.cells = later(cells)
        self.every = later(every)
        self.cell = later(client.cell)
        self.change_cell = later(client.change_cell)
        self.retire_cell = later(client.retire_cell)
        self.reuse_cell = later(client.reuse_cell)
        self.cell_events = later(client.cell_events)
        self.put_cell = later(client.put_cell)
        self.upload_protocol = later(client.upload_protocol)
        self.add_standard_test = later(client.add_standard_test)
        self.standard_tests = later(client.standard_tests)
        self.preview_protocol = later(client.preview_protocol)
        self.protocols = later(client.protocols)
        self.protocol = later(client.protocol)
        self.run_steps = later(client.run_steps)
        self.run_cycles = later(client.run_cycles)


def _pause(given_up: threading.Event, seconds: float) -> None:
    """Wait for the next look, unless nobody waits for what it sees."""
    if given_up.wait(seconds):
        raise Cancelled
