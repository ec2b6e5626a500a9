"""Everything that routes, pages and campaigns work with, put together once by the application."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench_service.campaign.aside import Aside
from bench_service.campaign.benches import Benches
from bench_service.campaign.campaigns import CampaignRunner
from bench_service.campaign.cells import Cells
from bench_service.campaign.commissioning import Commissioning
from bench_service.campaign.designing import Designing
from bench_service.campaign.diagnosing import Diagnosing
from bench_service.campaign.importing import Importing
from bench_service.campaign.journal import Journal
from bench_service.campaign.learning import Learning
from bench_service.campaign.live import Broadcaster
from bench_service.campaign.modelling import Modelling
from bench_service.campaign.observing import Observing
from bench_service.campaign.reporting import Reporting
from bench_service.campaign.runs import Runs
from bench_service.campaign.storage import Storage
from bench_service.campaign.trending import Trending
from bench_service.config import ServiceConfig
from bench_service.jobs.runner import JobRunner
from bench_service.jobs.screening import Screen
from bench_service.store.metadata import MetadataStore
from bench_service.store.samples import SampleReader
from bench_service.store.views import Views


@dataclass(frozen=True, slots=True)
class Services:
    """The parts of a running service.

    ``recorder_state`` gives ``"running"`` or what is wrong with the recorder.
    """

    config: ServiceConfig
    version: str
    store: MetadataStore
    samples: SampleReader
    views: Views
    journal: Journal
    benches: Benches
    runs: Runs
    jobs: JobRunner
    screen: Screen
    aside: Aside
    modelling: Modelling
    observing: Observing
    learning: Learning
    diagnosing: Diagnosing
    designing: Designing
    trending: Trending
    campaigns: CampaignRunner
    live: Broadcaster
    recorder_state: Callable[[], str]
    storage: Storage
    cells: Cells
    commissioning: Commissioning
    importing: Importing
    reporting: Reporting
