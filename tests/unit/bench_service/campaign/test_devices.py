"""Which device was last seen on a bench is known to the next service."""

from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from bench_service.bench.listener import BenchStatus
from bench_service.campaign.benches import Bench
from bench_service.campaign.devices import Devices
from bench_service.campaign.journal import Journal
from bench_service.campaign.live import Broadcaster
from bench_service.config import BenchConfig
from bench_service.store.metadata import MetadataStore


def bench(serial: str | None, *, simulate: object = None) -> Bench:
    capabilities = None if serial is None else {"maker": "M", "model": "m", "serial": serial, "firmware": "1"}
    supervisor = SimpleNamespace(status=BenchStatus("idle", capabilities=capabilities))
    parts: dict[str, Any] = {"name": "b", "supervisor": supervisor, "base": SimpleNamespace(simulate=simulate)}
    return cast(Bench, SimpleNamespace(**parts))


async def test_the_device_seen_last_is_known_to_the_next_service(tmp_path: Path) -> None:
    wired = cast(BenchConfig, SimpleNamespace(simulate=None))
    simulated = cast(BenchConfig, SimpleNamespace(simulate=object()))
    with closing(MetadataStore.open(tmp_path)) as store:
        journal = Journal(store, Broadcaster())
        devices = Devices(store, journal)
        assert devices.known("b", wired) is None
        for serial in ("1", "1", None, "2", None):
            devices.on_state(bench(serial))
        devices.on_state(bench("3", simulate=object()))
        await journal.close()
        again = Devices(store, Journal(store, Broadcaster()))
        assert again.known("b", wired) == {"maker": "M", "model": "m", "serial": "2", "firmware": "1"}
        assert again.known("b", simulated) is None and again.known("c", wired) is None
