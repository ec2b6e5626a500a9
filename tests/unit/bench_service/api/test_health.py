"""`/healthz`."""

from types import SimpleNamespace

import pytest

from bench_service.api import health
from tests.unit.bench_service.api.route_rig import client_of


@pytest.mark.parametrize(
    ("recorder", "status"), [("running", "ok"), ("stopped", "degraded"), ("disk full", "degraded")]
)
def test_without_its_recorder_the_service_is_degraded_and_still_answers(recorder: str, status: str) -> None:
    supervisor = SimpleNamespace(status=SimpleNamespace(state="fault"))
    benches = [SimpleNamespace(name="sim", supervisor=supervisor)]
    client = client_of(health.router, recorder_state=lambda: recorder, version="1.2.3", benches=benches)
    answer = client.get("/healthz")
    assert answer.status_code == 200
    document = answer.json()
    assert (document["status"], document["recorder"], document["version"]) == (status, recorder, "1.2.3")
    assert document["benches"] == {"sim": "fault"}
    assert document["sqlite_version"]
