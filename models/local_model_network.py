"""The local model network: one-step and free-run output, sensitivities, and its document."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.errors import StructureError
from models.free_run import run_recursion
from models.partition import Partition
from models.regression import VOLTAGE, CellContext, Dataset, Scaling, build_dataset
from models.resampling import GridRun
from models.structure import Structure
from models.timeseries import FloatArray

SCHEMA_VERSION = 1


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
    record : what the model was made from and how well it did; plain types
    """

    structure: Structure
    partition: Partition
    theta: FloatArray
    scaling: Scaling
    cell: CellContext
    record: dict[str, Any] = field(default_factory=dict)

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
    def voltage_span_V(self) -> float:
        """Volts per unit of normalised output."""
        low, high = self.scaling[VOLTAGE]
        return high - low

    def dataset(self, runs: list[GridRun], initial_soc: list[float]) -> Dataset:
        """Regression arrays of runs in this network's scaling."""
        return build_dataset(self.structure, self.scaling, runs, initial_soc, self.cell)

    def free_run_V(self, run: GridRun, initial_soc: float) -> FloatArray:
        """Simulate a run from its current and temperature alone.

        Parameters
        ----------
        run : on a grid of this network's sampling time
        initial_soc : fraction 0..1

        Returns
        -------
        (n,) voltage in V; only the first measured values are used, as initial values.
        """
        data = self.dataset([run], [initial_soc])
        return self.to_volts(free_run(self.theta, self.structure.output_order, self.partition.validity(data.z), data))

    def one_step_V(self, run: GridRun, initial_soc: float) -> FloatArray:
        """Predict each sample from the measured ones before it; NaN where those are missing."""
        data = self.dataset([run], [initial_soc])
        phi = one_step_regressors(data, self.structure.output_order)
        blended = self.partition.validity(data.z) @ self.theta
        return self.to_volts(np.einsum("kp,kp->k", phi, blended))

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
            "record": self.record,
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> LocalModelNetwork:
        """Read what `to_json` wrote.

        Raises
        ------
        StructureError
            The document is no network, of another schema version, or contradicts itself.
        """
        if not isinstance(document, dict) or document.get("kind") != "local_model_network":
            raise StructureError("not a model document: its 'kind' must be 'local_model_network'")
        if document.get("schema_version") != SCHEMA_VERSION:
            raise StructureError(
                f"model document has schema version {document.get('schema_version')!r}; {SCHEMA_VERSION} is supported"
            )
        try:
            structure = Structure.from_json(document["structure"])
            theta = np.array(document["theta"], dtype=np.float64)
            lower = np.array(document["partition"]["lower"], dtype=np.float64)
            upper = np.array(document["partition"]["upper"], dtype=np.float64)
            scaling = {name: (float(b[0]), float(b[1])) for name, b in document["scaling"].items()}
            cell = CellContext(float(document["cell"]["capacity_Ah"]), float(document["cell"]["efficiency"]))
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise StructureError(f"model document is damaged: {error!r}") from None
        if not all(np.isfinite(array).all() for array in (theta, lower, upper)):
            raise StructureError("model document is damaged: a parameter is not finite")
        missing = {*structure.signals, VOLTAGE} - set(scaling)
        if missing:
            raise StructureError(f"model document is damaged: no scaling for {', '.join(sorted(missing))}")
        k_sigma = np.array([axis.k_sigma for axis in structure.axes])
        partition = Partition(lower, upper, k_sigma, structure.kernel)
        return cls(structure, partition, theta, scaling, cell, dict(document.get("record", {})))


def one_step_regressors(data: Dataset, order: int) -> FloatArray:
    """Regressors with measured past outputs; NaN where one is missing or lies before its part's start."""
    phi = np.empty((len(data), order + data.u.shape[1]))
    phi[:, order:] = data.u
    for lag in range(1, order + 1):
        column = np.full(len(data), np.nan)
        column[lag:] = data.y[:-lag]
        for start in data.starts:
            column[start : start + lag] = np.nan
        phi[:, lag - 1] = column
    return phi


def blend(theta: FloatArray, order: int, validity: FloatArray, data: Dataset) -> tuple[FloatArray, FloatArray]:
    """Blended output coefficients a(k) and input contribution f(k) of the free run."""
    coefficients = validity @ theta
    a = np.ascontiguousarray(coefficients[:, :order])
    f = np.einsum("kp,kp->k", coefficients[:, order:], data.u)
    return a, f


def free_run(theta: FloatArray, order: int, validity: FloatArray, data: Dataset) -> FloatArray:
    """Free run in normalised units."""
    a, f = blend(theta, order, validity, data)
    return run_recursion(a, f, data.y, data.starts)
