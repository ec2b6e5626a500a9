"""Every drawing of every report, as SVG: curves with bands, bars, cut bars, maps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from html import escape
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from bench_service.reports.document import Figure, Legend
from bench_service.store.decimation import kept_rows

BLUE, RUST, GREEN, GREY, VIOLET = "#0b62a8", "#c2410c", "#2f7d4f", "#7a7a7a", "#7b4fa3"
# From cold to warm; also told apart by the legend's order.
WARMTH = (BLUE, "#3f8fbf", GREY, "#d98a4a", RUST)
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 900, 270, 66, 14, 22, 40
_TICKS, _POINTS = 5, 1600
_BAR, _BAR_GAP, _LABEL, _VALUE = 22, 8, 290, 100
_CELL, _ROW, _MAP_FOOT = 36, 20, 40

Values = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Line:
    """One curve with its half band, down to `least` at most, both over the same x; NaN where nothing is to be drawn."""

    label: str
    x: Values
    y: Values
    half_band: Values | None = None
    colour: str = BLUE
    dashed: bool = False
    dots: bool = False
    least: float = -np.inf

    @property
    def low(self) -> Values | None:
        """Lower edge of the band."""
        return None if self.half_band is None else np.maximum(self.y - self.half_band, self.least)

    @property
    def high(self) -> Values | None:
        """Upper edge of the band."""
        return None if self.half_band is None else self.y + self.half_band


@dataclass(frozen=True)
class Axis:
    """Name and unit of an axis; `ticks` are places with their texts where round values say nothing."""

    name: str
    unit: str = ""
    ticks: Sequence[tuple[float, str]] | None = None

    @property
    def label(self) -> str:
        """What stands beside it."""
        return f"{self.name} / {self.unit}" if self.unit else self.name


def thinned(line: Line) -> Line:
    """Draw no more points than a page can show; no peak is lost."""
    if len(line.y) <= _POINTS:
        return line
    shapes = {"y": line.y} if line.low is None or line.high is None else {"low": line.low, "high": line.high}
    rows = kept_rows(shapes, len(line.y), _POINTS, tuple(shapes))
    band = None if line.half_band is None else line.half_band[rows]
    return replace(line, x=line.x[rows], y=line.y[rows], half_band=band)


def level(label: str, x: Values, value: float) -> Line:
    """Draw a limit across the whole chart."""
    return Line(label, x[[0, -1]], np.full(2, value), None, GREY, dashed=True)


def curves(caption: str, lines: Sequence[Line], x_axis: Axis, y_axis: Axis) -> Figure | str:
    """Draw curves with their bands; a sentence where there is nothing to draw."""
    drawn = [line for line in map(thinned, lines) if np.isfinite(line.y).any()]
    if not drawn:
        return f"{caption}: there is nothing to draw."
    low, high = _range(drawn)
    known = [line.x[np.isfinite(line.y)] for line in drawn]
    x0, x1 = min(float(x.min()) for x in known), max(float(x.max()) for x in known)
    if x_axis.ticks is not None and x_axis.ticks:
        x0, x1 = min(x0, x_axis.ticks[0][0]), max(x1, x_axis.ticks[-1][0])
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

    def px(x: Values) -> Values:
        return _LEFT + (x - x0) / ((x1 - x0) or 1.0) * (right - _LEFT)

    def py(y: Values) -> Values:
        return _TOP + (high - np.clip(y, low, high)) / (high - low) * (bottom - _TOP)

    body = [_axes((x0, x1), (low, high), (x_axis, y_axis), px, py)]
    for line in drawn:
        body += _drawn(line, px, py)
    legend = [Legend(line.label, line.colour, line.dashed) for line in drawn if line.label]
    return Figure(caption, _svg(_WIDTH, _HEIGHT, caption, body), legend if len(legend) > 1 else ())


def _drawn(line: Line, px: Callable[[Values], Values], py: Callable[[Values], Values]) -> list[str]:
    """One curve; where values are missing it is cut, for nothing was measured there."""
    body, known = [], np.isfinite(line.y)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    dash = ' stroke-dasharray="6 4"' if line.dashed else ""
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        x, y = px(line.x[start:stop]), line.y[start:stop]
        if line.low is not None and line.high is not None:
            low, high = (np.where(np.isfinite(edge), edge, line.y)[start:stop] for edge in (line.low, line.high))
            outline = _points(np.concatenate([x, x[::-1]]), np.concatenate([py(high), py(low)[::-1]]))
            edge = f'stroke="{line.colour}" stroke-opacity="0.45" stroke-width="0.8"'
            body.append(f'<polygon points="{outline}" fill="{line.colour}" fill-opacity="0.15" {edge}/>')
        points = _points(x, py(y))
        pen = f'stroke="{line.colour}" stroke-width="1.3" stroke-linejoin="round"{dash}'
        body.append(f'<polyline fill="none" {pen} points="{points}"/>')
        if line.dots or stop - start == 1:
            body += [
                f'<circle cx="{a:.1f}" cy="{b:.1f}" r="3" fill="{line.colour}"/>' for a, b in zip(x, py(y), strict=True)
            ]
    return body


def _points(x: Values, y: Values) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def _range(lines: Sequence[Line]) -> tuple[float, float]:
    """Range of the curves, and of their bands as far as these are no wider than three times that."""
    values = np.concatenate([line.y for line in lines])
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    # Something that stands still is drawn as a level line in the middle, not as its last digit.
    span = max(high - low, 1e-3 * max(abs(high), abs(low)), 1e-9)
    edges = [edge for line in lines for edge in (line.low, line.high) if edge is not None]
    ends = np.concatenate(edges or [values])
    least, most = min(low, float(np.nanmin(ends))), max(high, float(np.nanmax(ends)))
    return max(least, low - span) - 0.04 * span, min(most, high + span) + 0.04 * span


def _axes(
    ends_x: tuple[float, float],
    ends_y: tuple[float, float],
    axes: tuple[Axis, Axis],
    px: Callable[[Values], Values],
    py: Callable[[Values], Values],
) -> str:
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    parts = []
    values = round_values(*ends_y)
    for value, text in zip(values, _texts(values), strict=True):
        y = float(py(np.array([value]))[0])
        parts.append(f'<line x1="{_LEFT}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}" stroke="#e3e7eb"/>')
        parts.append(f'<text x="{_LEFT - 8}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    marks = axes[0].ticks
    if marks is None:
        values = round_values(*ends_x)
        marks = list(zip(values, _texts(values), strict=True))
    for value, text in marks:
        x = float(px(np.array([value]))[0])
        parts.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{bottom}" y2="{bottom + 4}" stroke="#8c959f"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 17}" text-anchor="middle">{escape(text)}</text>')
    parts.append(f'<path d="M{_LEFT} {_TOP}V{bottom}H{right}" fill="none" stroke="#8c959f"/>')
    middle = 0.5 * (_LEFT + right)
    parts.append(f'<text x="{middle}" y="{_HEIGHT - 5}" text-anchor="middle">{escape(axes[0].label)}</text>')
    parts.append(f'<text x="4" y="{_TOP - 8}">{escape(axes[1].label)}</text>')
    return "".join(parts)


def round_values(low: float, high: float) -> list[float]:
    """Round numbers between two ends, about as many as an axis has room for."""
    if high <= low:
        return [low]
    rough = (high - low) / _TICKS
    decade = 10.0 ** np.floor(np.log10(rough))
    step = decade * next(m for m in (1.0, 2.0, 5.0, 10.0) if m * decade >= rough * (1.0 - 1e-9))
    # A multiple of the step that ought to be 0 is a rounding error otherwise.
    return [float(round(k) * step) for k in np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)]


def _texts(values: Sequence[float]) -> list[str]:
    """Numbers of an axis with as many digits as tell them apart, all with the same."""
    steps = [b - a for a, b in pairwise(values)] or [abs(values[0]) or 1.0]
    digits = max(0, -int(np.floor(np.log10(min(steps)) + 1e-9)))
    return [f"{value:.{digits}f}".replace("-", "−") for value in values]


@dataclass(frozen=True)
class Bar:
    """One bar: what it stands for, its length, that as text."""

    label: str
    value: float
    text: str
    colour: str = BLUE


def bars(caption: str, shown: Sequence[Bar], mark: float | None = None) -> Figure:
    """Draw bars below each other; `mark` is a dashed line across them."""
    scale = (_WIDTH - _LABEL - _VALUE) / max([*(bar.value for bar in shown), mark or 0.0, 1e-9])
    rows, height = [], len(shown) * (_BAR + _BAR_GAP)
    for number, bar in enumerate(shown):
        y, length = number * (_BAR + _BAR_GAP), bar.value * scale
        rows.append(
            f'<text x="0" y="{y + 16}">{escape(bar.label)}</text>'
            f'<rect x="{_LABEL}" y="{y}" width="{length:.1f}" height="{_BAR}" fill="{bar.colour}"/>'
            f'<text x="{_LABEL + length + 6:.1f}" y="{y + 16}">{escape(bar.text)}</text>'
        )
    if mark is not None:
        x = _LABEL + mark * scale
        rows.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{height}" stroke="#1b1f24" stroke-dasharray="4 3"/>')
    return Figure(caption, _svg(_WIDTH, height, caption, rows))


@dataclass(frozen=True)
class Piece:
    """A piece of a cut bar: what it stands for, from its top to its foot."""

    label: str
    top: float
    foot: float


def cut_bars(caption: str, columns: Sequence[Sequence[Piece]], axes: tuple[Axis, Axis], grey: str = "left") -> Figure:
    """Draw a bar for each column, which are counted, cut into pieces of one colour each; one name's are grey."""
    most = max(piece.top for pieces in columns for piece in pieces)
    names = list(dict.fromkeys(piece.label for pieces in columns for piece in pieces))
    palette = (BLUE, RUST, GREEN, VIOLET, "#b8860b")
    others = [name for name in names if name != grey]
    colours = {name: palette[k % len(palette)] for k, name in enumerate(others)} | {grey: "#b3bac2"}
    n = len(columns)

    def px(x: Values) -> Values:
        return _LEFT + (x + 0.5) / n * (_WIDTH - _RIGHT - _LEFT)

    def py(y: Values) -> Values:
        return _TOP + (1.0 - y / most) * (_HEIGHT - _BOTTOM - _TOP)

    axis = replace(axes[0], ticks=axes[0].ticks or [(float(k), str(k + 1)) for k in every(n)])
    body, width = [_axes((0.0, n - 1.0), (0.0, most), (axis, axes[1]), px, py)], 0.7 / n * (_WIDTH - _RIGHT - _LEFT)
    for k, pieces in enumerate(columns):
        x = float(px(np.array([float(k)]))[0]) - 0.5 * width
        for piece in pieces:
            y, foot = (float(py(np.array([value]))[0]) for value in (piece.top, piece.foot))
            body.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{max(foot - y, 0.0):.1f}" '
                f'fill="{colours[piece.label]}"/>'
            )
    ordered = [*others, *([grey] if grey in names else [])]
    return Figure(caption, _svg(_WIDTH, _HEIGHT, caption, body),
                  [Legend(name, colours[name], filled=True) for name in ordered])  # fmt: skip


def every(count: int, most: int = 12) -> range:
    """Which of many columns have their name below them."""
    return range(0, count, max(1, -(-count // most)))


def heat_map(
    caption: str, share: Values, edges: tuple[Sequence[float], Sequence[float]], names: tuple[str, str]
) -> Figure:
    """Draw a map of shares 0..1: darker is more.

    Parameters
    ----------
    share : (columns, rows)
    edges : of columns and rows
    names : of both axes
    """
    left, top = 66, 34
    most, body = max(float(share.max()), 1e-12), []
    for i, row in enumerate(share):
        for j, part in enumerate(row):
            x, y = left + _CELL * i, top + _ROW * (len(row) - 1 - j)
            # By its root: a rest at one level must not hide everything else.
            body.append(
                f'<rect x="{x}" y="{y}" width="{_CELL}" height="{_ROW}" fill="{BLUE}" stroke="#e3e7eb" '
                f'fill-opacity="{np.sqrt(part / most):.3f}"/>'
            )
    bottom, (columns, rows) = top + _ROW * share.shape[1], edges
    for i in range(0, len(columns), 4):
        body.append(f'<text x="{left + _CELL * i}" y="{bottom + 17}" text-anchor="middle">{columns[i]:.2f}</text>')
    for j in range(0, len(rows), 3):
        text = f"{rows[j]:.2f}".replace("-", "−")
        body.append(f'<text x="{left - 8}" y="{bottom - _ROW * j + 4}" text-anchor="end">{text}</text>')
    width = left + _CELL * share.shape[0] + 20
    body.append(f'<text x="{0.5 * width}" y="{bottom + 35}" text-anchor="middle">{escape(names[0])}</text>')
    body.append(f'<text x="4" y="{top - 14}">{escape(names[1])}</text>')
    return Figure(caption, _svg(width, bottom + _MAP_FOOT, caption, body))


def _svg(width: float, height: float, title: str, body: Sequence[str]) -> Markup:
    label = escape(title)
    return Markup(f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{label}">{"".join(body)}</svg>')  # noqa: S704
