"""Module models S1 to S4 on top of any cell model's voltage.

With n cells in series, p in parallel and positive current charging (eq. 2.25 to 2.30 of the method, whose minus sign of
R I belongs to the other sign of current):

    S1: V = n V_cell(I / p)                S2: V = n V_cell(I / p) + R I
    S3: V = n V_cell(I / p) + R I + V_0    S4: as S3 with R and V_0 for I > 0 and for I <= 0
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError
from models.data.metrics import Metrics, metrics
from models.data.timeseries import FloatArray, TimeSeries
from models.uncertainty.correlated_errors import least_squares_covariance

SCHEMA_VERSION = 1
KINDS = ("S1", "S2", "S3", "S4")
# Columns of the regression that are nearly one another's multiples cannot be told apart.
_WORST_CONDITION = 1e6
_LEAST_SAMPLES = 20


@dataclass(frozen=True)
class ModuleModel:
    """One of the four module models.

    Attributes
    ----------
    kind : one of KINDS
    cells_in_series, cells_in_parallel : n and p
    resistance_Ohm, offset_V : (charge, rest or discharge); equal but in S4
    resistance_std_Ohm, offset_std_V : standard deviations of the same, 0 where nothing was identified
    rest_A : currents up to this count as rest, so that a sensor's noise does not change the direction
    """

    kind: str
    cells_in_series: int
    cells_in_parallel: int
    resistance_Ohm: tuple[float, float] = (0.0, 0.0)
    offset_V: tuple[float, float] = (0.0, 0.0)
    resistance_std_Ohm: tuple[float, float] = (0.0, 0.0)
    offset_std_V: tuple[float, float] = (0.0, 0.0)
    rest_A: float = 0.0

    def __post_init__(self) -> None:
        """Check kind and layout."""
        if self.kind not in KINDS:
            raise ModelError(f"module model {self.kind!r} is unknown; use one of {', '.join(KINDS)}")
        if self.cells_in_series < 1 or self.cells_in_parallel < 1:
            raise ModelError(f"a module of {self.cells_in_series} x {self.cells_in_parallel} cells has no cell")

    def cell_current_A(self, module_current_A: FloatArray) -> FloatArray:
        """(n,) current of one cell (eq. 2.26)."""
        return module_current_A / self.cells_in_parallel

    def voltage_V(self, cell_voltage_V: FloatArray, module_current_A: FloatArray) -> FloatArray:
        """(n,) module voltage from a cell model's voltage at the cell's current."""
        branch = np.where(module_current_A > self.rest_A, 0, 1)
        resistance, offset = np.array(self.resistance_Ohm)[branch], np.array(self.offset_V)[branch]
        return self.cells_in_series * cell_voltage_V + resistance * module_current_A + offset

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "module_model",
            "model": self.kind,
            "cells_in_series": self.cells_in_series,
            "cells_in_parallel": self.cells_in_parallel,
            "resistance_Ohm": list(self.resistance_Ohm),
            "offset_V": list(self.offset_V),
            "resistance_std_Ohm": list(self.resistance_std_Ohm),
            "offset_std_V": list(self.offset_std_V),
            "rest_A": self.rest_A,
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ModuleModel:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no module model, or damaged.
        """
        known = isinstance(document, dict) and document.get("kind") == "module_model"
        if not known or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not a module model of schema version {SCHEMA_VERSION}")
        try:
            pairs = {
                key: (float(document[key][0]), float(document[key][1]))
                for key in ("resistance_Ohm", "offset_V", "resistance_std_Ohm", "offset_std_V")
            }
            layout = int(document["cells_in_series"]), int(document["cells_in_parallel"])
            return cls(str(document["model"]), *layout, **pairs, rest_A=float(document["rest_A"]))
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ModelError(f"module model is damaged: {error!r}") from None


@dataclass(frozen=True)
class ModuleRun:
    """Module data beside what a cell model says of one cell.

    Attributes
    ----------
    voltage_V : (n,) of the module, NaN where missing
    current_A : (n,) of the module, positive charges
    cell_voltage_V : (n,) of the cell model at `current_A` / p
    name : what a person calls the run
    """

    voltage_V: FloatArray
    current_A: FloatArray
    cell_voltage_V: FloatArray
    name: str = "run"

    def __post_init__(self) -> None:
        """Check the lengths."""
        if not len(self.voltage_V) == len(self.current_A) == len(self.cell_voltage_V):
            raise ModelError(f"{self.name}: module voltage, current and cell voltage differ in length")


@dataclass(frozen=True)
class ModuleComparison:
    """The four models side by side.

    Attributes
    ----------
    models : those that the data determine, by kind
    train, validation : figures of each on the runs that identified it and on others, if there were any
    reservations : why a model is not there
    """

    models: dict[str, ModuleModel]
    train: dict[str, Metrics]
    validation: dict[str, Metrics]
    reservations: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "module_comparison",
            "models": {kind: model.to_json() for kind, model in self.models.items()},
            "train": self.train,
            "validation": self.validation,
            "reservations": list(self.reservations),
        }


def as_cell_run(run: TimeSeries, cells_in_series: int, cells_in_parallel: int) -> TimeSeries:
    """Return a module's run as its mean cell sees it, for simulation with a cell model."""
    return replace(run, current_A=run.current_A / cells_in_parallel, voltage_V=run.voltage_V / cells_in_series)


def identify_module(
    kind: str, runs: list[ModuleRun], cells_in_series: int, cells_in_parallel: int, rest_A: float = 0.0
) -> ModuleModel:
    """Identify one module model by least squares on the module's voltage.

    Parameters
    ----------
    kind : one of KINDS; S1 has nothing to identify
    runs : module data with the cell model's voltage
    cells_in_series, cells_in_parallel : layout
    rest_A : currents up to this count as rest

    Returns
    -------
    ModuleModel
        With standard deviations that allow for residuals that hang together in time.

    Raises
    ------
    NotIdentifiableError
        The current does not tell resistance and offset apart, or a direction is missing.
    """
    model = ModuleModel(kind, cells_in_series, cells_in_parallel, rest_A=rest_A)
    if kind == "S1":
        return model
    current = np.concatenate([run.current_A for run in runs])
    error = np.concatenate([run.voltage_V - cells_in_series * run.cell_voltage_V for run in runs])
    owner = np.repeat(np.arange(len(runs)), [len(run.current_A) for run in runs])
    known = np.isfinite(error) & np.isfinite(current)
    current, error, owner = current[known], error[known], owner[known]
    x = _regressors(kind, current, rest_A)
    _check_determined(kind, x, current, rest_A)
    parameters = np.linalg.lstsq(x, error, rcond=None)[0]
    starts = tuple(np.unique(owner, return_index=True)[1].tolist())
    std = np.sqrt(np.diag(least_squares_covariance(x, error - x @ parameters, starts)))
    resistance, offset = _as_pairs(kind, parameters)
    resistance_std, offset_std = _as_pairs(kind, std)
    return replace(
        model,
        resistance_Ohm=resistance,
        offset_V=offset,
        resistance_std_Ohm=resistance_std,
        offset_std_V=offset_std,
    )


def compare_module_models(
    train: list[ModuleRun],
    cells_in_series: int,
    cells_in_parallel: int,
    *,
    validate: list[ModuleRun] | None = None,
    rest_A: float = 0.0,
) -> ModuleComparison:
    """Identify all four module models and compare their errors.

    Parameters
    ----------
    train : runs that R and V_0 are identified from
    cells_in_series, cells_in_parallel : layout
    validate : runs that only judge
    rest_A : currents up to this count as rest

    Returns
    -------
    ModuleComparison
        A model that the data do not determine is left out, with the reason among the reservations.
    """
    if not train:
        raise ModelError("module models: no run was given")
    models, reservations = {}, []
    for kind in KINDS:
        try:
            models[kind] = identify_module(kind, train, cells_in_series, cells_in_parallel, rest_A)
        except NotIdentifiableError as reason:
            reservations.append(str(reason))
    return ModuleComparison(
        models=models,
        train={kind: _figures(model, train) for kind, model in models.items()},
        validation={kind: _figures(model, validate) for kind, model in models.items()} if validate else {},
        reservations=tuple(reservations),
    )


def _figures(model: ModuleModel, runs: list[ModuleRun]) -> Metrics:
    simulated = [model.voltage_V(run.cell_voltage_V, run.current_A) for run in runs]
    return metrics(np.concatenate([run.voltage_V for run in runs]), np.concatenate(simulated))


def _regressors(kind: str, current_A: FloatArray, rest_A: float) -> FloatArray:
    """Columns of resistance, then offset; in S4 charge before rest or discharge."""
    if kind == "S2":
        return current_A[:, None]
    if kind == "S3":
        return np.column_stack([current_A, np.ones_like(current_A)])
    charge = (current_A > rest_A).astype(np.float64)
    return np.column_stack([charge * current_A, (1.0 - charge) * current_A, charge, 1.0 - charge])


def _as_pairs(kind: str, values: FloatArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """Resistance and offset, each for charge and for rest or discharge."""
    v = [float(value) for value in values]
    if kind == "S4":
        return (v[0], v[1]), (v[2], v[3])
    offset = v[1] if kind == "S3" else 0.0
    return (v[0], v[0]), (offset, offset)


def _check_determined(kind: str, x: FloatArray, current_A: FloatArray, rest_A: float) -> None:
    """Refuse data that leave R or V_0 open.

    Raises
    ------
    NotIdentifiableError
    """
    if len(current_A) < _LEAST_SAMPLES:
        raise NotIdentifiableError(f"{kind}: {len(current_A)} usable sample(s); at least {_LEAST_SAMPLES} are needed")
    charge = current_A > rest_A
    parts = {"": np.ones(len(current_A), bool)}
    if kind == "S4":
        parts = {" while charging": charge, " while resting or discharging": ~charge}
    for where, chosen in parts.items():
        if chosen.sum() < _LEAST_SAMPLES:
            raise NotIdentifiableError(f"{kind}: only {int(chosen.sum())} sample(s){where}; record both directions")
        columns = x[chosen][:, np.any(x[chosen] != 0.0, axis=0)]
        scale = np.linalg.norm(columns, axis=0)
        expected = x.shape[1] // len(parts)
        if columns.shape[1] < expected or np.linalg.cond(columns / scale) > _WORST_CONDITION:
            raise NotIdentifiableError(
                f"{kind}: the module's current{where} is {np.ptp(current_A[chosen]):g} A wide: resistance"
                f"{'' if kind == 'S2' else ' and offset'} cannot be told from it. Record pulses of several sizes"
            )
