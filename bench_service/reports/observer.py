"""Report of an observer: what it can know of a cell, what it made of runs, what other settings would have made."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bench_service.reports import words
from bench_service.reports.document import Heading, Part, Points, Report, Section, Table
from bench_service.reports.drawing import BLUE, GREY, RUST, Axis, Line, curves
from bench_service.reports.free_run import TIME

if TYPE_CHECKING:
    from models.observer import FuzzyObserver
    from models.observer.certificate.stability import Stability
    from models.observer.observation import Observation
    from models.observer.tuning.trade_off import TradeOff

_BAND_95 = 1.96
_SOC = Axis("state of charge", "%")


def observer_report(
    heading: Heading, observer: FuzzyObserver, observed: Sequence[Observation], choices: Sequence[TradeOff]
) -> Report:
    """Put the report together.

    Parameters
    ----------
    observer : of one cell
    observed : runs that were replayed
    choices : what other settings would have made of them; empty where no run has a reference
    """
    rows = [(each.name, *_figures(each)) for each in observed]
    heads = ("Run", "RMS error", "Largest error", "Below 3 % after", "Within the 95 % band")
    sections = [Section(f"Run {each.name}", _run(each)) for each in observed]
    sections += [*_trade_off(choices), _observability(observer), Section("Stability", [_stability(observer)])]
    return Report(heading, [Table(heads, rows, frozenset({1, 2, 3, 4}))], sections)


def _figures(observed: Observation) -> tuple[str, ...]:
    figures = observed.figures
    return (
        words.percent(figures["soc_rmse"], 2),
        words.percent(figures["soc_max_error"], 2),
        words.duration(figures["converged_after_s"]),
        words.percent(figures["coverage_95"], 1),
    )


def _run(observed: Observation) -> list[Part]:
    hours = observed.time_s / 3600.0
    lines = [Line("observer, with 95 % band", hours, 100.0 * observed.soc, 100.0 * _BAND_95 * observed.soc_std, RUST)]
    if observed.soc_ref is not None:
        lines.append(Line("reference", hours, 100.0 * observed.soc_ref, None, BLUE))
    alarms = [words.sentence(alarm) for alarm in observed.alarms]
    drawn = curves("State of charge", lines, TIME, _SOC)
    return [drawn, *([Points(alarms)] if alarms else [])]


def _trade_off(choices: Sequence[TradeOff]) -> list[Section]:
    if not choices:
        return []
    rows = [
        (
            words.number(each.factor),
            words.duration(each.converged_after_s) if np.isfinite(each.converged_after_s) else "never",
            words.percent(each.soc_rmse, 2),
            words.percent(each.coverage_95, 1),
        )
        for each in choices
    ]
    minutes = np.array([each.converged_after_s for each in choices]) / 60.0
    error = 100.0 * np.array([each.soc_rmse for each in choices])
    decades = np.log10([each.factor for each in choices])
    minutes[np.isinf(minutes)] = np.nan
    axis = Axis("noise and model error taken as larger, power of ten")
    heads = ("Noise and model error taken times", "Below 3 % after", "RMS error", "Within the 95 % band")
    return [
        Section(
            "Convergence against accuracy",
            [
                "The same runs from 20 points off, with the voltage trusted less from left to right; 0 is as tuned.",
                Table(heads, rows, frozenset({0, 1, 2, 3})),
                curves("Error below 3 % after", [Line("", decades, minutes, None, BLUE)], axis, Axis("time", "min")),
                curves("RMS error after that", [Line("", decades, error, None, RUST)], axis, Axis("error", "%")),
            ],
        )
    ]


def _observability(observer: FuzzyObserver) -> Section:
    # Lazy: numba and scipy take 1.0 s.
    from models.observer.certificate.observability import observability

    soc = np.linspace(0.02, 0.98, 49)
    seen = observability(observer.network, soc, settings=observer.settings)
    blind, places = 100.0 * float(np.mean(seen.blind)), 100.0 * soc
    std = Line("after an hour", places, 100.0 * np.minimum(seen.soc_std, 0.5), None, RUST)
    noise = Line("by noise alone", places, 100.0 * np.minimum(seen.noise_std, 0.5), None, GREY)
    ball = Line("", places, 100.0 * seen.ball, None, BLUE)
    return Section(
        "What the voltage tells at 25 °C",
        [
            f"Charge has to be counted over {blind:.0f} % of the state of charge.",
            curves("Standard deviation of the state of charge by voltage at rest", [std, noise], _SOC,
                   Axis("standard deviation", "%")),
            curves("How far off an estimate may settle while the model's error is within its 95 % band", [ball], _SOC,
                   Axis("error", "%")),
        ],
    )  # fmt: skip


def _stability(observer: FuzzyObserver) -> str:
    # Lazy: numba and scipy take 1.0 s.
    from models.data.errors import ModelError
    from models.observer.certificate.stability import stability

    try:
        found = stability(observer.network, observer.settings)
    except (ModelError, np.linalg.LinAlgError) as error:
        return f"Nothing can be said: {error}"
    if observer.settings.gain == "steady":
        return in_words(found)
    return (
        f"{in_words(found)} The estimates of this report were made with the gain from the covariance of the moment, of "
        "which nothing is proven."
    )


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
