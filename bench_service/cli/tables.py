"""Tables that several commands print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

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
    """One line of METRICS for each name."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD)
    table.add_column("run", overflow="fold")
    for _, label in _METRICS:
        table.add_column(label, justify="right")
    table.add_column("samples", justify="right")
    for name, metrics in rows:
        cells = [f"{metrics[key]:.1f}" for key, _ in _METRICS]
        table.add_row(name, *cells, f"{metrics['n_samples']}")
    return table


def where_table(title: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """Where a model fails: one line for each range of a variable."""
    from rich import box
    from rich.table import Table

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
