"""What a document says twice must be the same: tables and parameters, memory and cell, sizes of related parts."""

from __future__ import annotations

from typing import Any

import numpy as np

from models.data.errors import ModelError, StructureError
from models.data.timeseries import FloatArray
from models.identification.stored_sums import sums_of
from models.network.lineage import document_sha256
from models.network.local_model_network import LocalModelNetwork
from models.readouts.ocv import OcvTable, ocv_table
from models.readouts.resistance import ResistanceTable, resistance_table
from models.readouts.step_response import CurrentStep, step_response
from models.readouts.tables import tables_of
from models.uncertainty.model_uncertainty import uncertainty_of
from models.uncertainty.spread import LocalFactor

# Documents are written with all digits; covariances with seven.
_RELATIVE, _STD_RELATIVE = 1e-3, 2e-2
_LEAST_V, _LEAST_OHM = 1e-4, 1e-6
# Between what the memory says of the cell and what the model does: effects may move a capacity.
_MOST_RATIO = 2.0


def read_out_now(network: LocalModelNetwork) -> tuple[OcvTable, ResistanceTable]:
    """Read both tables out of the parameters, at the axes of the document's own ones where it has any."""
    uncertainty = uncertainty_of(network)
    local = None if uncertainty is None else LocalFactor(uncertainty.parameters.theta_factor)
    if network.record.tables is None:
        return ocv_table(network, local=local), resistance_table(network, local=local)
    ocv, resistance = tables_of(network)
    return (
        ocv_table(network, ocv.soc, ocv.temperature_degC, local),
        resistance_table(network, resistance.soc, resistance.current_A, resistance.temperature_degC, local),
    )


def check_tables_agree(network: LocalModelNetwork, ocv: OcvTable, resistance: ResistanceTable) -> None:
    """Refuse tables that are not those of the parameters.

    Parameters
    ----------
    network : its record may carry tables; one that was updated live carries those of before
    ocv, resistance : as `read_out_now` gives them

    Raises
    ------
    StructureError
    """
    tables = network.record.tables
    if tables is None or network.record.update is not None:
        return
    stated_ocv, stated_resistance = tables_of(network)
    _same("tables.ocv.voltage_V", stated_ocv.voltage_V, ocv.voltage_V, _LEAST_V)
    if "mean_V" in tables["ocv"]:
        mean_V = np.array(tables["ocv"]["mean_V"], dtype=np.float64)
        _same("tables.ocv.mean_V", mean_V, ocv.mean_V, _LEAST_V)
    _same("tables.resistance.resistance_Ohm", stated_resistance.resistance_Ohm, resistance.resistance_Ohm, _LEAST_OHM)
    _same_spread("tables.ocv.std_V", stated_ocv.std_V, ocv.std_V, _LEAST_V)
    _same_spread("tables.resistance.std_Ohm", stated_resistance.std_Ohm, resistance.std_Ohm, _LEAST_OHM)
    for step in tables["step_response"]:
        _step_agrees(network, step)


def check_parts_agree(network: LocalModelNetwork) -> None:
    """Refuse a memory of another cell, sums of another model, errors larger than the voltages; raises `ModelError`."""
    record, cell = network.record, network.cell
    settings = (record.version or {}).get("settings") or {}
    memory = record.diagnosis or {}
    for name, said in (("version.settings", settings), ("diagnosis", memory)):
        _near(f"{name}.capacity_Ah", said.get("capacity_Ah"), cell.capacity_Ah)
        _near(f"{name}.dt_s", said.get("dt_s"), network.dt_s)
    sums, stored = sums_of(network), (record.version or {}).get("sums_sha256")
    if sums is not None:
        if stored is not None and stored != document_sha256(record.sums or {}):
            raise StructureError("model document is damaged: record.sums have another sha256 than record.version says")
        if not sums.n_samples > 0.0 or sums.squared_error < 0.0 or (np.diag(sums.information) < 0.0).any():
            raise StructureError("model document is damaged: record.sums are no sums of squares")
    most_mV = 1e3 * network.voltage_span_V
    for name, figures in (("train", record.train), ("validation", record.validation)):
        if figures and (figures["rmse_mV"] or 0.0) > 10.0 * most_mV:
            raise StructureError(
                f"model document is damaged: record.{name}.rmse_mV is {figures['rmse_mV']:g}; "
                f"the voltages span {most_mV:g} mV"
            )
    if (record.noise_floor_mV or 0.0) > most_mV:
        raise StructureError(
            f"model document is damaged: record.noise_floor_mV is {record.noise_floor_mV:g}; the voltages span "
            f"{most_mV:g} mV"
        )


def check_domain(network: LocalModelNetwork) -> None:
    """Refuse trained ranges that have nothing to do with those that the signals are scaled by; raises `ModelError`."""
    names = {"soc": "soc", "current_A": "current", "temperature_degC": "temperature"}
    for name, (low, high) in network.record.domain.items():
        bounds = network.scaled_over(names.get(name, name))
        if bounds is None:
            continue
        span = bounds[1] - bounds[0]
        if low > bounds[1] + span or high < bounds[0] - span or high - low > 20.0 * span or high - low < 0.01 * span:
            raise StructureError(
                f"model document is damaged: record.domain.{name} is {low:g}..{high:g}, its scaling {bounds[0]:g}.."
                f"{bounds[1]:g}"
            )


def _step_agrees(network: LocalModelNetwork, step: dict[str, Any]) -> None:
    time_s, stated_Ohm = (np.array(step[key], dtype=np.float64) for key in ("time_s", "resistance_Ohm"))
    if time_s.ndim != 1 or not len(time_s) or time_s.shape != stated_Ohm.shape or (np.diff(time_s) <= 0.0).any():
        raise StructureError("model document is damaged: the times of a step response must rise, one to a resistance")
    if time_s[-1] > 1e5:
        raise StructureError(f"model document is damaged: a step response of {time_s[-1]:g} s")
    degC, before = float(step["temperature_degC"]), float(step["direction_before"])
    asked = CurrentStep(
        soc=float(step["soc"]),
        to_A=float(step["to_A"]),
        from_A=float(step["from_A"]),
        temperature_degC=degC,
        direction_before=before,
    )
    found = step_response(network, asked, float(time_s[-1]))
    now_Ohm = np.interp(time_s, found.time_s, found.resistance_Ohm)
    _same("tables.step_response.resistance_Ohm", stated_Ohm, now_Ohm, _LEAST_OHM)
    if step["std_Ohm"] is not None:
        std_Ohm = np.array(step["std_Ohm"], dtype=np.float64)
        if std_Ohm.shape != time_s.shape or not (std_Ohm >= 0.0).all():
            raise StructureError("model document is damaged: the bands of a step response must be positive")


def _same(where: str, stated: FloatArray, now: FloatArray, least: float, relative: float = _RELATIVE) -> None:
    if stated.shape != now.shape or (np.isnan(stated) != np.isnan(now)).any():
        raise StructureError(f"model document is damaged: {where} is not what its parameters give")
    known = ~np.isnan(stated)
    off = np.abs(stated - now)[known] - relative * np.abs(now)[known]
    if len(off) and off.max() > least:
        k = int(np.argmax(off))
        raise StructureError(
            f"model document is damaged: {where} says {stated[known][k]:g}, its parameters give {now[known][k]:g}"
        )


def _same_spread(where: str, stated: FloatArray | None, now: FloatArray | None, least: float) -> None:
    if stated is None:
        return
    if now is None:
        if (stated[~np.isnan(stated)] < 0.0).any():
            raise StructureError(f"model document is damaged: {where} must be positive")
        return
    _same(where, stated, now, least, _STD_RELATIVE)


def _near(where: str, stated: Any, now: float) -> None:
    if stated is None:
        return
    ratio = float(stated) / now
    if not 1.0 / _MOST_RATIO <= ratio <= _MOST_RATIO:
        raise ModelError(f"model document is damaged: record.{where} is {float(stated):g}, the model's is {now:g}")
