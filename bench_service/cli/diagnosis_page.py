"""A diagnosis as one self-contained page: verdict, evidence for each finding, and where the model is off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from bench_service.cli.report import curves, floor, page, table, where_in_words
from models.comparison.figures import compare
from models.comparison.simulated_runs import simulate_runs

if TYPE_CHECKING:
    from models.data.timeseries import TimeSeries
    from models.network.local_model_network import LocalModelNetwork

VERDICTS = {
    "missing": "an effect was found",
    "nothing_missing": "nothing is missing: the error is the model's own",
    "ambiguous": "these data cannot tell the effects below apart",
    "unknown_effect": "something is there that no known effect explains",
}
_WIDTH, _BAR, _LABEL = 900, 22, 240
_WHERE_ROWS = 12
# An error that is larger than so many times the noise is more than noise to anybody.
_FAR_ABOVE_NOISE = 2.0


def diagnosis_page(
    model: str,
    network: LocalModelNetwork,
    runs: Sequence[TimeSeries],
    initial_soc: Sequence[float],
    result: Mapping[str, Any],
) -> bytes:
    """Return the page as UTF-8.

    Parameters
    ----------
    model : the model's name
    network, runs, initial_soc : what was diagnosed
    result : the `diagnose` object of the public contract
    """
    compared = compare(network, list(runs), list(initial_soc))
    parts = [
        f"<h1>{escape(model)}: {escape(VERDICTS[result['verdict']])}</h1>",
        f"<p>{len(runs)} measured run(s), mode {escape(result['mode'])}. {floor(result['noise_floor_mV'])}</p>",
        error_bars(result),
    ]
    for finding in result["findings"]:
        parts += _finding(finding)
    parts += [f"<p>{escape(text)}</p>" for text in _rest(result)]
    where = compared["where"][:_WHERE_ROWS]
    parts += ["<h2>Where the model is off</h2>", where_in_words(compared["regions"])]
    parts.append(table(tuple(where[0]), where) if where else "")
    for each in simulate_runs(network, list(runs), list(initial_soc)):
        parts += curves(each, None)
    return page(f"{model}: diagnosis", parts)


def left_over(result: Mapping[str, Any]) -> str:
    """What nothing in the answer explains, in words: "nothing is missing" does not mean that the model is good."""
    left_mV, noise_mV = result["unexplained_mV"], result["noise_floor_mV"]
    if left_mV is None:
        return ""
    words = f"Unexplained: {left_mV:.2f} mV"
    if noise_mV is None:
        return f"{words}."
    words += f", noise floor {noise_mV:.2f} mV."
    if result["verdict"] != "nothing_missing" or left_mV <= _FAR_ABOVE_NOISE * noise_mV:
        return words
    advice = {
        "change": "A change that shows less cannot be seen with it.",
        "structure": "Another structure or more training data come before any effect.",
    }
    share = 1.0 - (noise_mV / left_mV) ** 2
    own = f"{100 * share:.0f} % of its square is more than noise: the model itself is off by that much."
    return f"{words} {own} {advice[result['mode']]}"


def error_bars(result: Mapping[str, Any]) -> str:
    """SVG of the error as it is and as each finding would leave it, with the noise floor as a line."""
    findings = [f for f in result["findings"] if f["error_after_mV"] is not None]
    if not findings:
        return ""
    bars = [("as it is", findings[0]["error_before_mV"], "#c2410c")]
    bars += [(f"with {finding['effect']}", finding["error_after_mV"], "#0b62a8") for finding in findings]
    scale = (_WIDTH - _LABEL - 90) / max(max(value for _, value, _ in bars), 1e-9)
    rows = []
    for number, (label, value, colour) in enumerate(bars):
        y = number * (_BAR + 8)
        rows.append(
            f'<text x="0" y="{y + 16}">{escape(label)}</text>'
            f'<rect x="{_LABEL}" y="{y}" width="{value * scale:.1f}" height="{_BAR}" fill="{colour}"/>'
            f'<text x="{_LABEL + value * scale + 6:.1f}" y="{y + 16}">{value:.2f} mV</text>'
        )
    height = len(bars) * (_BAR + 8)
    noise_mV = result["noise_floor_mV"]
    if noise_mV is not None:
        x = _LABEL + noise_mV * scale
        rows.append(f'<line x1="{x:.1f}" x2="{x:.1f}" y1="0" y2="{height}" stroke="#555" stroke-dasharray="4 3"/>')
    title = "Free-run error of the diagnosed runs; the dashed line is the noise floor"
    svg = f'<svg viewBox="0 0 {_WIDTH} {height}" role="img" aria-label="{title}">{"".join(rows)}</svg>'
    return f"<h2>{title}</h2>{svg}"


def _finding(finding: Mapping[str, Any]) -> list[str]:
    rows = [
        {"parameter": name, "value": each["value"], "std": each["std"], "unit": each["unit"]}
        for name, each in finding["parameters"].items()
    ]
    rivals = ", ".join(finding["confounded_with"])
    return [
        f"<h2>{finding['rank']}. {escape(finding['effect'])}, confidence {100 * finding['confidence']:.0f} %</h2>",
        f"<p>{escape(finding['explanation'])}</p>",
        table(("parameter", "value", "std", "unit"), rows) if rows else "",
        f"<p>These data cannot tell it from: {escape(rivals)}.</p>" if rivals else "",
    ]


def _rest(result: Mapping[str, Any]) -> list[str]:
    """What stays open: what the remainder depends on, what to measure next, remarks."""
    text = [f"The error depends on {d['variable']}: {100 * d['strength']:.0f} % of it." for d in result["depends_on"]]
    text.append(left_over(result))
    if result["next_experiment"] is not None:
        rivals = " from ".join(str(rival) for rival in result["next_experiment"]["rivals"])
        text.append(f"Next experiment: a profile that tells {rivals}.")
    return [*text, *result.get("remarks", [])]
