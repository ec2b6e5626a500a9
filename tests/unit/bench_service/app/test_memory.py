"""Memory of long bodies is given back."""

import asyncio
from typing import Any

import pytest

from bench_service.app import memory
from bench_service.app.memory import LONG_BODY_BYTES, GivesBack, trim_heap


@pytest.mark.parametrize(("length", "trims"), [(LONG_BODY_BYTES + 1, 1), (LONG_BODY_BYTES, 0), (None, 0)])
async def test_once_after_a_while_of_requests_with_long_bodies(
    length: int | None, trims: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    trimmed: list[bool] = []
    monkeypatch.setattr(memory, "_PAUSE_S", 0.01)
    monkeypatch.setattr(memory, "trim_heap", lambda: trimmed.append(True))

    async def app(*_: Any) -> None:
        pass

    headers = [] if length is None else [(b"content-length", str(length).encode())]
    given_back: Any = GivesBack(app)
    for _ in range(5):
        await given_back({"type": "http", "headers": headers}, None, None)
    await asyncio.sleep(0.1)
    assert len(trimmed) == trims


def test_a_heap_can_be_trimmed_or_not() -> None:
    assert trim_heap() in (True, False)
