"""Commissioning as the service does it: asked of the bench, sealed, stored, told."""

from __future__ import annotations

import asyncio

from bench_service.bench.commissioning.check import ProofOrder
from bench_service.bench.messages import EventMessage
from bench_service.campaign.benches import Bench, Benches
from bench_service.campaign.campaigns import CampaignRunner
from bench_service.campaign.hardware import Hardware
from bench_service.campaign.journal import Journal
from bench_service.campaign.runs import Runs
from bench_service.errors import BenchBusyError
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CommissioningRecord, Json, Severity

_STORED = ("passed", "failed")


class Commissioning:
    """Commissions benches and keeps what was found.

    Parameters
    ----------
    store, journal, benches, runs, campaigns
    code_version : str
        Noted with each record.
    """

    def __init__(
        self,
        store: MetadataStore,
        journal: Journal,
        benches: Benches,
        runs: Runs,
        campaigns: CampaignRunner,
        code_version: str,
    ) -> None:
        self._store = store
        self._journal = journal
        self._benches = benches
        self._runs = runs
        self._campaigns = campaigns
        self._code_version = code_version

    async def commission(self, name: str, order: ProofOrder) -> Json:
        """Look at a bench's hardware or, where that is ordered, prove what it does, and keep the record.

        Raises
        ------
        NotFoundError
            No such bench.
        BenchBusyError, BenchOfflineError
            It cannot be done now.
        """
        bench = self._benches.get(name)
        self._runs.refuse_busy(bench)
        if self._campaigns.is_running(name):
            raise BenchBusyError(f"bench {name!r} is busy with a campaign; stop it or wait")
        report = await bench.supervisor.commission(order)
        record = None
        if order.prove and report["state"] in _STORED:
            record = await self._keep(bench, report)
        return {
            "bench": name,
            **report,
            "record": None if record is None else record.id,
            "sha256": None if record is None else record.sha256,
        }

    def standing(self, name: str) -> Json:
        """Tell what is known of a bench's hardware, with the newest record."""
        bench = self._benches.get(name)
        record = None if bench.hardware is None else bench.hardware.record
        standing = bench.standing()
        told = {} if standing is None else standing.to_json()
        return {"bench": name, **told, "record": None if record is None else record.document}

    async def _keep(self, bench: Bench, report: Json) -> CommissioningRecord:
        hardware = await asyncio.to_thread(Hardware.read, self._store, bench.name, bench.config)

        def make(record_id: str, created_utc: str) -> Json:
            return hardware.document(report, record_id, created_utc, self._code_version)

        record = await self._journal.write(self._store.commissionings.add, bench.name, report["state"], make)
        bench.hardware = await asyncio.to_thread(Hardware.read, self._store, bench.name, bench.config)
        severity: Severity = "info" if record.state == "passed" else "error"
        because = "" if report["reason"] is None else f": {report['reason']}"
        text = f"{bench.name}: commissioning {record.state}{because}; record {record.id[:8]}, seal {record.sha256[:12]}"
        event = EventMessage(severity=severity, code=f"commissioning_{record.state}", text=text, run_id=None)
        self._journal.note(bench.name, event)
        self._benches.publish(bench)
        return record
