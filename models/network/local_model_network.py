"""The local model network as data: its parameters, what they mean, and its document."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.data.errors import StructureError
from models.data.resampling import GridRun
from models.data.seal import check_seal
from models.data.timeseries import FloatArray
from models.network.model_record import ModelRecord
from models.network.partition import Partition
from models.network.regression import VOLTAGE, CellContext, Dataset, Scaling, build_dataset
from models.network.structure import Structure

SCHEMA_VERSION = 1
# Beyond any parameter in normalised units and any physical range; larger ones overflow in the free run.
_LARGEST = 1e9


@dataclass(frozen=True)
class LocalModelNetwork:
    """Local linear models, blended by validity functions (eq. 2.1 to 2.6).

    Attributes
    ----------
    structure : inputs, orders, axes, sampling time
    partition : boxes of the partition space
    theta : (M, p) parameters of each local model in normalised units: n past outputs, input taps, offset
    scaling : ranges that map each signal and the voltage to 0..1
    cell : capacity, efficiency, rest current
    record : what the model was made from and how well it did
    """

    structure: Structure
    partition: Partition
    theta: FloatArray
    scaling: Scaling
    cell: CellContext
    record: ModelRecord = field(default_factory=ModelRecord)

    def __post_init__(self) -> None:
        """Check that partition and parameters fit the structure."""
        expected = (self.partition.n_models, self.structure.n_regressors)
        if self.theta.shape != expected:
            raise StructureError(f"parameters have shape {self.theta.shape}; the structure needs {expected}")

    @property
    def n_models(self) -> int:
        """Number of local models."""
        return self.partition.n_models

    @property
    def name(self) -> str:
        """What a person calls the model."""
        return f"network ({self.structure.name})"

    @property
    def dt_s(self) -> float:
        """Sampling time in s."""
        return self.structure.dt_s

    @property
    def voltage_span_V(self) -> float:
        """Volts per unit of normalised output."""
        low, high = self.scaling[VOLTAGE]
        return high - low

    def scaled_over(self, kind: str) -> tuple[float, float] | None:
        """Range in its unit by which the first signal of a kind is normalised; None where there is none of it."""
        return next((bounds for name, bounds in self.scaling.items() if name.partition(":")[0] == kind), None)

    def dataset(self, runs: list[GridRun], initial_soc: list[float]) -> Dataset:
        """Regression arrays of runs in this network's scaling."""
        return build_dataset(self.structure, self.scaling, runs, initial_soc, self.cell)

    def to_volts(self, normalised: FloatArray) -> FloatArray:
        """Convert normalised output to V."""
        low, high = self.scaling[VOLTAGE]
        return low + (high - low) * normalised

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types with its schema version."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "local_model_network",
            "structure": self.structure.to_json(),
            "partition": {"lower": self.partition.lower.tolist(), "upper": self.partition.upper.tolist()},
            "theta": self.theta.tolist(),
            "scaling": {name: list(bounds) for name, bounds in self.scaling.items()},
            "cell": {"capacity_Ah": self.cell.capacity_Ah, "efficiency": self.cell.efficiency},
            "record": self.record.to_json(),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> LocalModelNetwork:
        """Read what `to_json` wrote.

        Raises
        ------
        StructureError
            The document is no network, of another schema version, or contradicts itself.
        """
        if isinstance(document, dict):
            check_seal(document)
        if isinstance(document, dict) and document.get("kind") == "module_network":
            raise StructureError(
                "the document is the model of a module; here that of a cell is needed: it stands under 'cell' in it"
            )
        if not isinstance(document, dict) or document.get("kind") != "local_model_network":
            raise StructureError("not a model document: its 'kind' must be 'local_model_network'")
        if document.get("schema_version") != SCHEMA_VERSION:
            raise StructureError(
                f"model document has schema version {document.get('schema_version')!r}; {SCHEMA_VERSION} is supported"
            )
        try:
            structure = Structure.from_json(document["structure"])
            theta = _numbers(document["theta"], "theta", 2, _LARGEST)
            lower = _numbers(document["partition"]["lower"], "partition.lower", 2, _LARGEST)
            upper = _numbers(document["partition"]["upper"], "partition.upper", 2, _LARGEST)
            scaling = {
                str(name): tuple(_numbers(bounds, f"scaling.{name}", 1, _LARGEST).tolist())
                for name, bounds in document["scaling"].items()
            }
            capacity_Ah, efficiency = _numbers(
                [document["cell"]["capacity_Ah"], document["cell"]["efficiency"]], "cell", 1, _LARGEST
            )
            record = ModelRecord.from_json(document.get("record", {}))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
            if isinstance(error, StructureError):
                raise
            raise StructureError(f"model document is damaged: {error!r}") from None
        _check_document(structure, lower, upper, scaling, float(capacity_Ah), float(efficiency))
        k_sigma = np.array([axis.k_sigma for axis in structure.axes])
        partition = Partition(lower, upper, k_sigma, structure.kernel, tuple(axis.held for axis in structure.axes))
        cell = CellContext(float(capacity_Ah), float(efficiency))
        return cls(structure, partition, theta, {k: (v[0], v[1]) for k, v in scaling.items()}, cell, record)


def _numbers(values: Any, where: str, dimensions: int, largest: float) -> FloatArray:
    """Read nested lists of plain finite numbers; text, true and false are none."""

    def plain(value: Any) -> bool:
        if isinstance(value, list | tuple):
            return all(plain(part) for part in value)
        return isinstance(value, int | float) and not isinstance(value, bool)

    if not plain(values):
        raise StructureError(f"model document is damaged: {where} must hold numbers only")
    array = np.array(values, dtype=np.float64)
    if array.ndim != dimensions or not (np.abs(array) <= largest).all():
        raise StructureError(
            f"model document is damaged: {where} must be {dimensions}-dimensional with finite values up to {largest:g}"
        )
    return array


def _check_document(
    structure: Structure,
    lower: FloatArray,
    upper: FloatArray,
    scaling: dict[str, tuple[float, ...]],
    capacity_Ah: float,
    efficiency: float,
) -> None:
    missing = {*structure.signals, VOLTAGE} - set(scaling)
    if missing:
        raise StructureError(f"model document is damaged: no scaling for {', '.join(sorted(missing))}")
    for name, bounds in scaling.items():
        if len(bounds) != 2 or not bounds[0] < bounds[1]:
            raise StructureError(
                f"model document is damaged: scaling of {name} is {list(bounds)}; low < high is needed"
            )
    if lower.shape != upper.shape or lower.shape[1] != len(structure.axes) or not (lower < upper).all():
        raise StructureError("model document is damaged: its boxes do not fit the partition axes")
    if not capacity_Ah > 0.0 or not 0.0 < efficiency <= 1.0:
        raise StructureError(
            f"model document is damaged: capacity {capacity_Ah:g} Ah must be positive and efficiency {efficiency:g} "
            "in 0..1"
        )
