"""A design as one self-contained page: current, predicted voltage with its band, SoC, coverage, what it tells."""

from __future__ import annotations

from dataclasses import replace
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from bench_service.cli.readout_page import Line, Values, plot
from bench_service.cli.report import page, table
from bench_service.store.decimation import kept_rows
from models.design.coverage import CURRENT_CELLS, SOC_CELLS
from models.design.optimise.block_design import OPTIMAL, plan_of
from models.design.overview import coverage, family_std, mean_std, mean_std_over_time
from models.design.sequence.load_cycle import load_histogram

if TYPE_CHECKING:
    from models.design.design import Design
    from models.design.information.experiment import Experiment
    from models.design.optimise.block_design import DesignRequest

_POINTS = 1600
_BLUE, _RUST, _GREY, _GREEN = "#0b62a8", "#c2410c", "#7a7a7a", "#2f7d4f"
_LEFT, _CELL, _ROW, _TOP, _FOOT = 70, 36, 20, 12, 40


def design_page(title: str, experiment: Experiment, request: DesignRequest, found: Design) -> bytes:
    """Return the page as UTF-8.

    Parameters
    ----------
    title : name of the profile
    experiment, request : what was asked for, and of which model
    found : the design
    """
    hours = np.arange(len(found.current_A)) * found.dt_s / 3600.0
    throughput_Ah = float(np.abs(found.current_A).sum()) * found.dt_s / 3600.0
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p>{found.duration_s / 3600.0:.2f} h, {len(found.current_A)} samples, {throughput_Ah:.2f} Ah moved, "
        f"{100.0 * found.touched.mean():.0f} % of the samples lie at a limit. The voltage's band is meant for all "
        "samples at once.</p>",
        *_accuracy(request, found),
        *_course(hours, request, found),
        *_ratio(experiment, request),
        *_load(request),
        "<h2>Where the time is spent</h2>",
        *_covered(found),
        "<p>Share of the time by SoC and current; darker is more</p>",
        _coverage(request, found),
        *_telling(experiment, request, found),
    ]
    return page(f"{title}: design", parts)


def _covered(found: Design) -> list[str]:
    """How much of what was asked for, in words."""
    said = found.coverage
    text = (
        f"{100.0 * said.share:.0f} % of the asked window of SoC and current ({SOC_CELLS} by {CURRENT_CELLS} cells) is "
        f"gone through; SoC {said.soc[0]:.3f} to {said.soc[1]:.3f}, {said.current_A[0]:.3g} to "
        f"{said.current_A[1]:.3g} A"
    )
    if said.temperature_degC is not None:
        text += f", {said.temperature_degC[0]:.1f} to {said.temperature_degC[1]:.1f} degC by its own heat"
    return [f"<p>{text}.</p>", *(f"<p>{escape(reason)}.</p>" for reason in said.reasons)]


def _accuracy(request: DesignRequest, found: Design) -> list[str]:
    if request.target_std is None:
        return []
    reached = "reached" if found.largest_std <= request.target_std else "not reached"
    return [
        f"<p>Accuracy asked for: {request.target_std:g} (normalised units); {found.largest_std:.3g} after "
        f"{len(found.blocks)} visits, {reached}. {found.saved_h:.2f} h of {found.planned_s / 3600.0:.2f} h saved.</p>"
    ]


def _course(hours: Values, request: DesignRequest, found: Design) -> list[str]:
    limits = request.limits
    middle, half = 0.5 * (found.band_low_V + found.band_high_V), 0.5 * (found.band_high_V - found.band_low_V)
    voltage = [_thinned("with its band", hours, middle, _BLUE, half)]
    if limits.voltage_V is not None:
        voltage += [_level(f"limit {edge:g} V", hours, edge) for edge in limits.voltage_V]
    return [
        "<h2>Current</h2>",
        plot([_thinned("current", hours, found.current_A, _RUST)], "h", "A"),
        "<h2>Voltage that the model expects</h2>",
        plot(voltage, "h", "V"),
        "<h2>State of charge</h2>",
        plot(
            [_thinned("SoC", hours, found.soc, _GREEN), *(_level(f"limit {e:g}", hours, e) for e in limits.soc)],
            "h",
            "SoC",
        ),
    ]


def _ratio(experiment: Experiment, request: DesignRequest) -> list[str]:
    """How much of the largest current the voltage leaves, of a sequence."""
    if request.signal != OPTIMAL or not request.soc_levels:
        return []
    ratio = plan_of(experiment, request).ratio
    shares = (("discharge", ratio.discharge, _RUST), ("charge", ratio.charge, _BLUE))
    return [
        "<h2>Limitation ratio</h2>",
        "<p>Share of the largest current that the expected voltage, with its band, leaves at each SoC</p>",
        plot([Line(name, ratio.soc, share, None, colour) for name, share, colour in shares], "SoC", ""),
    ]


def _load(request: DesignRequest) -> list[str]:
    """Load cycle and histogram that bound the blocks, where there is one."""
    if request.cycle_A is None:
        return []

    histogram = load_histogram(request.cycle_A)
    rows = [
        {"from / A": float(low), "to / A": float(high), "share of the time / %": 100.0 * float(share)}
        for low, high, share in zip(histogram.edges_A[:-1], histogram.edges_A[1:], histogram.share, strict=True)
    ]
    samples = np.arange(len(request.cycle_A), dtype=np.float64)
    return [
        "<h2>Load cycle</h2>",
        plot([_thinned("load cycle", samples, request.cycle_A, _GREY)], "sample", "A"),
        "<p>Its histogram: each interval bounds the current of the blocks for its share of the time</p>",
        table(tuple(rows[0]), rows),
    ]


def _telling(experiment: Experiment, request: DesignRequest, found: Design) -> list[str]:

    time_s, std = mean_std_over_time(experiment, found.current_A)
    own = mean_std(found.information)
    line = Line("this test", time_s / 3600.0, np.log10(std), None, _BLUE)
    rows: list[dict[str, Any]] = [{"signal": request.signal, "mean std": own, "over this test": 1.0}]
    # The others get the time that this test takes, which may have ended before its plan did.
    same_time = replace(request, duration_s=found.duration_s, target_std=None)
    for name, other in family_std(experiment, same_time).items():
        if name != request.signal:
            told = "not possible" if other is None else other
            rows.append({"signal": name, "mean std": told, "over this test": "" if other is None else other / own})
    return [
        "<h2>What it tells</h2>",
        "<p>Geometric mean of the parameters' standard deviations (normalised units), as power of ten, over time</p>",
        plot([line], "h", ""),
        "<p>The same at the end, and of the other families of signals in the same time and limits</p>",
        table(tuple(rows[0]), rows),
    ]


def _thinned(label: str, x: Values, y: Values, colour: str, half: Values | None = None) -> Line:
    shapes = {"y": y} if half is None else {"low": y - half, "high": y + half}
    rows = kept_rows(shapes, len(y), _POINTS, tuple(shapes))
    return Line(label, x[rows], y[rows], None if half is None else half[rows], colour)


def _level(label: str, x: Values, value: float) -> Line:
    return Line(label, x[[0, -1]], np.full(2, value), None, _GREY)


def _coverage(request: DesignRequest, found: Design) -> str:
    """Heat map of SoC and current."""
    share, soc, current = coverage(found.soc, found.current_A, request.limits.soc, request.limits.current_A)
    most, body = max(float(share.max()), 1e-12), []
    for i, row in enumerate(share):
        for j, part in enumerate(row):
            x, y = _LEFT + _CELL * i, _TOP + _ROW * (len(row) - 1 - j)
            # By its root: a rest at one level must not hide everything else.
            body.append(
                f'<rect x="{x}" y="{y}" width="{_CELL}" height="{_ROW}" fill="{_BLUE}" stroke="#eee" '
                f'fill-opacity="{np.sqrt(part / most):.3f}"><title>{100.0 * part:.2f} %</title></rect>'
            )
    bottom = _TOP + _ROW * share.shape[1]
    for i in range(0, len(soc), 4):
        body.append(f'<text x="{_LEFT + _CELL * i}" y="{bottom + 16}" text-anchor="middle">{soc[i]:.2f}</text>')
    for j in range(0, len(current), 3):
        body.append(f'<text x="{_LEFT - 6}" y="{bottom - _ROW * j + 4}" text-anchor="end">{current[j]:.2f}</text>')
    width = _LEFT + _CELL * share.shape[0] + 20
    body.append(f'<text x="{0.5 * width}" y="{bottom + 34}" text-anchor="middle">SoC</text>')
    body.append(f'<text x="4" y="{_TOP + 6}">A</text>')
    return f'<svg viewBox="0 0 {width} {bottom + _FOOT}" role="img">{"".join(body)}</svg>'
