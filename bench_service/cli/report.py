"""A comparison as one self-contained page: tables, and curves drawn as SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from bench_service.cli.incremental_page import incremental_parts
from bench_service.cli.readout_page import readout_parts
from bench_service.cli.tables import start_line
from bench_service.store.decimation import kept_rows
from models.comparison.placed_runs import place_runs
from models.comparison.reach import bands
from models.comparison.simulated_runs import RunComparison
from models.module.network import ModuleNetwork, cell_network
from models.network.local_model_network import LocalModelNetwork

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.uncertainty.bands import PredictionBand

_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 900, 220, 60, 24
_COLUMNS = 800
_METRICS = ("rmse_mV", "mae_mV", "p95_mV", "max_mV", "bias_mV", "nrmse", "n_samples")
_WHERE = ("variable", "from", "to", "unit", "rmse_mV", "share_of_squared_error", "share_of_time")
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 960px; padding: 0 1rem; color: #1b1f24 }
table { border-collapse: collapse; margin: .5rem 0 1.5rem } td, th { padding: .2rem .8rem; text-align: right }
th { border-bottom: 1px solid #888 } td:first-child, th:first-child { text-align: left }
svg { width: 100%; height: auto } text { font-size: 12px; fill: #555 } .m { color: #0b62a8 } .s { color: #c2410c }
.b { color: #999 }
"""

_CSS = {"measured": "m", "simulated": "s", "band": "b"}

Curve = tuple[str, NDArray[np.floating[Any]]]


def comparison_page(
    model: str,
    network: LocalModelNetwork | ModuleNetwork,
    runs: Sequence[TimeSeries],
    initial_soc: Sequence[float],
    result: Mapping[str, Any],
) -> bytes:
    """Return the page as UTF-8.

    Parameters
    ----------
    model : the model's name
    network, runs, initial_soc : what was compared
    result : the answer of `models.comparison.figures.compare`
    """
    rows = [*result["runs"], {"run": "overall", **result["overall"]}]
    if result["outside"] is not None and result["inside_training"] is not None:
        rows.append({"run": "inside the trained domain", **result["inside_training"]})
        rows.append({"run": "outside of it", **result["outside"]})
    parts = [
        f"<h1>{escape(model)} against {len(runs)} measured run(s)</h1>",
        f"<p>Free run: the model sees current and temperature only. {floor(result['noise_floor_mV'])}"
        f" {100 * result['outside_training']:.1f} % of the samples lie outside the trained domain{_by(result)}."
        f"{_band(result['band'])}{_temperature(result['temperature'])}</p>",
        f"<p>{escape(start_line(result))}.</p>",
        _promised(network) if isinstance(network, LocalModelNetwork) else "",
        f"<p>Over time {escape(result['whiteness']['text'])}.</p>" if result["whiteness"] is not None else "",
        "".join(f"<p>The runs were corrected as the model says: {_correction(c)}.</p>" for c in result["corrections"]),
        table(("run", *_METRICS), rows),
        "<h2>Where it fails</h2>",
        where_in_words(result["regions"]),
        table(_WHERE, result["where"]),
    ]
    compared = place_runs(network, list(runs), list(initial_soc))
    found = bands(network, [each.run for each in compared], [each.start for each in compared])
    for number, each in enumerate(compared):
        parts += curves(each, None if found is None else found[number])
        parts += incremental_parts(each, network.cell.capacity_Ah)
    parts += readout_parts(cell_network(network))
    return page(f"{model}: comparison", parts)


def _promised(network: LocalModelNetwork) -> str:
    """What the model did on its own runs, and what it was expected to do on others."""
    expected_mV = (network.record.choices or {}).get("expected_rmse_mV")
    if network.record.train is None or expected_mV is None:
        return ""
    return (
        f"<p>RMSE of the model on its training runs {network.record.train['rmse_mV']:.2f} mV; "
        f"expected on runs it did not see {expected_mV:.2f} mV.</p>"
    )


def page(title: str, parts: Sequence[str]) -> bytes:
    """One self-contained page as UTF-8."""
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{STYLE}</style>'
    return f'<!doctype html>\n<html lang="en">{head}<body>{"".join(parts)}</body></html>\n'.encode()


def _correction(correction: Mapping[str, Any]) -> str:
    sizes = ", ".join(f"{name} {value:.4g}" for name, value in correction["values"].items())
    return escape(f"{correction['effect']} ({sizes})")


def where_in_words(regions: Sequence[Mapping[str, Any]]) -> str:
    """List of the regions that hold most error in least time."""
    if not regions:
        return "<p>No region stands out: the error is spread evenly.</p>"
    rows = "".join(f"<li>{escape(each['text'])}, {each['rmse_mV']:.1f} mV there</li>" for each in regions)
    return f"<ol>{rows}</ol>"


def floor(noise_floor_mV: float | None) -> str:
    """Say what the noise floor is, where it is known."""
    return "" if noise_floor_mV is None else f"The measurement's noise floor is {noise_floor_mV:.2f} mV."


def _by(result: Mapping[str, Any]) -> str:
    found = [f"{escape(name)} {100 * share:.1f} %" for name, share in result["outside_by"].items() if share > 0.0]
    return f" (by {', '.join(found)})" if found else ""


def _band(band: Mapping[str, Any] | None) -> str:
    if band is None or band["coverage_95"] is None:
        return ""
    return f" {100 * band['coverage_95']:.1f} % of the measured voltages lie within the model's 95 % band."


def _temperature(temperature: Mapping[str, Any] | None) -> str:
    if temperature is None or temperature["rmse_K"] is None:
        return ""
    return f" Temperature from current and ambient alone: RMSE {temperature['rmse_K']:.2f} K."


def table(keys: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> str:
    """HTML table of rows, one column for each key."""
    head = "".join(f"<th>{escape(key)}</th>" for key in keys)
    body = "".join("<tr>" + "".join(f"<td>{_cell(row[key])}</td>" for key in keys) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _cell(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else escape(str(value))


def curves(compared: RunComparison, band: PredictionBand | None) -> list[str]:
    """HTML of one run: measured and simulated voltage, and the residual with its band."""
    run, error = compared.run, [("simulated", 1e3 * compared.residual_V)]
    if band is not None:
        half = 1e3 * (band.upper_V - band.voltage_V)
        error = [("band", half), ("band", -half), *error]
    voltages = [("measured", run.voltage_V), ("simulated", compared.simulated_V)]
    return [
        f"<h2>{escape(run.name)}</h2>",
        '<p><span class="m">measured</span>, <span class="s">simulated</span> voltage in V over time in h</p>',
        _plot(run.time_s / 3600.0, voltages),
        f"<p>simulated minus measured in mV{', and the 95 % band (grey)' if band is not None else ''}</p>",
        _plot(run.time_s / 3600.0, error),
    ]


def _plot(x: NDArray[np.floating[Any]], curves: Sequence[Curve]) -> str:
    known = np.concatenate([y[np.isfinite(y)] for _, y in curves])
    if len(known) == 0:
        return "<p>nothing was measured</p>"
    low, high = float(known.min()), float(known.max())
    span_x, span_y = float(x[-1] - x[0]) or 1.0, (high - low) or 1.0
    lines = []
    for name, y in curves:
        chosen = _extremes(y)
        px = _LEFT + (x[chosen] - x[0]) / span_x * (_WIDTH - _LEFT)
        py = (_HEIGHT - _BOTTOM) * (high - y[chosen]) / span_y + 4
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))
        css = _CSS[name]
        lines.append(f'<polyline class="{css}" fill="none" stroke="currentColor" points="{points}"/>')
    labels = (
        f'<text x="0" y="16">{high:.4g}</text><text x="0" y="{_HEIGHT - _BOTTOM}">{low:.4g}</text>'
        f'<text x="{_LEFT}" y="{_HEIGHT - 4}">{x[0]:.3g}</text>'
        f'<text x="{_WIDTH}" y="{_HEIGHT - 4}" text-anchor="end">{x[-1]:.3g}</text>'
    )
    return f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img">{"".join(lines)}{labels}</svg>'


def _extremes(y: NDArray[np.floating[Any]]) -> NDArray[np.intp]:
    """Rows that the picture is drawn of, as the page of a run thins its own: no peak is lost."""
    rows = kept_rows({"y": y}, len(y), 2 * _COLUMNS + 2, ("y",))
    return rows[np.isfinite(y[rows])]
