"""Tables of cycles: efficiencies only where what came out went in before."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Console

from bench_service.cli.run_tables import show
from bench_service.protocol.tables import cycle_table


def _step(count: int, charged_Ah: float, discharged_Ah: float) -> dict[str, Any]:
    return {
        "cycle_count": count, "ended_by": "VOLTAGE", "duration_s": 3600.0, "charged_Ah": charged_Ah,
        "discharged_Ah": discharged_Ah, "charged_Wh": 4.0 * charged_Ah, "discharged_Wh": 3.6 * discharged_Ah,
    }  # fmt: skip


def test_a_cycle_that_begins_half_full_has_no_efficiency_and_says_why() -> None:
    first, second = cycle_table([_step(1, 1.2, 0.0), _step(1, 0.0, 2.5), _step(2, 2.5, 0.0), _step(2, 0.0, 2.49)])
    assert first["begun_part_charged"] and not second["begun_part_charged"]
    assert first["coulombic_efficiency"] is None and first["energy_efficiency"] is None
    assert second["coulombic_efficiency"] == 2.49 / 2.5
    out = io.StringIO()
    show(Console(file=out, width=200), [first, second])
    assert out.getvalue().count("began part charged") == 1 and "Cycle 1 began" in out.getvalue()


def test_a_cycle_that_was_cut_off_before_its_charge_was_whole_did_not_begin_part_charged() -> None:
    (cycle,) = cycle_table([_step(1, 0.0, 2.5), _step(1, 0.1, 0.0) | {"ended_by": "run_ended"}])
    assert cycle["cut_off"] and cycle["coulombic_efficiency"] is None and not cycle["begun_part_charged"]


def test_a_cycle_of_one_direction_has_no_efficiency() -> None:
    (cycle,) = cycle_table([_step(1, 0.0, 2.5)])
    assert cycle["coulombic_efficiency"] is None and not cycle["begun_part_charged"]
