"""What a campaign works with, and how one of its stages fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bench_service.campaign.benches import Benches
from bench_service.campaign.designing import Designing
from bench_service.campaign.diagnosing import Diagnosing
from bench_service.campaign.modelling import Modelling
from bench_service.campaign.runs import Runs
from bench_service.errors import ServiceError
from bench_service.jobs.runner import JobRunner
from bench_service.store.metadata import MetadataStore
from bench_service.store.samples import SampleReader

# Takes stage, share 0..1 of the stage that is done, and one line for people.
Report = Callable[[str, float, str], None]


class CampaignFailedError(ServiceError):
    """A stage did not reach its end; the message says which and why."""

    code = "campaign_failed"


class CampaignStoppedError(ServiceError):
    """A person has stopped what the campaign was doing."""

    code = "campaign_stopped"


@dataclass(frozen=True, slots=True)
class Workshop:
    """What a campaign works with."""

    store: MetadataStore
    samples: SampleReader
    benches: Benches
    runs: Runs
    modelling: Modelling
    diagnosing: Diagnosing
    designing: Designing
    jobs: JobRunner
