"""The profiles of a campaign, and whether a bench may play them: checked before the campaign is taken on."""

from __future__ import annotations

import numpy as np

from bench_service.bench.limits import Limits
from bench_service.campaign.admission import MOST_TICKS, admit
from bench_service.campaign.request import CampaignRequest, lowest_round_end
from bench_service.errors import BadRequestError
from models.design import Profile, StepProfileRequest, final_rest_s, step_profile

TRAIN, VALIDATE = "train", "validate"
CHANGED, CHANGED_VALIDATE = "changed", "changed_validate"
# With fewer samples the dozens of coefficients of a network are not determined.
_FEWEST_SAMPLES = 1000
# Counting noisy currents ends a little beside the plan; the next plan starts at the window's edge then.
_SOC_SLACK = 0.01


def plan_profiles(
    request: CampaignRequest, initial_soc: float | None = None, played: bool = False
) -> dict[str, Profile]:
    """Design one profile for identification and another, from other random numbers, for judgement.

    Where it is to be found out what has changed, two more of the same kind follow. The same request gives the same
    profiles, to the bit.

    Parameters
    ----------
    request : CampaignRequest
    initial_soc : float or None
        Where the cell stands; None: where the request has it.
    played : bool
        Whether training is over: only what follows is planned.

    Raises
    ------
    ModelError
        The request contradicts itself, or its time does not suffice.
    """
    profiles: dict[str, Profile] = {}
    soc = request.initial_soc if initial_soc is None else initial_soc
    roles = (TRAIN, VALIDATE, CHANGED, CHANGED_VALIDATE) if request.diagnose == "change" else (TRAIN, VALIDATE)
    for number, role in enumerate(roles):
        if played and role == TRAIN:
            continue
        if role == CHANGED and request.changed_bench not in (None, request.bench):
            soc = request.changed_initial_soc
        profiles[role] = _profile(request, soc, number)
        soc = float(profiles[role].soc(soc, request.capacity_Ah)[-1])
    return profiles


def check_plan(request: CampaignRequest, limits: Limits, capacity_Ah: float, tick_s: float | None = None) -> None:
    """Check a request and both of its profiles against a bench, as their runs will be checked when they start.

    Parameters
    ----------
    request : CampaignRequest
    limits : Limits
        Of the bench.
    capacity_Ah : float
        With which the bench counts charge.
    tick_s : float or None
        Period of the set-points; None: that of the samples.

    Raises
    ------
    BadRequestError
        A limit of the bench would be left; sampling time and duration do not fit together.
    ModelError
        As `plan_profiles`.
    """
    _check_window("current_A", request.current_A, limits.current_A, "A")
    _check_window("soc", request.soc, limits.soc, "")
    low, high = request.soc
    if not low - _SOC_SLACK <= request.initial_soc <= high + _SOC_SLACK:
        raise BadRequestError(
            f"the cell stands outside the window of the campaign (known from {request.initial_soc_from})",
            ("initial_soc",),
            value=request.initial_soc,
            limit=request.soc,
            remedy="choose a soc window that holds it, or charge or discharge the cell first",
        )
    # Before anything is built: the builder works through the whole duration, however long.
    if request.duration_s > limits.duration_s:
        raise BadRequestError(
            "longer than the bench allows",
            ("duration_s",),
            value=request.duration_s,
            unit="s",
            limit=limits.duration_s,
            remedy="shorten it",
        )
    n_samples = request.duration_s / request.dt_s
    if not _FEWEST_SAMPLES <= n_samples <= MOST_TICKS:
        raise BadRequestError(
            f"{request.duration_s:g} s hold {n_samples:.0f} samples; {_FEWEST_SAMPLES} to {MOST_TICKS} are needed",
            ("dt_s",),
            value=request.dt_s,
            unit="s",
            remedy="change dt_s or duration_s",
        )
    soc, grid = request.initial_soc, {"dt_s": request.dt_s, "tick_s": tick_s or request.dt_s}
    for role, profile in plan_profiles(request).items():
        if role == CHANGED and request.changed_bench not in (None, request.bench):
            soc = request.changed_initial_soc
        admit(profile.time_s, profile.current_A, limits, initial_soc=soc, capacity_Ah=capacity_Ah, **grid)
        soc = float(profile.soc(soc, capacity_Ah)[-1])
    if request.rounds > 1:
        # Now, and not when hours of rounds have been played: what follows them must find the time.
        plan_profiles(request, lowest_round_end(request.soc), played=True)


def _check_window(name: str, window: tuple[float, float], limit: tuple[float, float], unit: str) -> None:
    low, high = window
    if not low < high:
        raise BadRequestError("the low end must be below the high end", (name,), value=window, unit=unit)
    if low < limit[0] or high > limit[1]:
        remedy = "stay within the bench's limits"
        raise BadRequestError(
            "wider than the bench allows", (name,), value=window, unit=unit, limit=limit, remedy=remedy
        )


def _profile(request: CampaignRequest, initial_soc: float, number: int) -> Profile:
    low, high = request.soc
    return step_profile(
        StepProfileRequest(
            capacity_Ah=request.capacity_Ah,
            current_A=request.current_A,
            soc=request.soc,
            initial_soc=min(max(initial_soc, low), high),
            duration_s=request.duration_s,
            dt_s=request.dt_s,
            final_rest_s=final_rest_s(request.duration_s),
        ),
        np.random.default_rng([request.seed, number]),
    )
