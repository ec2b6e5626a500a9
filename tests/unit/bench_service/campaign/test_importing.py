"""Uploads: one request writes to each."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, cast

import pytest

from bench_service.campaign.importing import Importing
from bench_service.errors import ConflictError


@pytest.fixture
def importing(tmp_path: Path) -> Importing:
    nobody = cast(Any, None)
    return Importing(nobody, nobody, nobody, nobody, (tmp_path, "1"), nobody)


async def pieces(*parts: bytes) -> AsyncIterator[bytes]:
    for part in parts:
        yield part


async def test_a_request_that_was_taken_for_lost_writes_nothing_more(importing: Importing, tmp_path: Path) -> None:
    upload_id = importing.add("a.csv")["id"]
    half_is_there, go_on = asyncio.Event(), asyncio.Event()

    async def slow() -> AsyncIterator[bytes]:
        yield b"0123"
        half_is_there.set()
        await go_on.wait()
        yield b"4567"

    first = asyncio.create_task(importing.append(upload_id, 0, slow()))
    await half_is_there.wait()
    there = importing.get(upload_id)["n_bytes"]
    assert there == 4
    assert (await importing.append(upload_id, there, pieces(b"45", b"67")))["n_bytes"] == 8
    go_on.set()
    with pytest.raises(ConflictError, match="a later request goes on with this upload"):
        await first
    (content,) = tmp_path.glob("uploads/*/content")
    assert content.read_bytes() == b"01234567"
    assert (await importing.append(upload_id, 8, pieces(b"8")))["n_bytes"] == 9


async def test_of_two_that_begin_at_once_one_is_stored(importing: Importing) -> None:
    upload_id = importing.add("a.csv")["id"]
    both = (importing.append(upload_id, 0, pieces(b"0123", b"4567")) for _ in range(2))
    ended = await asyncio.gather(*both, return_exceptions=True)
    assert [type(each) for each in ended].count(ConflictError) == 1
    assert importing.get(upload_id)["n_bytes"] == 8
