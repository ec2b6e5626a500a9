"""`/healthz`."""

from types import SimpleNamespace
from typing import Any

import pytest

from bench_service.api import health
from tests.unit.bench_service.api.route_rig import Part, client_of

SOUND = {"state": "ok", "damaged_runs": 0, "free_MB": 5000, "floor_MB": 200}


@pytest.mark.parametrize(
    ("recorder", "storage", "status"),
    [
        ("running", SOUND, "ok"),
        ("stopped", SOUND, "degraded"),
        ("disk full", SOUND, "degraded"),
        ("running", SOUND | {"state": "/data is gone"}, "degraded"),
        ("running", SOUND | {"damaged_runs": 1}, "degraded"),
    ],
)
def test_what_cannot_store_is_degraded_and_still_answers(recorder: str, storage: dict[str, Any], status: str) -> None:
    supervisor = SimpleNamespace(status=SimpleNamespace(state="fault"))
    benches = [SimpleNamespace(name="sim", supervisor=supervisor)]
    parts = {"recorder_state": lambda: recorder, "storage": Part(to_json=storage), "version": "1.2.3"}
    client = client_of(health.router, benches=benches, **parts)
    answer = client.get("/healthz")
    assert answer.status_code == 200
    document = answer.json()
    assert (document["status"], document["recorder"], document["version"]) == (status, recorder, "1.2.3")
    assert document["benches"] == {"sim": "fault"}
    assert document["sqlite_version"] and document["storage"] == storage
