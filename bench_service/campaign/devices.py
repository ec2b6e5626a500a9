"""Which device was last seen on a bench, so that another one is told over a restart of the service too."""

from __future__ import annotations

from functools import partial

from bench_service.campaign.benches import Bench
from bench_service.campaign.journal import Journal
from bench_service.config import BenchConfig
from bench_service.store.metadata import MetadataStore


class Devices:
    """Keeps what the devices of the benches say of themselves; a simulated one is made anew with the service.

    Parameters
    ----------
    store, journal
    """

    def __init__(self, store: MetadataStore, journal: Journal) -> None:
        self._store = store
        self._journal = journal
        self._kept: dict[str, dict[str, str]] = {}

    def known(self, bench: str, config: BenchConfig) -> dict[str, str] | None:
        """Return what the device on a bench has said of itself to an earlier service; reads the store."""
        return None if config.simulate is not None else self._store.devices.last(bench)

    def on_state(self, bench: Bench) -> None:
        """Write down which device is there; returns at once. What it has latched is written before."""
        name, identity = bench.name, bench.supervisor.status.identity
        if identity is not None and bench.base.simulate is None and identity != self._kept.get(name):
            kept = partial(self._kept.__setitem__, name, identity)
            self._journal.post(partial(self._store.devices.see, name, identity), lambda _: kept())
