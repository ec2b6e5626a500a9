"""What ends is told: signed, tried again, kept over a restart, and never in the way."""

from __future__ import annotations

import asyncio
import importlib.util
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import ValidationError

from bench_service.campaign import webhook
from bench_service.campaign.journal import Journal
from bench_service.campaign.webhook import Webhook, signature
from bench_service.config import WebhookConfig
from bench_service.errors import StoreError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent
from tests.patience import PATIENCE_S

SECRET = "sixteen letters!".replace(" ", "-")
RECEIVER = Path(__file__).parents[4] / "docs" / "example-notebook" / "receiver.py"


@pytest.fixture
def store(tmp_path: Path) -> Iterator[MetadataStore]:
    with closing(MetadataStore.open(tmp_path)) as opened:
        yield opened


class Notes:
    def __init__(self) -> None:
        self.texts: list[tuple[str, str]] = []

    def note(self, _bench: str | None, event: Any) -> None:
        self.texts.append((event["severity"], event["text"]))


class Other:
    """The program at the other end: gives these answers in turn, then the last for ever; an exception is raised."""

    def __init__(self, *answers: int | Exception) -> None:
        self.answers, self.got = list(answers), list[tuple[bytes, dict[str, str]]]()

    async def send(self, _url: str, body: bytes, headers: dict[str, str]) -> int:
        self.got.append((body, headers))
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer


def ended_run(store: MetadataStore, **more: Any) -> str:
    intent = RunIntent(bench="b", profile_id=None, dt_s=1.0, initial_soc=0.5, capacity_Ah=2.5, limits={},
                       code_version="1", **more)  # fmt: skip
    return store.runs.end(store.runs.add(intent).id, "completed", None, n_samples=0).id


def told(
    store: MetadataStore, folder: Path, other: Other, until: Callable[[], bool], *runs: dict[str, Any], **config: Any
) -> list[tuple[str, str]]:
    """Let a service tell of these runs until a condition holds; give what it has noted."""
    notes = Notes()

    async def served() -> None:
        made = WebhookConfig(url="https://key@elab.example/hook?k=v", **config)
        said = {"institution": "lab", "version": "1", "address": "http://127.0.0.1:8000"}
        hook = Webhook(made, folder, store, cast(Journal, notes), said, other.send)
        await hook.start()
        for run in runs:
            ended_run(store, **run)
        async with asyncio.timeout(PATIENCE_S):
            while not until():
                await asyncio.sleep(0.005)
        await asyncio.sleep(0.02)
        await hook.close()

    asyncio.run(served())
    return notes.texts


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(webhook, "_FIRST_PAUSE_S", 0.005)


def test_a_run_is_told_with_its_cell_signed_and_with_the_token(store: MetadataStore, tmp_path: Path) -> None:
    cell, other = store.cells.add(label="left"), Other(204)
    notes = told(store, tmp_path, other, lambda: bool(other.got), {"cell_id": cell.id}, secret=SECRET, token="t-1")
    ((body, headers),) = other.got
    document = json.loads(body)
    assert (document["event"], document["institution"], document["cell"]["label"]) == ("run_ended", "lab", "left")
    run = document["run"]
    assert run["state"] == "completed"
    assert document["links"]["bundle"] == f"http://127.0.0.1:8000/api/v1/runs/{run['id']}/export?format=ro-crate"
    assert headers["X-Bench-Signature"] == signature(SECRET, body) and headers["Authorization"] == "Bearer t-1"
    assert notes == []


def test_it_is_tried_again_where_that_may_help_and_what_waits_keeps_its_order(
    store: MetadataStore, tmp_path: Path
) -> None:
    other = Other(OSError("refused"), 503, 200)
    notes = told(store, tmp_path, other, lambda: len(other.got) >= 4, {"name": "one"}, {"name": "two"})
    assert [json.loads(body)["run"]["name"] for body, _ in other.got] == ["one", "one", "one", "two"]
    assert [severity for severity, _ in notes] == ["warning", "info"]
    assert "no answer: refused; it is tried again for 24 h" in notes[0][1]
    assert "https://elab.example," in notes[0][1] and "key@" not in notes[0][1] and "k=v" not in notes[0][1]


def test_what_is_refused_is_not_sent_again(store: MetadataStore, tmp_path: Path) -> None:
    other = Other(404, 204)
    notes = told(store, tmp_path, other, lambda: len(other.got) >= 2, {"name": "one"}, {"name": "two"})
    assert len(other.got) == 2 and "the answer was 404; it is not tried again" in notes[0][1]


@pytest.mark.parametrize(("trouble", "n_sent"), [(StoreError("the disk is away"), 2), (ValueError("NaN"), 1)])
def test_a_run_that_cannot_be_read_does_not_end_what_comes_after(
    store: MetadataStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: Exception, n_sent: int
) -> None:
    other, make, troubles = Other(200), Webhook._body, [trouble]

    def body(self: Webhook, run_id: str) -> bytes:
        if troubles:
            raise troubles.pop()
        return make(self, run_id)

    monkeypatch.setattr(Webhook, "_body", body)
    notes = told(store, tmp_path, other, lambda: len(other.got) == n_sent and not troubles, {}, {})
    assert str(trouble) in notes[0][1]


def test_what_is_too_old_is_given_up(store: MetadataStore, tmp_path: Path) -> None:
    other = Other(503)
    notes = told(store, tmp_path, other, lambda: bool(other.got), {}, retry_h=1e-9)
    assert len(other.got) == 1 and notes[-1][0] == "error"


def test_what_was_not_delivered_outlives_the_service(store: MetadataStore, tmp_path: Path) -> None:
    away, back = Other(OSError("away")), Other(200)
    told(store, tmp_path, away, lambda: len(away.got) > 1, {"name": "one"})
    told(store, tmp_path, back, lambda: bool(back.got))
    assert json.loads(back.got[0][0])["run"]["name"] == "one"
    assert json.loads((tmp_path / "webhook.json").read_text()) == []
    (tmp_path / "webhook.json").write_text("{broken")
    told(store, tmp_path, Other(200), lambda: True)


@pytest.mark.parametrize(
    "change", [{"url": "ftp://x/y"}, {"url": "x"}, {"url": "http://"}, {"secret": "short"}, {"retry_h": 0}, {"more": 1}]
)
def test_a_configuration_that_is_none_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        WebhookConfig(**{"url": "https://x.example/"} | change)
    assert SECRET not in repr(WebhookConfig(url="https://x.example/", secret=SECRET))


class Notebook(BaseHTTPRequestHandler):
    """Stands in for service and notebook at once, and keeps what it was sent."""

    asked: list[tuple[str, str, bytes]]

    def _answer(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        self.asked.append((self.command, self.path, body))
        self.send_response(201 if self.command == "POST" else 200)
        self.send_header("Location", "https://elab.example/api/v2/experiments/7")
        self.end_headers()
        self.wfile.write(b"PK-bundle")

    do_GET = do_POST = do_PATCH = _answer  # noqa: N815

    def log_message(self, *_: Any) -> None: ...


def test_the_example_makes_an_entry_with_the_bundle() -> None:
    spec = importlib.util.spec_from_file_location("receiver", RECEIVER)
    assert spec is not None and spec.loader is not None
    receiver = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(receiver)
    body = b'{"a": 1}'
    assert receiver.is_genuine(SECRET, body, signature(SECRET, body))
    assert not receiver.is_genuine(SECRET, body + b" ", signature(SECRET, body))
    assert not receiver.is_genuine(SECRET, body, None)

    run = {"id": "r1", "label": None, "name": "<pulse>", "state": "completed", "bench": "b", "operator": "A&B"}
    run |= {"started_utc": "2026", "ended_utc": "2026", "reason": None, "n_samples": 3, "sha256": "ab"}
    links = {"page": "http://x/runs/r1", "bundle": "http://elsewhere.example/"}
    Notebook.asked = []
    with HTTPServer(("127.0.0.1", 0), Notebook) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        url = f"http://127.0.0.1:{server.server_port}"
        made = receiver.add_entry({"run": run, "cell": None, "links": links}, url, url, "key")
        server.shutdown()
        thread.join()
    assert made == f"{url}/api/v2/experiments/7"
    assert [(method, path) for method, path, _ in Notebook.asked] == [
        ("POST", "/api/v2/experiments"),
        ("PATCH", "/api/v2/experiments/7"),
        ("GET", "/api/v1/runs/r1/export?format=ro-crate"),
        ("POST", "/api/v2/experiments/7/uploads"),
    ]
    entry = json.loads(Notebook.asked[1][2])
    assert entry["title"] == "<pulse>: completed" and "A&amp;B" in entry["body"]
    assert b"PK-bundle" in Notebook.asked[3][2] and b'filename="r1.crate.zip"' in Notebook.asked[3][2]
