"""Fixtures that several files of system tests share."""

import signal
from collections.abc import Iterator

import pytest
from rest_rig import SIMULATED, Rest
from service_rig import Service


@pytest.fixture(scope="module")
def rest(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rest]:
    service = Service(tmp_path_factory.mktemp("rest"), SIMULATED)
    try:
        service.idle("sim")
        profile = service.client.upload_profile("pulse", [0, 10, 40, 60], [0.0, 2.0, -2.0, 0.0])
        yield Rest(service, service.client, profile["id"])
    finally:
        status, words = service.end(signal.SIGINT)
        assert (status, words) == (0, "")
