"""A data directory that goes away and comes back under a running service, and samples that are damaged beneath it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from service_rig import Service, until

from bench_service.client import ClientError
from tests.unit.bench_service.store.sample_rig import flip_bit

BENCH = "[bench.sim]\nsimulate = { seed = 3, lock_step = false }\n"


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    started = Service(tmp_path, BENCH)
    yield started
    started.end()


def play(service: Service, seconds: float = 4000.0) -> dict[str, Any]:
    profile = service.client.upload_profile("rest", [0.0, seconds], [0.0, 0.0])
    return service.client.start_run("sim", profile["id"], 0.1, 0.5)


def test_a_directory_that_goes_away_ends_the_run_and_takes_no_other_until_it_is_back(service: Service) -> None:
    service.idle("sim")
    run = play(service)
    until(lambda: service.client.bench("sim")["state"] == "running", "running")
    aside = service.data_dir.with_name("aside")
    service.data_dir.rename(aside)
    until(lambda: service.client.bench("sim")["state"] in ("fault", "offline"), "the run is ended")
    told = until(lambda: (h := service.client.health())["recorder"] != "running" and h, "health tells")
    assert told["status"] == "degraded" and "is gone" in told["storage"]["state"]
    service.data_dir.mkdir()
    assert "is not the one" in service.client.health()["storage"]["state"]
    service.data_dir.rmdir()
    aside.rename(service.data_dir)
    until(lambda: service.client.health()["status"] == "ok", "the recorder is back by itself")
    ended = service.client.wait_run(run["id"])
    assert ended["state"] == "fault" and "data is gone" in ended["reason"]
    assert service.client.samples(run["id"])["n"] >= ended["n_samples"]
    until(lambda: service.client.run(run["id"])["sha256"], "what is stored of it is counted")
    until(lambda: service.client.bench("sim")["state"] == "fault", "the bench waits for a person")
    service.client.acknowledge("sim")
    service.idle("sim")
    again = service.client.wait_run(play(service, 1.0)["id"])
    assert again["state"] == "completed" and again["elapsed_s"] > 0


def test_no_run_is_taken_while_the_directory_is_away_and_a_flipped_bit_is_told(service: Service) -> None:
    service.idle("sim")
    run = service.client.wait_run(play(service, 2.0)["id"])
    aside = service.data_dir.with_name("aside")
    service.data_dir.rename(aside)
    with pytest.raises(ClientError) as refused:
        play(service)
    assert refused.value.status == 503
    aside.rename(service.data_dir)
    flip_bit(service.data_dir, "data")
    with pytest.raises(ClientError, match="is damaged") as refused:
        service.client.samples(run["id"])
    assert refused.value.status == 409
    with pytest.raises(ClientError, match="is damaged"):
        service.client.fit("m", [run["id"]], 2.5)
    assert service.client.run(run["id"])["damage"] and service.client.health()["storage"]["damaged_runs"] == 1
