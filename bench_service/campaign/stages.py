"""Which stages a campaign has, and how far it is."""

from __future__ import annotations

from collections.abc import Sequence

from bench_service.campaign.request import CampaignRequest

# How much of the time each stage takes on a simulated bench; only the progress bar uses it.
_SHARES = {
    "design": 0.01,
    "run": 0.33,
    "fit": 0.3,
    "rounds": 1.0,
    "observe": 0.33,
    "compare": 0.02,
    "change": 0.6,
    "diagnose": 0.5,
    "report": 0.01,
}


def stages_of(request: CampaignRequest) -> tuple[str, ...]:
    """Names of the stages of a campaign, in their order."""
    asked = {
        "rounds": request.rounds > 1,
        "change": request.diagnose == "change",
        "diagnose": request.diagnose is not None,
    }
    return tuple(stage for stage in _SHARES if asked.get(stage, True))


def overall_progress(stages: Sequence[str], stage: str, share: float) -> float:
    """Share 0..1 of the whole campaign, which has these stages."""
    whole = sum(_SHARES[s] for s in stages)
    before = sum(_SHARES[s] for s in stages[: stages.index(stage)])
    return min((before + _SHARES[stage] * share) / whole, 1.0)
