"""Writes from the event loop keep their order."""

import asyncio
import logging
from contextlib import closing
from pathlib import Path

import pytest

from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.errors import StoreError
from bench_service.store.metadata import MetadataStore


async def test_what_was_posted_is_written_before_what_comes_after_it(tmp_path: Path) -> None:
    with closing(MetadataStore.open(tmp_path)) as store:
        live = Broadcaster()
        reader, journal = live.subscribe(), Journal(store, live)
        seen: list[list[str]] = []
        for code in ("one", "two"):
            journal.note("b", {"severity": "info", "code": code, "text": "t", "run_id": None}, None)
        journal.post(lambda: [event.code for event in store.events.page()], seen.append)
        assert [event.code for event in await journal.write(store.events.page)] == ["two", "one"]
        await journal.close()
        assert seen == [["two", "one"]]
        assert [(await reader.get())["code"] for _ in range(2)] == ["one", "two"]


async def test_a_write_that_fails_behind_the_loop_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def fail() -> None:
        raise StoreError("the disk is full")

    with closing(MetadataStore.open(tmp_path)) as store:
        journal = Journal(store, Broadcaster())
        with caplog.at_level(logging.ERROR):
            journal.post(fail)
            await journal.close()
            await asyncio.sleep(0)
        assert "the disk is full" in caplog.text
