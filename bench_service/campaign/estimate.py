"""How long a campaign takes in real time, said before it starts and while it goes on."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from bench_service.campaign.benches import Bench
from bench_service.campaign.request import CampaignRequest
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import CampaignRecord, Json, utc_text

NO_ESTIMATE: Json = dict.fromkeys(("runs", "test_s", "real_s", "hours", "finish_utc", "basis"))
_PLAYS = ("run", "rounds", "observe", "change")


@dataclass(frozen=True, slots=True)
class Estimate:
    """Real time of the runs of a campaign; fits between them come on top.

    Attributes
    ----------
    runs : int
    test_s : float
        Of all of them, by the clock of the tests.
    real_s : float or None
        By the wall clock; None where the bench is in lock-step and nobody knows how fast.
    basis : str
        What that rests on, for people.
    """

    runs: int
    test_s: float
    real_s: float | None
    basis: str

    def to_json(self) -> Json:
        """Return a JSON object."""
        hours = None if self.real_s is None else self.real_s / 3600.0
        finish = None if self.real_s is None else utc_text(datetime.now(UTC) + timedelta(seconds=self.real_s))
        return {
            "runs": self.runs,
            "test_s": self.test_s,
            "real_s": self.real_s,
            "hours": hours,
            "finish_utc": finish,
            "basis": self.basis,
        }

    def in_words(self) -> str:
        """Return one phrase for a person."""
        if self.real_s is None:
            return f"{self.runs} runs, {self.test_s / 3600:.1f} h of test time; {self.basis}"
        return f"{self.runs} runs, about {self.real_s / 3600:.2g} h of real time without the fits ({self.basis})"


def estimate(request: CampaignRequest, bench: Bench, store: MetadataStore) -> Estimate:
    """Say how long the runs of a campaign take; reads the store, so it is called in a thread."""
    runs = 2 + (request.rounds - 1) + (2 if request.diagnose == "change" else 0)
    test_s = runs * request.duration_s
    if not bench.summary()["lock_step"]:
        return Estimate(runs, test_s, test_s, "each run takes as long as its profile")
    for run in store.runs.page(bench=bench.name, state="completed", limit=1):
        if run.elapsed_s and run.n_samples:
            rate = run.elapsed_s / (run.n_samples * run.dt_s)
            samples_rate = rate * run.dt_s / request.dt_s  # lock-step takes its time per sample, not per second
            return Estimate(runs, test_s, test_s * samples_rate, "as fast per sample as the bench's last run")
    return Estimate(runs, test_s, None, "in lock-step, as fast as the machine can")


def played(done: Json, stage: str, share: float, message: str) -> float:
    """Return how many of a campaign's runs have been played, the present one in part."""
    now = min(max(share, 0.0), 1.0) if stage in _PLAYS and message.endswith("played") else 0.0
    return float(done.get("completed", 0)) + now


def time_left(record: CampaignRecord) -> Json:
    """Return ``time_left_s`` and ``finish_utc`` of a campaign that runs; None where they are not known."""
    known = (record.done or {}).get("estimate")
    if record.state != "running" or not known or known["real_s"] is None:
        return {"estimate": known, "time_left_s": None, "finish_utc": None}
    left = max(known["runs"] - float((record.done or {}).get("played", 0.0)), 0.0) / known["runs"]
    left_s = left * known["real_s"]
    finish = utc_text(datetime.now(UTC) + timedelta(seconds=left_s))
    return {"estimate": known, "time_left_s": left_s, "finish_utc": finish}
