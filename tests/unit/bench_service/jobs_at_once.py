"""A job runner that runs each job at once, in the test itself."""

from types import SimpleNamespace
from typing import Any


class JobsAtOnce:
    """Keeps the kinds of the jobs that it was given, and gives the result of the last."""

    def __init__(self) -> None:
        self.kinds: list[str] = []

    def submit(self, kind: str, function: Any, *arguments: Any) -> SimpleNamespace:
        self.kinds.append(kind)
        self._result = function(lambda share, text: None, *arguments)
        return SimpleNamespace(id="j1")

    async def wait(self, job_id: str) -> SimpleNamespace:
        return SimpleNamespace(result=self._result, kind=self.kinds[-1], error=None)
