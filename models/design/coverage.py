"""How much of what was asked for a test goes through: charge, current, temperature; known before it is played."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.limits import Limits, Window
from models.design.sequence.sequence_plan import SequencePlan

# The asked window of the state of charge and of the current, cut into so many equal cells each.
SOC_CELLS, CURRENT_CELLS = 8, 7
# A cell counts where a test spends as long in it, or one sample where that is longer.
_LEAST_S = 10.0
# Ends of a window count as reached where no more than this is missing.
NEAR_SOC, _NEAR_K = 0.01, 0.5


@dataclass(frozen=True)
class Coverage:
    """Where a test goes.

    Attributes
    ----------
    share : of the cells of the asked states of charge and currents, 0..1
    soc, current_A : lowest and highest
    soc_short : what is missing to the ends of the asked window
    temperature_degC : lowest and highest that the model expects; None: it has no thermal model
    temperature_share : of the asked window; None: none was asked for, or nothing is expected
    reasons : why an end is not reached, in words
    """

    share: float
    soc: Window
    soc_short: Window
    current_A: Window
    temperature_degC: Window | None
    temperature_share: float | None
    reasons: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain types."""
        return {
            "share": self.share,
            "soc": list(self.soc),
            "soc_short": list(self.soc_short),
            "current_A": list(self.current_A),
            "temperature_degC": None if self.temperature_degC is None else list(self.temperature_degC),
            "temperature_share": self.temperature_share,
            "cells": {"soc": SOC_CELLS, "current": CURRENT_CELLS},
            "reasons": list(self.reasons),
        }


def coverage_of(
    limits: Limits,
    soc: FloatArray,
    current_A: FloatArray,
    dt_s: float,
    plan: SequencePlan | None = None,
    temperature_degC: FloatArray | None = None,
    meant_soc: Window | None = None,
    colder: str = "",
) -> Coverage:
    """Say where a test goes.

    Parameters
    ----------
    limits : that were asked for
    soc, current_A : (N,) expected state of charge at the end of each sample, and its current
    dt_s : sampling time
    plan : of a sequence; None: it is another signal, whose way is its own
    temperature_degC : (N,) expected, or None
    meant_soc : where another signal goes by itself, before the limits change it; None: not known
    colder : what to do about a cell that may be colder than predicted; see `voltage_band.colder_words`
    """
    reached = float(soc.min()), float(soc.max())
    short = max(reached[0] - limits.soc[0], 0.0), max(limits.soc[1] - reached[1], 0.0)
    meant = reached if meant_soc is None else meant_soc
    cut = (meant[0] < reached[0] - NEAR_SOC, meant[1] > reached[1] + NEAR_SOC)
    expected = None if temperature_degC is None else (float(temperature_degC.min()), float(temperature_degC.max()))
    reasons = []
    for side, name in enumerate(("lowest", "highest")):
        if short[side] > NEAR_SOC:
            said = f"SoC {limits.soc[side]:.3f} is not reached, the {name} is {reached[side]:.3f}"
            reasons.append(f"{said} ({short[side]:.3f} short): {_cause(plan, cut[side], colder)}")
    return Coverage(
        share=_share(limits, soc, current_A, dt_s),
        soc=reached,
        soc_short=short,
        current_A=(float(current_A.min()), float(current_A.max())),
        temperature_degC=expected,
        temperature_share=_within(limits.temperature_degC, expected),
        reasons=tuple(reasons),
    )


def _share(limits: Limits, soc: FloatArray, current_A: FloatArray, dt_s: float) -> float:
    edges = (np.linspace(*limits.soc, SOC_CELLS + 1), np.linspace(*limits.current_A, CURRENT_CELLS + 1))
    count, _, _ = np.histogram2d(np.clip(soc, *limits.soc), np.clip(current_A, *limits.current_A), edges)
    return float((count >= max(1, round(_LEAST_S / dt_s))).mean())


def _within(asked: Window | None, expected: Window | None) -> float | None:
    if asked is None or expected is None:
        return None
    return max(min(asked[1], expected[1] + _NEAR_K) - max(asked[0], expected[0] - _NEAR_K), 0.0) / (asked[1] - asked[0])


def _cause(plan: SequencePlan | None, is_cut: bool, colder: str) -> str:
    """Why an end is not reached, and what to do about it; a signal that is no sequence may be cut by the limits."""
    if plan is None and not is_cut:
        return "the signal does not go there in its time; a sequence over soc_levels does"
    if plan is not None and plan.ends is None:
        if len(plan.soc_levels) > 1:
            return "the duration leaves no time for the way beyond the levels; give more"
        return "the levels are not spread over the window"
    return (
        "the expected voltage, its uncertainty included, would leave limit voltage_V; widen it, or refine the model"
        + colder
    )
