"""Report of a design: current, predicted voltage with its band, SoC, coverage, what the test tells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bench_service.reports import words
from bench_service.reports.comparison import usability_parts
from bench_service.reports.document import Heading, Key, Keys, Part, Points, Report, Section, Table
from bench_service.reports.drawing import BLUE, GREEN, GREY, RUST, Axis, Line, Values, curves, heat_map, level
from bench_service.reports.free_run import TIME

if TYPE_CHECKING:
    from models.design.answer import Answer
    from models.design.design import Design
    from models.design.information.experiment import Experiment
    from models.design.optimise.block_design import DesignRequest
    from models.design.sequence.profile import Profile

_SOC = Axis("state of charge", "%")
_CURRENT = Axis("current", "A")


def design_report(heading: Heading, found: Answer) -> Report:
    """Put the report together: of a design all that its model foresees, of a pre-test what is known of it."""
    figures = found.figures
    summary: list[Part] = [_keys(figures), *usability_parts(figures["usability"])]
    if found.design is None:
        summary.append("There is no model yet: this is a bounded pre-test, after which the design can be made.")
        covered = _covered(figures["coverage"])
        return Report(heading, summary, [
            Section("Course of the test", [_played(found.profile)]),
            Section("Where the time is spent", covered),
        ])  # fmt: skip
    design, sections = found.design, []
    limits = None if found.asked is None else found.asked[1].limits
    if "separation" in figures:
        apart = " and ".join(words.millivolts(1e3 * each) for each in figures["separation"])
        summary.append(f"The voltages that the two models expect lie {apart} apart, seen from each of them.")
    hours = np.arange(len(design.current_A)) * design.dt_s / 3600.0
    sections.append(Section("Course of the test", _course(hours, limits, design)))
    covered = _covered(figures["coverage"])
    if found.asked is None:
        return Report(heading, summary, [*sections, Section("Where the time is spent", covered)])
    experiment, request = found.asked
    summary += _accuracy(request, design)
    sections += [*_ratio(experiment, request), *_load(request)]
    sections.append(Section("Where the time is spent", [*covered, _coverage(request, design)]))
    sections.append(_telling(experiment, request, design))
    return Report(heading, summary, sections)


def _keys(figures: Mapping[str, Any]) -> Keys:
    moved, net = figures["throughput_Ah"], figures["net_charge_Ah"]
    low, high = figures["predicted"]["soc"]
    keys = [
        Key("Duration", words.duration(figures["duration_s"]), f"{words.count(figures['n_samples'])} samples"),
        Key("Charge moved", words.quantity(moved, "Ah"), f"{words.quantity(net, 'Ah')} net"),
        Key("State of charge", words.between("soc", (low, high), "1"), "as foreseen"),
    ]
    if figures["predicted"]["voltage_V"] is not None:
        least, most = figures["predicted"]["voltage_with_band_V"]
        keys.append(Key("Voltage", words.between("voltage", (least, most), "V"), "as foreseen, with its band"))
    if figures["constraints_active_share"]:
        keys.append(Key("At a limit", words.percent(figures["constraints_active_share"]), "of the samples"))
    return Keys(keys)


def _covered(said: Mapping[str, Any]) -> list[Part]:
    """How much of what was asked for, in words."""
    text = f"{words.percent(said['share'])} of the asked window of state of charge and current is gone through: "
    parts = [words.between("soc", said["soc"], "1"), words.between("current", said["current_A"], "A")]
    if said.get("temperature_degC") is not None:
        parts.append(f"{words.between('temperature', said['temperature_degC'], 'degC')} by its own heat")
    reasons = [words.sentence(words.told(each)) for each in said["reasons"]]
    return [f"{text}{words.listed(parts)}.", *([Points(reasons)] if reasons else [])]


def _accuracy(request: DesignRequest, found: Design) -> list[Part]:
    if request.target_std is None:
        return []
    reached = "reached" if found.largest_std <= request.target_std else "not reached"
    return [
        f"Accuracy asked for: {words.number(request.target_std)} of each parameter's own size; "
        f"{words.number(found.largest_std)} after {len(found.blocks)} visits, {reached}. "
        f"{words.duration(3600.0 * found.saved_h)} of {words.duration(found.planned_s)} saved."
    ]


def _played(profile: Profile) -> Any:
    time_h = np.repeat(profile.time_s, 2)[1:-1] / 3600.0
    return curves("Current", [Line("", time_h, np.repeat(profile.current_A[:-1], 2), None, RUST)], TIME, _CURRENT)


def _course(hours: Values, limits: Any, found: Design) -> list[Part]:
    middle, half = 0.5 * (found.band_low_V + found.band_high_V), 0.5 * (found.band_high_V - found.band_low_V)
    voltage = [Line("as the model expects, with its band", hours, middle, half, BLUE)]
    soc = [Line("state of charge", hours, 100.0 * found.soc, None, GREEN)]
    if limits is not None:
        if limits.voltage_V is not None:
            voltage += [level(f"limit {edge:g} V", hours, edge) for edge in limits.voltage_V]
        soc += [level(f"limit {100.0 * edge:g} %", hours, 100.0 * edge) for edge in limits.soc]
    return [
        curves("Current", [Line("", hours, found.current_A, None, RUST)], TIME, _CURRENT),
        curves("Voltage; the band is meant for all samples at once", voltage, TIME, Axis("voltage", "V")),
        curves("State of charge", soc, TIME, _SOC),
    ]


def _ratio(experiment: Experiment, request: DesignRequest) -> list[Section]:
    """How much of the largest current the voltage leaves, of a sequence."""
    # Lazy: numba and scipy take 1.0 s.
    from models.design.optimise.block_design import OPTIMAL, plan_of

    if request.signal != OPTIMAL or not request.soc_levels:
        return []
    ratio = plan_of(experiment, request).ratio
    shares = (("discharge", ratio.discharge, RUST), ("charge", ratio.charge, BLUE))
    lines = [Line(name, 100.0 * np.asarray(ratio.soc), 100.0 * share, None, colour) for name, share, colour in shares]
    caption = "Share of the largest current that the expected voltage, with its band, leaves"
    return [Section("What the voltage leaves", [curves(caption, lines, _SOC, Axis("share", "%"))])]


def _load(request: DesignRequest) -> list[Section]:
    """Load cycle and histogram that bound the blocks, where there is one."""
    if request.cycle_A is None:
        return []
    # Lazy: numba and scipy take 1.0 s.
    from models.design.sequence.load_cycle import load_histogram

    histogram = load_histogram(request.cycle_A)
    rows = [
        (words.between("current", (float(low), float(high)), "A"), words.percent(float(share), 1))
        for low, high, share in zip(histogram.edges_A[:-1], histogram.edges_A[1:], histogram.share, strict=True)
    ]
    samples = np.arange(len(request.cycle_A), dtype=np.float64)
    return [
        Section(
            "Load cycle",
            [
                curves("Current of the load cycle", [Line("", samples, request.cycle_A, None, GREY)], Axis("sample"),
                       _CURRENT),
                "Its histogram: each interval bounds the current of the blocks for its share of the time.",
                Table(("Current", "Share of the time"), rows, frozenset({0, 1})),
            ],
        )
    ]  # fmt: skip


def _telling(experiment: Experiment, request: DesignRequest, found: Design) -> Section:
    # Lazy: numba and scipy take 1.0 s.
    from models.design.overview import family_std, mean_std, mean_std_over_time

    time_s, std = mean_std_over_time(experiment, found.current_A)
    own = mean_std(found.information)
    rows = [(f"This test: {words.plain(request.signal)}", words.number(own), "1")]
    # The others get the time that this test takes, which may have ended before its plan did.
    same_time = replace(request, duration_s=found.duration_s, target_std=None)
    for name, other in family_std(experiment, same_time).items():
        if name != request.signal:
            ratio = words.number(None if other is None else other / own)
            rows.append((words.plain(name), "not possible" if other is None else words.number(other), ratio))
    drawn = curves(
        "How uncertain the parameters still are: geometric mean of their standard deviations, as power of ten",
        [Line("", time_s / 3600.0, np.log10(std), None, BLUE)], TIME, Axis("power of ten"),
    )  # fmt: skip
    heads = ("Signal, in the same time and limits", "Mean standard deviation", "Over that of this test")
    return Section("What it tells", [drawn, Table(heads, rows, frozenset({1, 2}))])


def _coverage(request: DesignRequest, found: Design) -> Any:
    """Heat map of SoC and current."""
    # Lazy: numba and scipy take 1.0 s.
    from models.design.overview import coverage

    share, soc, current = coverage(found.soc, found.current_A, request.limits.soc, request.limits.current_A)
    caption = "Share of the time by state of charge and current; darker is more"
    return heat_map(caption, share, (list(soc), list(current)), ("state of charge", "current / A"))
