"""Everything that is read out of a fitted network for later use: open-circuit voltage, resistance, step response."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypedDict

import numpy as np

from models.data.errors import ModelError
from models.network.local_model_network import LocalModelNetwork
from models.readouts.ocv import OcvTable, ocv_table
from models.readouts.resistance import ResistanceTable, resistance_table
from models.readouts.steady_state import soc_axis, temperature_axis
from models.readouts.step_response import CurrentStep, StepResponse, step_response
from models.uncertainty.model_uncertainty import uncertainty_of
from models.uncertainty.spread import LocalFactor

_STEP_S = 1800.0
_STEP_POINTS = 30
_STEP_SHARES = (0.2, 0.5, 0.8)
_STEP_TEMPERATURES = 3
# Of the largest trained current: steps at the edge itself would lie where data are thinnest.
_STEP_CURRENT = 0.5


class Tables(TypedDict):
    """Read-outs as their own documents, with the reservations of them all."""

    ocv: dict[str, Any]
    resistance: dict[str, Any]
    step_response: list[dict[str, Any]]
    reservations: list[str]


class MiddleResistance(TypedDict):
    """Resistance at the middle of the table's axes, in one direction."""

    soc: float
    temperature_degC: float
    current_A: float
    resistance_Ohm: float | None
    std_Ohm: float | None


class Summary(TypedDict):
    """The read-outs in a few numbers; see `summary`."""

    resistance: list[MiddleResistance]
    ocv_V: list[float | None]
    hysteresis_V: float | None
    ocv_std_V: float | None
    thermal: dict[str, Any] | None
    thin_local_models: int | None
    reservations: list[str]


def read_out(network: LocalModelNetwork) -> Tables:
    """Tables and step responses with their bands and physical reservations.

    Parameters
    ----------
    network : its record holds the trained domain and, for the bands, the uncertainty

    Returns
    -------
    dict
        `ocv`, `resistance` and `step_response` as their own documents, and `reservations` of them all.
    """
    uncertainty = uncertainty_of(network)
    local = None if uncertainty is None else LocalFactor(uncertainty.parameters.theta_factor)
    ocv, resistance = ocv_table(network, local=local), resistance_table(network, local=local)
    steps = _steps(network, local)
    reservations = [*ocv.reservations, *resistance.reservations, *(r for step in steps for r in step.reservations)]
    if uncertainty is not None and uncertainty.thin.any():
        count = int(uncertainty.thin.sum())
        reservations.append(
            f"{count} of {network.n_models} local models have too little data of their own and lean on their neighbours"
        )
    return {
        "ocv": ocv.to_json(),
        "resistance": resistance.to_json(),
        "step_response": [step.to_json() for step in steps],
        "reservations": list(dict.fromkeys(reservations)),
    }


def tables_of(network: LocalModelNetwork) -> tuple[OcvTable, ResistanceTable]:
    """Open-circuit and resistance table: as the record carries them, else read out now."""
    tables = network.record.tables
    if tables is None:
        return ocv_table(network), resistance_table(network)
    if not isinstance(tables, dict) or not {"ocv", "resistance"} <= set(tables):
        raise ModelError("the model's tables are damaged: open-circuit voltage and resistance are needed")
    return OcvTable.from_json(tables["ocv"]), ResistanceTable.from_json(tables["resistance"])


def summary(network: LocalModelNetwork) -> Summary:
    """Give the read-outs of a fitted network in a few numbers.

    Returns
    -------
    dict
        `resistance`: rows of SoC, temperature, current, value and standard deviation at the middle of the table, one
        for each direction; `ocv_V`: lowest and highest mean voltage; `hysteresis_V`: mean distance of the branches;
        `ocv_std_V`: mean band, one standard deviation; `thermal`: heat capacity and transfer or None;
        `thin_local_models`; `reservations` of tables and thermal model.
    """
    ocv, resistance = tables_of(network)
    uncertainty, heat = uncertainty_of(network), network.record.thermal or {}
    thermal = heat.get("model")
    rows = [_middle(resistance, sign) for sign in (-1.0, 1.0) if (np.sign(resistance.current_A) == sign).any()]
    return {
        "resistance": rows,
        "ocv_V": [_known(np.nanmin(ocv.mean_V)), _known(np.nanmax(ocv.mean_V))],
        "hysteresis_V": _known(np.nanmean(ocv.voltage_V[1] - ocv.voltage_V[0])),
        "ocv_std_V": None if ocv.std_V is None else _known(np.nanmean(ocv.std_V)),
        "thermal": thermal and {key: thermal[key] for key in ("heat_capacity_J_per_K", "heat_transfer_W_per_K", "std")},
        "thin_local_models": None if uncertainty is None else int(uncertainty.thin.sum()),
        "reservations": [
            *(network.record.tables or {}).get("reservations", []),
            *heat.get("reservations", []),
        ],
    }


def _middle(table: ResistanceTable, sign: float) -> MiddleResistance:
    """Resistance at the middle of the table's axes, in one direction."""
    own = np.flatnonzero(np.sign(table.current_A) == sign)
    at = (int(own[len(own) // 2]), len(table.temperature_degC) // 2, len(table.soc) // 2)
    return {
        "soc": float(table.soc[at[2]]),
        "temperature_degC": float(table.temperature_degC[at[1]]),
        "current_A": float(table.current_A[at[0]]),
        "resistance_Ohm": _known(table.resistance_Ohm[at]),
        "std_Ohm": None if table.std_Ohm is None else _known(table.std_Ohm[at]),
    }


def _known(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def _steps(network: LocalModelNetwork, local: LocalFactor | None) -> list[StepResponse]:
    """Step responses from rest in both directions, at a few states of charge and temperatures."""
    soc = soc_axis(network, 101)
    low, high = network.record.domain.get("current_A", (0.0, 0.0))
    found = []
    for degC in temperature_axis(network, _STEP_TEMPERATURES):
        for share in _STEP_SHARES:
            for to_A in (_STEP_CURRENT * low, _STEP_CURRENT * high):
                if abs(to_A) <= network.cell.rest_A:
                    continue
                try:
                    step = step_response(
                        network,
                        CurrentStep(soc=float(np.quantile(soc, share)), to_A=to_A, temperature_degC=float(degC)),
                        duration_s=_STEP_S,
                        local=local,
                    )
                except ModelError:
                    # It does not settle there, which the tables' reservations say.
                    continue
                found.append(_thinned(step))
    return found


def _thinned(step: StepResponse) -> StepResponse:
    """Points evenly spaced in the logarithm of time."""
    n = len(step.time_s)
    kept = np.unique(np.round(np.geomspace(1, n, _STEP_POINTS)).astype(np.int64)) - 1
    std = None if step.std_Ohm is None else step.std_Ohm[kept]
    return replace(step, time_s=step.time_s[kept], resistance_Ohm=step.resistance_Ohm[kept], std_Ohm=std)
