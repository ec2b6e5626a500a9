"""Drawings of what is read out of a model: resistance over SoC and temperature, open-circuit voltage and its mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.readouts.tables import tables_of

if TYPE_CHECKING:
    from models.network.local_model_network import LocalModelNetwork
    from models.readouts.ocv import OcvTable
    from models.readouts.resistance import ResistanceTable

_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 900, 300, 70, 120, 12, 40
_BAND_95 = 1.96
_TICKS = 5
# From cold to warm; also told apart by the legend's order.
_COLOURS = ("#0b62a8", "#3f8fbf", "#7a7a7a", "#d98a4a", "#c2410c")

Values = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Line:
    """One curve with its half band, both over the same x; NaN where there is nothing to draw."""

    label: str
    x: Values
    y: Values
    half_band: Values | None
    colour: str


def readout_parts(network: LocalModelNetwork) -> list[str]:
    """HTML of the drawings, and of what a person should know before trusting them."""
    ocv, resistance = tables_of(network)
    parts = ["<h2>What the model says of the cell</h2>"]
    notes = (network.record.tables or {}).get("reservations", [])
    parts += ["<ul>" + "".join(f"<li>{escape(note)}</li>" for note in notes) + "</ul>"] if notes else []
    return [*parts, *_ocv_parts(ocv), *_resistance_parts(resistance)]


def _ocv_parts(ocv: OcvTable) -> list[str]:
    middle = len(ocv.temperature_degC) // 2
    degC = ocv.temperature_degC[middle]
    mean = ocv.mean_V[middle]
    std = None if ocv.std_V is None else _BAND_95 * ocv.std_V
    branches = ((1, "after charge", _COLOURS[4]), (0, "after discharge", _COLOURS[0]))
    levels = [Line("mean", ocv.soc, mean, None, _COLOURS[2])]
    apart = []
    for index, label, colour in branches:
        band = None if std is None else std[index, middle]
        levels.append(Line(label, ocv.soc, ocv.voltage_V[index, middle], band, colour))
        off = None if band is None else 1e3 * band
        apart.append(Line(label, ocv.soc, 1e3 * (ocv.voltage_V[index, middle] - mean), off, colour))
    return [
        f"<h3>Open-circuit voltage at {degC:.0f} °C</h3>",
        plot(levels, "SoC", "V"),
        "<p>Each branch against the mean of both, with its 95 % band</p>",
        plot(apart, "SoC", "mV"),
    ]


def _resistance_parts(table: ResistanceTable) -> list[str]:
    parts = []
    for sign, name in ((-1.0, "discharge"), (1.0, "charge")):
        own = np.flatnonzero(np.sign(table.current_A) == sign)
        if len(own) == 0:
            continue
        at = int(own[len(own) // 2])
        colours = [_COLOURS[round(k)] for k in np.linspace(0, 4, len(table.temperature_degC))]
        lines = [
            Line(
                f"{degC:.0f} °C",
                table.soc,
                1e3 * table.resistance_Ohm[at, m],
                None if table.std_Ohm is None else 1e3 * _BAND_95 * table.std_Ohm[at, m],
                colours[m],
            )
            for m, degC in enumerate(table.temperature_degC)
        ]
        parts += [
            f"<h3>Settled resistance, {name} with {abs(table.current_A[at]):.3g} A, with its 95 % band</h3>",
            plot(lines, "SoC", "mΩ"),
        ]
    return parts


def plot(lines: Sequence[Line], x_label: str, y_label: str) -> str:
    """Draw curves with their bands as SVG."""
    drawn = [line for line in lines if np.isfinite(line.y).any()]
    if not drawn:
        return "<p>the network does not settle anywhere here</p>"
    ends = [line.y + sign * (0.0 if line.half_band is None else line.half_band) for line in drawn for sign in (-1, 1)]
    low, high = _range(np.concatenate([line.y for line in drawn]), np.concatenate(ends))
    x0, x1 = float(drawn[0].x[0]), float(drawn[0].x[-1])
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

    def points(x: Values, y: Values) -> str:
        px = _LEFT + (x - x0) / ((x1 - x0) or 1.0) * (right - _LEFT)
        py = _TOP + (high - np.clip(y, low, high)) / (high - low) * (bottom - _TOP)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))

    body = [_axes(x0, x1, low, high, x_label, y_label)]
    for number, line in enumerate(drawn):
        known = np.isfinite(line.y)
        x, y = line.x[known], line.y[known]
        if line.half_band is not None:
            half = line.half_band[known]
            outline = points(np.concatenate([x, x[::-1]]), np.concatenate([y + half, (y - half)[::-1]]))
            body.append(f'<polygon points="{outline}" fill="{line.colour}" fill-opacity="0.15"/>')
        body.append(f'<polyline fill="none" stroke="{line.colour}" stroke-width="1.5" points="{points(x, y)}"/>')
        text_y = _TOP + 14 + 16 * number
        body.append(
            f'<line x1="{right + 8}" x2="{right + 24}" y1="{text_y - 4}" y2="{text_y - 4}" stroke="{line.colour}"/>'
        )
        body.append(f'<text x="{right + 28}" y="{text_y}">{escape(line.label)}</text>')
    return f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img">{"".join(body)}</svg>'


def _range(values: Values, with_bands: Values) -> tuple[float, float]:
    """Range of the curves, and of their bands as far as these are no wider than three times that."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    span = max(high - low, 1e-9 * max(abs(high), 1.0))
    return (
        max(float(np.nanmin(with_bands)), low - span) - 0.02 * span,
        min(float(np.nanmax(with_bands)), high + span) + 0.02 * span,
    )


def _axes(x0: float, x1: float, low: float, high: float, x_label: str, y_label: str) -> str:
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    parts = []
    for value in round_values(low, high):
        y = bottom - (value - low) / ((high - low) or 1.0) * (bottom - _TOP)
        parts.append(f'<line x1="{_LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" stroke="#ddd"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{value:.6g}</text>')
    for value in round_values(x0, x1):
        x = _LEFT + (value - x0) / ((x1 - x0) or 1.0) * (right - _LEFT)
        parts.append(f'<text x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{value:.6g}</text>')
    parts.append(f'<text x="{0.5 * (_LEFT + right)}" y="{_HEIGHT - 6}" text-anchor="middle">{escape(x_label)}</text>')
    parts.append(f'<text x="4" y="{_TOP + 6}">{escape(y_label)}</text>')
    return "".join(parts)


def round_values(low: float, high: float) -> list[float]:
    """Round numbers between two ends, about as many as an axis has room for."""
    if high <= low:
        return [low]
    rough = (high - low) / _TICKS
    decade = 10.0 ** np.floor(np.log10(rough))
    step = decade * next(m for m in (1.0, 2.0, 5.0, 10.0) if m * decade >= rough)
    # A multiple of the step that ought to be 0 is a rounding error otherwise.
    return [float(round(k) * step) for k in np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)]
