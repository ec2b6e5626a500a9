"""Runs and campaigns that go on where something outside them has cut them off."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bench_service.bench.latch import INTERRUPTIONS, OF_RUNS, Latch
from bench_service.campaign.ordering import RunOrder
from bench_service.campaign.protocol_standing import left_to_resume as protocol_left
from bench_service.campaign.workshop import CampaignFailedError, CampaignStoppedError
from bench_service.errors import ConflictError, ServiceError
from bench_service.jobs.counting import counted_soc
from bench_service.jobs.runner import WORKER_DIED
from bench_service.store.integrity import Expected, read_whole
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CampaignRecord, RunRecord
from bench_service.store.samples import SampleReader
from bench_service.streams import Columns, Flag

# A run that ends as often as this without a single sample will not get any further the next time.
_MOST_IN_VAIN = 3
_TOLERANCE = 1e-6
ResultT = TypeVar("ResultT")


@dataclass(slots=True)
class Policy:
    """What a campaign has declared: whether it goes on by itself, and how many faults of the bench it may try again.

    Attributes
    ----------
    resumes : bool
        After an interruption: a process that died, a recorder that was gone, a power cut.
    retries : int
        Faults, of which each needs an acknowledgement, that are still tried again.
    in_vain : int
        Ends in a row that have brought no sample.
    """

    resumes: bool
    retries: int = 0
    in_vain: int = 0

    def take(self, role: str, run: RunRecord) -> frozenset[str]:
        """Take note of the end of a run that was not completed; goes on only where the campaign has said so.

        Returns
        -------
        Codes of the latches that the campaign has thereby acknowledged; all others wait for a person.

        Raises
        ------
        CampaignStoppedError
            A person has stopped it.
        CampaignFailedError
            It does not go on by itself.
        """
        if run.state == "stopped":
            raise CampaignStoppedError(f"the {role} run was stopped: {run.reason}")
        self.in_vain = 0 if run.n_samples else self.in_vain + 1
        latch = Latch.of_run(run.state, run.reason)
        cut_off = latch is not None and latch.code in INTERRUPTIONS
        if cut_off and self.resumes and self.in_vain < _MOST_IN_VAIN:
            return INTERRUPTIONS
        if run.state == "fault" and not cut_off and self.retries > 0:
            self.retries -= 1
            return OF_RUNS
        raise CampaignFailedError(f"the {role} run ended as {run.state}: {run.reason}")


async def tried(policy: Policy, work: Callable[[], Awaitable[ResultT]]) -> ResultT:
    """Do a worker's work again where its process has died under it, and the campaign goes on after such things."""
    for _ in range(_MOST_IN_VAIN - 1):
        try:
            return await work()
        except ServiceError as error:
            if not policy.resumes or WORKER_DIED not in str(error):
                raise
    return await work()


def rest_of(
    time_s: NDArray[np.float64], current_A: NDArray[np.float64], played_s: float, dt_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return what is left of a profile, from the tick after the last sample on; None where nothing is.

    Parameters
    ----------
    time_s, current_A : (n,) forward hold, the last row ends the profile
    played_s : how much of it has played when the last sample was stored, see `played_of`
    dt_s : period of the run; set-points change on its ticks only
    """
    start_s = dt_s * math.floor(played_s / dt_s + 0.5)
    if time_s[-1] - start_s < dt_s * (1.0 - _TOLERANCE):
        return None
    later = time_s > start_s + dt_s * _TOLERANCE
    held_A = current_A[np.searchsorted(time_s, start_s + dt_s * _TOLERANCE, side="right") - 1]
    return np.concatenate([[0.0], time_s[later] - start_s]), np.concatenate([[held_A], current_A[later]])


def played_of(columns: Columns, dt_s: float) -> float:
    """Return how much of a profile stored samples have played, in s: a run that somebody held stood still.

    Parameters
    ----------
    columns : columns of the stream ``samples``, each of shape (n,)
    dt_s : period of the run; a pause that began or ended between two samples is known to that only
    """
    ticks = np.floor(columns["time_s"] / dt_s + 0.5)
    # The first sample that is marked was taken when the output had just been switched off: what came before it played.
    held = (columns["flags"][:-1] & Flag.PAUSED) != 0
    return float(dt_s * (ticks[-1] - np.sum(np.diff(ticks)[held])))


def order_of_rest(
    order: RunOrder, parts: list[RunRecord], store: MetadataStore, samples: SampleReader
) -> RunOrder | None:
    """Return the order for what the parts of a run have left over, from where the cell stands; None: nothing is left.

    Reads the store, so it is called in a thread.

    Raises
    ------
    DamagedError
        Samples of a part are missing: nobody knows where the cell stands.
    """
    played_s, soc = 0.0, order.initial_soc
    for part in parts:
        columns = read_whole(samples, Expected.of(part)).columns
        played_s += played_of(columns, order.dt_s)
        soc = float(counted_soc(columns["time_s"], columns["current_A"], part.initial_soc, part.capacity_Ah)[-1])
    soc = min(max(soc, 0.0), 1.0)
    if order.profile_id is None:
        raise ConflictError("a protocol goes on in another way than a profile", ("continues",))
    left = rest_of(*store.profiles.points(order.profile_id), played_s, order.dt_s)
    if left is None:
        return None
    profile = store.profiles.add(f"{order.name}, from {played_s:g} s on", *left)
    observer_soc = order.observer_initial_soc
    if observer_soc is not None:
        observer_soc = min(max(observer_soc + soc - order.initial_soc, 0.0), 1.0)
    continues = parts[-1].id
    return replace(
        order, profile_id=profile.id, initial_soc=soc, observer_initial_soc=observer_soc, continues=continues
    )


def parts_of(store: MetadataStore, campaign: CampaignRecord) -> dict[str, list[RunRecord]]:
    """Return the runs with samples of a campaign by what they are for, in the order in which they were played."""
    runs = store.runs.page(campaign_id=campaign.id, limit=1000)
    prefix, found = f"{campaign.request['name']}: ", {}
    for run in sorted(runs, key=lambda each: each.number):
        if run.n_samples and run.name is not None and run.name.startswith(prefix):
            found.setdefault(run.name.removeprefix(prefix), []).append(run)
    return found


def left_to_resume(store: MetadataStore, bench: str) -> CampaignRecord | None:
    """Return the campaign that goes on by itself on a bench when the service starts: its last, where that was cut off.

    One that somebody has stopped, or that has failed, never does.
    """
    for campaign in store.campaigns.page(limit=1000):
        if campaign.state != "queued" and bench in (campaign.bench, campaign.request.get("changed_bench")):
            cut_off = campaign.state in ("running", "interrupted")
            goes_on = cut_off and campaign.done is not None and campaign.request.get("on_interruption") == "resume"
            return campaign if goes_on else None
    return None


def resumed_soc(store: MetadataStore, samples: SampleReader, bench: str) -> float | None:
    """Return where the cell on a bench stands whose campaign goes on; None where none does, or nobody knows.

    A simulated cell is made anew with the service, and must stand where the stored samples have left it.
    """
    if left_to_resume(store, bench) is None and protocol_left(store, bench) is None:
        return None
    for run in store.runs.page(bench=bench, limit=100):
        data = samples.read(run.id)
        if data.n and not data.gaps:
            columns = data.columns
            soc = counted_soc(columns["time_s"], columns["current_A"], run.initial_soc, run.capacity_Ah)[-1]
            return min(max(float(soc), 0.0), 1.0)
    return None


def check_resumable(campaign: CampaignRecord, runs_before_cell: int, last: RunRecord | None) -> None:
    """Raise `ConflictError` where a campaign cannot go on."""
    if campaign.state not in ("interrupted", "failed", "stopped"):
        raise ConflictError(
            f"campaign {campaign.id} is {campaign.state}; there is nothing to go on with", ("campaign",)
        )
    if campaign.done is None:
        raise ConflictError(f"campaign {campaign.id} has not kept what it has done; start it anew", ("campaign",))
    if last is not None and last.number <= runs_before_cell:
        raise ConflictError(
            f"the simulated cell of campaign {campaign.id} has begun anew with the service; start the campaign anew",
            ("campaign",),
        )
