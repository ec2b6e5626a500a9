"""What every report of a model against measurements shares: where it fails in words, and both voltages as curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bench_service.reports import words
from bench_service.reports.document import Part, Points, Section, Table
from bench_service.reports.drawing import BLUE, RUST, Axis, Line, curves, level

if TYPE_CHECKING:
    from models.comparison.simulated_runs import RunComparison
    from models.uncertainty.bands import PredictionBand

TIME = Axis("time", "h")
_WHERE_ROWS = 12


def where_parts(regions: Sequence[Mapping[str, Any]], where: Sequence[Mapping[str, Any]]) -> list[Part]:
    """Regions that hold most error in least time, and the shares by one variable after the other."""
    parts: list[Part] = ["No region stands out: the error is spread evenly."]
    if regions:
        said = [f"{words.told(each['text'])}; {words.millivolts(each['rmse_mV'])} there" for each in regions]
        parts = [Points([words.sentence(text) for text in said])]
    if not where:
        return parts
    rows = [
        (
            words.variable(each["variable"]).capitalize(),
            words.between(each["variable"], (each["from"], each["to"]), each["unit"]),
            words.millivolts(each["rmse_mV"]),
            words.percent(each["share_of_squared_error"]),
            words.percent(each["share_of_time"]),
        )
        for each in where[:_WHERE_ROWS]
    ]
    heads = ("Over", "Range", "RMS error", "Share of the squared error", "Share of the time")
    return [
        *parts,
        "By one variable at a time, the most telling range first:",
        Table(heads, rows, frozenset({1, 2, 3, 4})),
    ]


def curve_section(compared: RunComparison, band: PredictionBand | None, called: str) -> Section:
    """One run: measured and modelled voltage, and the error with its band."""
    run = compared.run
    hours = run.time_s / 3600.0
    error = Line("measured − model", hours, 1e3 * compared.residual_V, None, RUST)
    lines = [error, level("", hours, 0.0)]
    about = ""
    if band is not None:
        half = 1e3 * (band.upper_V - band.voltage_V)
        lines[1] = Line("95 % band of the model", hours, np.zeros(len(hours)), half, BLUE, dashed=True)
        about = ", with the band in which the model expects 95 % of them"
    voltages = [
        Line("measured", hours, run.voltage_V, None, BLUE),
        Line("model, from current and temperature alone", hours, compared.simulated_V, None, RUST),
    ]
    return Section(
        called,
        [
            curves("Measured voltage and the model's", voltages, TIME, Axis("voltage", "V")),
            curves(f"Error, measured − model{about}", lines, TIME, Axis("error", "mV")),
        ],
    )
