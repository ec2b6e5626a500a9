"""A model's document looked through to its last part, before it is believed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from models.data.errors import ModelError, StructureError
from models.data.resampling import to_grid
from models.data.seal import SEAL
from models.data.timeseries import TimeSeries
from models.diagnosis.known.record import known_in
from models.identification.stored_sums import sums_of
from models.network.free_run import free_run_V
from models.network.lineage import version_of
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json, ModelRecord
from models.pipeline.meaning.check import check_form, check_meaning
from models.readouts.tables import tables_of
from models.thermal.cell_temperature import thermal_of
from models.uncertainty.model_uncertainty import uncertainty_of

_LARGEST = 1e15
_DEEPEST = 20
_TOP = {"schema_version", "kind", "structure", "partition", "theta", "scaling", "cell", "record", "sha256"}
_FIGURES = ("rmse_mV", "mae_mV", "p95_mV", "max_mV", "bias_mV", "nrmse", "n_samples")
_UNITS = {"V", "mV", "A", "s", "Ohm", "degC", "K", "Ah", "Hz", "W", "sigma", "mse", "strengths", "share"}
_TRIAL_SAMPLES = 240
# No cell or module that a bench could hold; a model that says so has no stable output.
_MOST_SPANS = 100.0
_DAMAGE = (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, ZeroDivisionError, MemoryError)


def check_model(document: Any) -> LocalModelNetwork:
    """Read a model's document with every part of its record, and let it run for a moment.

    What one that carries no seal says is not what a program wrote: it is looked through for its meaning too.

    Raises
    ------
    ModelError
        It is no model, a part of it is not of its kind, it was changed after it was written, or its output grows
        without bound.
    """
    if isinstance(document, dict):
        if unknown := sorted(map(str, set(document) - _TOP)):
            raise StructureError(f"model document has unknown parts: {', '.join(unknown)[:100]}")
        _check_values(document, "document", 0)
        if SEAL not in document:
            check_form(document)
    network = LocalModelNetwork.from_json(document)
    _check_record(network.record)
    for part, read in _READERS.items():
        _read(part, read, network)
    _let_run(network)
    if SEAL not in document:
        check_meaning(network)
    return network


def _thermal_parts(network: LocalModelNetwork) -> Any:
    thermal = network.record.thermal
    if thermal is not None:
        _texts("thermal.reservations", thermal["reservations"])
    return thermal_of(network)


def _table_parts(network: LocalModelNetwork) -> Any:
    tables = network.record.tables
    if tables is None:
        return None
    for step in tables["step_response"]:
        _object("tables.step_response", step)
    for table in tables_of(network):
        if any(not np.isfinite(axis).all() or (np.diff(axis) <= 0.0).any() for axis in (table.soc,)):
            raise ModelError("the axes of the tables must rise")
    return _texts("tables.reservations", tables["reservations"]) if "reservations" in tables else None


_READERS: dict[str, Callable[[LocalModelNetwork], Any]] = {
    "uncertainty": uncertainty_of,
    "tables": _table_parts,
    "thermal": _thermal_parts,
    "sums": sums_of,
    "diagnosis": known_in,
    "version": version_of,
}


def _read(part: str, read: Callable[[LocalModelNetwork], Any], network: LocalModelNetwork) -> None:
    try:
        read(network)
    except _DAMAGE as error:
        if isinstance(error, ModelError):
            raise
        raise StructureError(f"model document is damaged: record.{part} cannot be read: {error!r:.100}") from error


def _check_values(value: Any, where: str, depth: int) -> None:
    if depth > _DEEPEST:
        raise StructureError(f"model document is damaged: {where:.60} is nested too deeply")
    if isinstance(value, dict):
        for key, part in value.items():
            if _is_quantity(key) and not _numbers_only(part):
                raise StructureError(
                    f"model document is damaged: {where:.60}.{key} is {part!r:.30}; numbers are needed"
                )
            _check_values(part, f"{where}.{key}", depth + 1)
    elif isinstance(value, list):
        # Most of a document are long lists of numbers: those are looked at all at once.
        if set(map(type, value)) == {float} and np.abs(value).max() <= _LARGEST:
            return
        if len({_kind(part) for part in value if part is not None}) > 1:
            raise StructureError(f"model document is damaged: {where:.60} mixes kinds of values")
        for part in value:
            _check_values(part, where, depth + 1)
    elif isinstance(value, int | float) and not abs(value) <= _LARGEST:
        raise StructureError(f"model document is damaged: {where:.60} is {value!r:.30}; a finite number is needed")


def _kind(value: Any) -> str:
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__


def _is_quantity(key: Any) -> bool:
    """Whether a name says by its unit, or as a figure, that it holds numbers."""
    return key in _FIGURES or (isinstance(key, str) and key.rpartition("_")[2] in _UNITS and "_" in key)


def _numbers_only(value: Any) -> bool:
    """Whether a value is a number, nothing, or made of such; also where it names them, as by run or by way.

    An effect's parameter is a number with its standard deviation and its unit.
    """
    if isinstance(value, dict):
        return bool(value) and all(_numbers_only(part) for key, part in value.items() if key != "unit")
    if isinstance(value, list):
        return all(_numbers_only(part) for part in value)
    return value is None or _number(value)


def _check_record(record: ModelRecord) -> None:
    _texts("train_runs", record.train_runs)
    _texts("reservations", record.reservations)
    for name in ("choices", "refinement", "uncertainty", "tables", "thermal", "sums", "diagnosis", "version"):
        if getattr(record, name) is not None:
            _object(name, getattr(record, name))
    if record.usability is not None:
        _texts("usability.reasons", _object("usability", record.usability).get("reasons"))
    for name in ("observer", "update"):
        if getattr(record, name) is not None:
            _object(name, getattr(record, name))
    for name in ("candidates", "residuals", "effects"):
        for each in getattr(record, name):
            _object(name, each)
    for name in ("train", "validation"):
        if getattr(record, name) is not None:
            _figures(name, getattr(record, name))
    if record.noise_floor_mV is not None and not _number(record.noise_floor_mV, 0.0):
        raise StructureError(f"model document is damaged: record.noise_floor_mV is {record.noise_floor_mV!r:.30}")
    if record.parent is not None and not isinstance(record.parent, str):
        raise StructureError("model document is damaged: record.parent must be text")
    for name, (low, high) in record.domain.items():
        if not (_number(low) and _number(high) and low <= high):
            raise StructureError(f"model document is damaged: record.domain.{name} is {low!r:.30} to {high!r:.30}")


def _object(name: str, value: Any) -> Json:
    if not isinstance(value, dict):
        raise StructureError(f"model document is damaged: record.{name} must hold objects; it has {value!r:.60}")
    return value


def _texts(name: str, values: Any) -> None:
    if not isinstance(values, list | tuple) or not all(isinstance(each, str) for each in values):
        raise StructureError(f"model document is damaged: record.{name} must be a list of texts")


def _figures(name: str, value: Any) -> None:
    figures = _object(name, value)
    for figure in _FIGURES:
        lowest = -math.inf if figure == "bias_mV" else 0.0
        if figure not in figures or not (figures[figure] is None or _number(figures[figure], lowest)):
            raise StructureError(f"model document is damaged: record.{name}.{figure} must be a number")


def _number(value: Any, lowest: float = -math.inf) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value >= lowest


def _let_run(network: LocalModelNetwork) -> None:
    """A pulse and a rest in the middle of what the model was trained on: its output must stay where cells are."""
    low, high = (float(each) for each in network.record.domain.get("soc", (0.2, 0.8)))
    amplitude_A = 0.1 * network.cell.capacity_Ah
    time_s = network.dt_s * np.arange(_TRIAL_SAMPLES)
    current_A = np.where(np.arange(_TRIAL_SAMPLES) % 80 < 40, -amplitude_A, 0.0)
    degC = network.record.domain.get("temperature_degC", (25.0, 25.0))
    low_V, high_V = network.scaling["voltage"]
    run = TimeSeries(
        time_s=time_s,
        current_A=current_A,
        voltage_V=np.full(_TRIAL_SAMPLES, 0.5 * (low_V + high_V)),
        temperature_degC=np.full(_TRIAL_SAMPLES, 0.5 * (degC[0] + degC[1])),
    )
    try:
        with np.errstate(all="ignore"):
            voltage_V = free_run_V(network, to_grid(run, network.dt_s), 0.5 * (low + high))
    except _DAMAGE as error:
        if isinstance(error, ModelError):
            raise
        raise StructureError(f"model document is damaged: the model cannot run: {error!r:.100}") from error
    reach_V = _MOST_SPANS * (high_V - low_V)
    if not ((voltage_V > low_V - reach_V) & (voltage_V < high_V + reach_V)).all():
        raise StructureError("model document is damaged: the model's voltage grows without bound")
