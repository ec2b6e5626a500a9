"""The thermal model beside a network: identified with it, and judged by the closed simulation."""

from __future__ import annotations

from typing import Any, TypedDict

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import soc_by_counting
from models.readouts.ocv import OcvTable
from models.readouts.tables import tables_of
from models.thermal.closed_loop import simulate_closed
from models.thermal.identification import identify_thermal
from models.thermal.model import ThermalModel

# The network's own voltage noise does not matter to its heat; a start from a few samples does to a sensor's noise.
_START_SAMPLES = 5


class ThermalRecord(TypedDict):
    """What a network's record says of its heat balance: the thermal model's document or None, and reservations."""

    model: dict[str, Any] | None
    reservations: list[str]


class RunTemperature(TypedDict):
    """Closed simulation of one run."""

    run: str
    rmse_K: float
    voltage_rmse_mV: float | None


class TemperatureComparison(TypedDict):
    """Closed simulation of all runs; see `compare_temperature`."""

    rmse_K: float | None
    voltage_rmse_mV: float | None
    runs: list[RunTemperature]
    reservations: list[str]


def thermal_record(network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float]) -> ThermalRecord | None:
    """Identify the heat balance of a cell whose network is known.

    Parameters
    ----------
    network : its record holds the open-circuit table that the losses I (V - U) come from
    runs, initial_soc : training runs; those without ambient or cell temperature take no part

    Returns
    -------
    dict or None
        `model`: the thermal model's document or None, and `reservations`; None where no run has an ambient
        temperature. What the data cannot determine is a reservation, not an error: the voltage model stands without.
    """
    known = [(run, soc) for run, soc in zip(runs, initial_soc, strict=True) if run.ambient_degC is not None]
    usable = [(run, soc) for run, soc in known if _has_temperatures(run)]
    if not known:
        return None
    if not usable:
        return {"model": None, "reservations": ["no thermal model: the cell's own temperature was not measured"]}
    ocv, _ = tables_of(network)
    counted = [_counted(network, run, soc) for run, soc in usable]
    try:
        found = identify_thermal([run for run, _ in usable], counted, ocv, reversible=True)
    except ModelError as error:
        return {"model": None, "reservations": [f"no thermal model: {error}"]}
    reservations = list(found.reservations)
    if len(usable) < len(known):
        reservations.append(f"{len(known) - len(usable)} run(s) with an ambient but no cell temperature were left out")
    return {"model": found.model.to_json(), "reservations": reservations}


def thermal_of(network: LocalModelNetwork) -> tuple[ThermalModel, OcvTable] | None:
    """Thermal model and the table of its losses, as the network's record carries them; None where it has none."""
    record = network.record.thermal
    document = record.get("model") if isinstance(record, dict) else None
    return None if document is None else (ThermalModel.from_json(document), tables_of(network)[0])


def compare_temperature(
    network: LocalModelNetwork, runs: list[GridRun], initial_soc: list[float]
) -> TemperatureComparison | None:
    """Closed simulation of measured runs: voltage and temperature from current and ambient temperature alone.

    Parameters
    ----------
    network : with a thermal model in its record
    runs : on the network's grid; only first voltage and temperature are used as initial values
    initial_soc : fraction of each run

    Returns
    -------
    dict or None
        `rmse_K` over all samples (None where no run could be simulated), `voltage_rmse_mV` of the same simulation,
        `runs` with the same for each, and `reservations`; None without a thermal model or ambient temperature.
    """
    models = thermal_of(network)
    usable = [(run, soc) for run, soc in zip(runs, initial_soc, strict=True) if _has_temperatures(run)]
    if models is None or not usable:
        return None
    thermal, ocv = models
    rows: list[RunTemperature] = []
    reservations: list[str] = []
    warm, electric = np.zeros(0), np.zeros(0)
    for run, soc in usable:
        try:
            off_K, off_V = _closed_error(network, thermal, ocv, run, soc)
        except ModelError as error:
            reservations.append(f"{run.name}: {error}")
            continue
        warm, electric = np.concatenate([warm, off_K]), np.concatenate([electric, off_V])
        rows.append({"run": run.name, "rmse_K": _rms(off_K), "voltage_rmse_mV": _millivolts(off_V)})
    return {
        "rmse_K": _rms(warm) if len(warm) else None,
        "voltage_rmse_mV": _millivolts(electric),
        "runs": rows,
        "reservations": reservations,
    }


def _closed_error(
    network: LocalModelNetwork, thermal: ThermalModel, ocv: OcvTable, run: GridRun, soc: float
) -> tuple[FloatArray, FloatArray]:
    """Simulated minus measured temperature and voltage where they were measured."""
    assert run.ambient_degC is not None
    simulated = simulate_closed(
        network,
        thermal,
        ocv,
        run.current_A,
        run.ambient_degC,
        initial_soc=soc,
        initial_degC=float(np.median(run.temperature_degC[:_START_SAMPLES])),
        initial_voltage_V=float(run.voltage_V[0]),
    )
    off_K, off_V = simulated.temperature_degC - run.temperature_degC, simulated.voltage_V - run.voltage_V
    if not np.isfinite(off_K).all():
        raise ModelError("the closed simulation leaves the finite numbers: thermal model and network do not fit")
    return off_K, off_V[~np.isnan(off_V)]


def _has_temperatures(run: GridRun) -> bool:
    """Whether ambient and cell temperature are known and the latter is not a copy of the former."""
    if run.ambient_degC is None or np.isnan(run.ambient_degC).any() or np.isnan(run.temperature_degC).any():
        return False
    return not np.array_equal(run.ambient_degC, run.temperature_degC)


def _counted(network: LocalModelNetwork, run: GridRun, soc: float) -> FloatArray:
    return soc_by_counting(run.charge_Ah, soc, network.cell.capacity_Ah, network.cell.efficiency)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _millivolts(values: FloatArray) -> float | None:
    return 1e3 * _rms(values) if len(values) else None
