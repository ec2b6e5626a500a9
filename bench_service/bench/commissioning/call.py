"""The API's end of a commissioning: asked once, answered or lost with the process that does it."""

import asyncio
from typing import Any

from bench_service.bench.commissioning.check import ProofOrder
from bench_service.errors import BenchBusyError, BenchOfflineError
from bench_service.framing import Header


class CommissionCall:
    """Waits for the answer of a bench's control process.

    Parameters
    ----------
    bench : str
    """

    def __init__(self, bench: str) -> None:
        self._bench = bench
        self._answer: asyncio.Future[dict[str, Any]] | None = None

    def begin(self, order: ProofOrder) -> Header:
        """Return the message that asks for it; raises `BenchBusyError` where it has been asked for already."""
        if self._answer is not None and not self._answer.done():
            raise BenchBusyError(f"bench {self._bench!r} is being commissioned; wait for it, or stop it")
        self._answer = asyncio.get_running_loop().create_future()
        return {"op": "commission", "order": order.to_json()}

    async def answer(self) -> dict[str, Any]:
        """Wait for the report; raises `BenchOfflineError` where the process has gone."""
        assert self._answer is not None
        return await asyncio.shield(self._answer)

    def answered(self, report: dict[str, Any]) -> None:
        """Take the report."""
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(report)

    def lost(self, reason: str) -> None:
        """The process has gone."""
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(BenchOfflineError(f"bench {self._bench!r}: {reason}; commission it again"))
            self._answer.exception()  # nobody may be waiting any more
