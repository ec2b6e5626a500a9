"""What the observer can know of a cell, what it made of runs, and what other settings would have made: one page."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from bench_service.cli.readout_page import Line, plot
from bench_service.cli.report import page, table
from models.data.errors import ModelError
from models.observer.certificate.observability import observability
from models.observer.certificate.stability import Stability, stability
from models.observer.tuning.trade_off import TradeOff

if TYPE_CHECKING:
    from models.observer import FuzzyObserver
    from models.observer.observation import Observation

_BLUE, _ORANGE, _GREY = "#0b62a8", "#c2410c", "#7a7a7a"
_BAND_95 = 1.96
_FIGURES = ("soc_rmse", "soc_max_error", "converged_after_s", "coverage_95")
_POINTS = 1500


def observer_page(
    model: str, observer: FuzzyObserver, observed: Sequence[Observation], choices: Sequence[TradeOff]
) -> bytes:
    """Page for a browser, without anything from another host.

    Parameters
    ----------
    model : what the person calls the model
    observer : of one cell
    observed : runs that were replayed
    choices : what other settings would have made of them; empty where no run has a reference
    """
    parts = [f"<h1>State of charge with {escape(model)}</h1>", *_runs(observed), *_trade_off(choices)]
    parts += [*_observability(observer), "<h2>Stability</h2>", f"<p>{_stability(observer)}</p>"]
    return page(f"{model}: observer", parts)


def _runs(observed: Sequence[Observation]) -> list[str]:
    rows = [{"run": each.name, **{key: each.figures[key] for key in _FIGURES}} for each in observed]
    parts = [table(("run", *_FIGURES), rows)]
    for each in observed:
        thin = slice(None, None, max(len(each.time_s) // _POINTS, 1))
        hours = each.time_s[thin] / 3600.0
        lines = [Line("observer", hours, each.soc[thin], _BAND_95 * each.soc_std[thin], _ORANGE)]
        if each.soc_ref is not None:
            lines.append(Line("reference", hours, each.soc_ref[thin], None, _BLUE))
        parts += [f"<h2>{escape(each.name)}</h2>", plot(lines, "h", "SoC")]
        parts += [f"<p>{escape(alarm)}</p>" for alarm in each.alarms]
    return parts


def _trade_off(choices: Sequence[TradeOff]) -> list[str]:
    if not choices:
        return []
    rows = [
        {
            "noise and model error times": each.factor,
            "below 3 % after s": each.converged_after_s,
            "RMSE %": 100.0 * each.soc_rmse,
            "in 95 % band %": 100.0 * each.coverage_95,
        }
        for each in choices
    ]
    minutes = np.array([each.converged_after_s for each in choices]) / 60.0
    error = 100.0 * np.array([each.soc_rmse for each in choices])
    decades = np.log10([each.factor for each in choices])
    minutes[np.isinf(minutes)] = np.nan
    return [
        "<h2>Convergence against accuracy</h2>",
        "<p>The same runs from 20 points off, with the voltage trusted less from left to right; 0 is as tuned.</p>",
        table(tuple(rows[0]), rows),
        plot([Line("below 3 % after", decades, minutes, None, _BLUE)], "log10 of the factor", "min"),
        plot([Line("RMSE after", decades, error, None, _ORANGE)], "log10 of the factor", "%"),
    ]


def _observability(observer: FuzzyObserver) -> list[str]:
    soc = np.linspace(0.02, 0.98, 49)
    seen = observability(observer.network, soc, settings=observer.settings)
    blind = 100.0 * float(np.mean(seen.blind))
    std = Line("after an hour", soc, 100.0 * np.minimum(seen.soc_std, 0.5), None, _ORANGE)
    noise = Line("by noise alone", soc, 100.0 * np.minimum(seen.noise_std, 0.5), None, _GREY)
    ball = Line("error ball", soc, 100.0 * seen.ball, None, _BLUE)
    return [
        "<h2>What the voltage tells at 25 °C</h2>",
        f"<p>Standard deviation of the SoC by voltage at rest. Charge has to be counted over {blind:.0f} % of it.</p>",
        plot([std, noise], "SoC", "%"),
        "<p>Error ball: how far off an estimate may settle while the model's error is within its 95 % band.</p>",
        plot([ball], "SoC", "%"),
    ]


def _stability(observer: FuzzyObserver) -> str:
    try:
        found = stability(observer.network, observer.settings)
    except (ModelError, np.linalg.LinAlgError) as error:
        return escape(f"Nothing can be said: {error}")
    return in_words(found)


def in_words(found: Stability) -> str:
    """Say what was proven of the error's decay, and what was not."""
    if found.certified:
        return (
            f"A common Lyapunov function holds for all {found.pairs} pairs of local models that overlap: with "
            "steady-state gains the error dies out whatever the blend."
        )
    return (
        f"No common Lyapunov function was found for the {found.pairs} pairs of local models that overlap. In the best "
        f"norm the error grows by at most {found.contraction:.6f} per sample; each pair by itself shrinks it to "
        f"{found.spectral_radius:.6f}."
    )
