"""What the steps and cycles of a run have moved."""

from __future__ import annotations

import math
from typing import Any

from fastapi import APIRouter

from bench_service.api.answers import listed, shown
from bench_service.api.dependencies import Answer, PathId, ServicesOf
from bench_service.campaign.run_counters import cycles_of, steps_of

router = APIRouter(prefix="/runs", tags=["runs"])


@router.get(
    "/{run_id}/steps",
    openapi_extra=listed("steps")
    | shown(
        {
            "steps": [
                {
                    "step_count": 1,
                    "cycle_count": 1,
                    "duration_s": 600.0,
                    "end_time_s": 600.0,
                    "charged_Ah": 0.4167,
                    "discharged_Ah": 0.0,
                    "charged_Wh": 1.62,
                    "discharged_Wh": 0.0,
                    "ended_by": "time",
                }
            ]
        }
    ),
)
def get_steps(run_id: PathId, services: ServicesOf) -> Answer:
    """Give one object for each step of a protocol that has ended, in the order in which they were played."""
    return {"steps": [_finite(step) for step in steps_of(services.store, services.samples, run_id)]}


@router.get(
    "/{run_id}/cycles",
    openapi_extra=listed("cycles")
    | shown(
        {
            "cycles": [
                {
                    "cycle_count": 1,
                    "n_steps": 4,
                    "duration_s": 7200.0,
                    "charged_Ah": 2.49,
                    "discharged_Ah": 2.48,
                    "charged_Wh": 9.4,
                    "discharged_Wh": 9.1,
                    "cut_off": False,
                    "begun_part_charged": False,
                    "mean_charge_voltage_V": 3.775,
                    "mean_discharge_voltage_V": 3.669,
                    "coulombic_efficiency": 0.996,
                    "energy_efficiency": 0.968,
                }
            ]
        }
    ),
)
def get_cycles(run_id: PathId, services: ServicesOf) -> Answer:
    """Give one object for each cycle of a protocol: capacity, energy, mean voltages, efficiencies."""
    return {"cycles": [_finite(cycle) for cycle in cycles_of(services.store, services.samples, run_id)]}


def _finite(values: dict[str, Any]) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in values.items()}
