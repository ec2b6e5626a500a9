"""Fixtures that several files of system tests share."""

from collections.abc import Iterator

import pytest
from rest_rig import SIMULATED, Rest
from service_rig import serving


@pytest.fixture(scope="module")
def rest(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rest]:
    with serving(tmp_path_factory.mktemp("rest"), SIMULATED) as service:
        profile = service.client.upload_profile("pulse", [0, 10, 40, 60], [0.0, 2.0, -2.0, 0.0])
        yield Rest(service, service.client, profile["id"])
