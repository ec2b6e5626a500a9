"""Tables of what the cycles of a stored run have moved."""

from __future__ import annotations

from contextlib import closing
from typing import TYPE_CHECKING, Any

from rich import box
from rich.table import Table

from bench_service.cli.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from bench_service.config import ServiceConfig

_COLUMNS = (
    ("cycle_count", "cycle", "{:d}"),
    ("duration_s", "h", "{:.3f}"),
    ("charged_Ah", "charged Ah", "{:.4f}"),
    ("discharged_Ah", "discharged Ah", "{:.4f}"),
    ("charged_Wh", "charged Wh", "{:.4f}"),
    ("discharged_Wh", "discharged Wh", "{:.4f}"),
    ("mean_charge_voltage_V", "charge V", "{:.4f}"),
    ("mean_discharge_voltage_V", "discharge V", "{:.4f}"),
    ("coulombic_efficiency", "coulombic", "{:.5f}"),
    ("energy_efficiency", "energy", "{:.5f}"),
)


def stored_cycles(config: ServiceConfig, run_id: str) -> list[dict[str, Any]]:
    """Read the cycles of a run from the store; through the service that holds it, if there is one."""
    # Lazy: sqlalchemy and httpx take 380 ms.
    from bench_service.campaign.run_counters import cycles_of
    from bench_service.client import BenchClient
    from bench_service.config.token import read_token
    from bench_service.store.access import FILE
    from bench_service.store.metadata import MetadataStore
    from bench_service.store.samples import SampleReader

    if not (config.data_dir / FILE).exists():
        raise UsageError(f"{run_id}: no runs are stored in {config.data_dir}; see --config")
    holder = MetadataStore.holder(config.data_dir)
    if holder is not None and holder.url is not None:
        with BenchClient(holder.url, token=read_token(config.data_dir)) as client:
            return client.run_cycles(run_id)
    with closing(MetadataStore.look(config.data_dir)) as store, SampleReader(config.data_dir) as samples:
        return cycles_of(store, samples, run_id)


def show(console: Console, cycles: list[dict[str, Any]]) -> None:
    """Print the cycles as a table."""
    table = Table(box=box.SIMPLE_HEAD)
    for _, heading, _ in _COLUMNS:
        table.add_column(heading, justify="right")
    for cycle in cycles:
        shown = {**cycle, "duration_s": cycle["duration_s"] / 3600.0}
        cells = (("" if shown[name] is None else form.format(shown[name])) for name, _, form in _COLUMNS)
        table.add_row(*cells)
    console.print(table)
    for cycle in cycles:
        if cycle["begun_part_charged"]:
            count = cycle["cycle_count"]
            console.print(f"Cycle {count} began part charged: more came out than went in, which is no efficiency.")
