"""Tables that several commands print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

if TYPE_CHECKING:
    from rich.table import Table

_METRICS = (
    ("rmse_mV", "RMSE mV"),
    ("mae_mV", "MAE mV"),
    ("p95_mV", "95 % mV"),
    ("max_mV", "max mV"),
    ("bias_mV", "bias mV"),
)
_UNITS = {"1": "", "sign": "", "degC": " °C"}


def metrics_table(title: str, rows: Sequence[tuple[str, Mapping[str, Any]]]) -> Table:
    """One line of METRICS, or as many of them as are known, for each name."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("run", overflow="fold")
    for _, label in _METRICS:
        table.add_column(label, justify="right")
    table.add_column("samples", justify="right")
    for name, metrics in rows:
        cells = [f"{metrics[key]:.1f}" if key in metrics else "" for key, _ in _METRICS]
        table.add_row(name, *cells, f"{metrics.get('n_samples', '')}")
    return table


def usability_lines(usability: Mapping[str, Any] | None) -> list[str]:
    """How far a model can be used and why, a line each; nothing for an older model that does not say."""
    if usability is None:
        return []
    return [f"usability of the model: {usability['verdict']}", *(f"  - {text}" for text in usability["reasons"])]


def rivals_line(answer: Mapping[str, Any]) -> list[str]:
    """Which kind of network was taken of several, with the error of each on runs that it did not see."""
    if not answer["compared"]:
        return []
    errors = ", ".join(f"{each['structure']} {each['held_out_rmse_mV']:.1f} mV" for each in answer["compared"])
    return [f"took the {answer['structure']} structure; expected on runs it did not see: {errors}"]


def terms_line(terms: Sequence[Mapping[str, Any]]) -> list[str]:
    """What a bounded network is made of: effects in words, with the largest voltage of a signal of each."""
    if not terms:
        return []
    largest_V: dict[str, float] = {}
    for term in terms:
        words = " with ".join(name.replace("_", " ") for name in reversed(term["effects"])) or "resistance"
        largest_V[words] = max(largest_V.get(words, 0.0), term["largest_V"])
    parts = ", ".join(f"{words} (up to {1e3 * value:.3g} mV)" for words, value in largest_V.items())
    return [f"made of: open-circuit voltage, {parts}"]


def readout_lines(readouts: Mapping[str, Any]) -> list[str]:
    """Resistance, open-circuit voltage and heat of a model, a line each, and what to know before trusting them."""
    lines = []
    for row in readouts["resistance"]:
        if row["resistance_Ohm"] is not None:
            lines.append(
                f"settled resistance at SoC {row['soc']:.2f}, {row['temperature_degC']:.0f} °C and "
                f"{row['current_A']:+.3g} A: {1e3 * row['resistance_Ohm']:.2f}{_plus_minus(row['std_Ohm'], 1e3)} mΩ"
            )
    low, high = readouts["ocv_V"]
    if low is not None:
        lines.append(
            f"open-circuit voltage {low:.3f} to {high:.3f} V{_plus_minus(readouts['ocv_std_V'], 1e3, ' mV')}, "
            f"after charge {1e3 * readouts['hysteresis_V']:.1f} mV above that after discharge"
        )
    if readouts["thermal"] is not None:
        heat = readouts["thermal"]
        lines.append(
            f"heat capacity {heat['heat_capacity_J_per_K']:.1f}{_plus_minus(heat['std'].get('heat_capacity_J_per_K'))} "
            f"J/K, heat transfer {heat['heat_transfer_W_per_K']:.4f}"
            f"{_plus_minus(heat['std'].get('heat_transfer_W_per_K'))} W/K"
        )
    return [*lines, *(f"note: {text}" for text in readouts["reservations"])]


def _plus_minus(std: float | None, factor: float = 1.0, unit: str = "") -> str:
    """Half width of a 95 % band, with two digits and no power of ten."""
    return "" if std is None else f" ± {float(f'{1.96 * factor * std:.2g}'):g}{unit}"


def where_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Where a model fails: one line for each range of a variable."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for label in ("variable", "from", "to", "RMSE mV", "of error", "of time"):
        table.add_column(label, justify="left" if label == "variable" else "right")
    for row in rows:
        unit = _UNITS.get(row["unit"], f" {row['unit']}")
        table.add_row(
            row["variable"],
            f"{row['from']:.3g}{unit}",
            f"{row['to']:.3g}{unit}",
            f"{row['rmse_mV']:.1f}",
            f"{100 * row['share_of_squared_error']:.0f} %",
            f"{100 * row['share_of_time']:.0f} %",
        )
    return table


def start_line(result: Mapping[str, Any]) -> str:
    """What a comparison's error would be from starts that all of the voltage says, and where those lie."""
    soc = ", ".join(f"{each['run']} {soc_text(each['initial_soc'])}" for each in result["runs"])
    text = f"from starts fitted to all of the voltage: {result['overall_fitted_start']['rmse_mV']:.2f} mV; SoC {soc}"
    placed = [each["run"] for each in result["runs"] if each["started"] != "as_stated"]
    return text + (f"; not at rest at first, by their first minute: {', '.join(placed)}" if placed else "")


def soc_text(found: Mapping[str, Any]) -> str:
    """A state of charge with its standard deviation, where it has one."""
    return f"{found['value']:.3f}" + ("" if found["std"] is None else f" ± {found['std']:.3f}")
