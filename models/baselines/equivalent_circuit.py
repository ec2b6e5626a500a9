"""Equivalent circuit: open-circuit voltage, series resistance and one or two resistors beside capacitors, in tables.

v = OCV(soc, T) + R0(soc, T) i + sum_j R_j(soc, T) i_j,   tau_j(T) di_j/dt = i - i_j

with positive current charging. i_j is the current through the resistor of branch j (Plett, Battery Management Systems
I, 2015, ch. 2): a state that does not depend on the resistances, so all tables enter the voltage linearly.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.baselines.circuit_problem import Layout
from models.baselines.circuit_record import CircuitRecord, circuit_record
from models.baselines.documents import array, check_kind, read_cell, read_step_s, reading
from models.baselines.recursions import branch_drive, state
from models.baselines.samples import Samples, gather
from models.baselines.tables import Table, check_knots, locate
from models.baselines.variable_projection import fit
from models.data.errors import ModelError, StructureError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray, TimeSeries
from models.network.free_run import LONGEST_MEMORY_S, MEMORY_OF_FILTERS, free_run_V, memory_s
from models.network.regression import CellContext
from models.network.signals import soc_by_counting

KIND = "equivalent_circuit"
SCHEMA_VERSION = 1
_OCV_KNOTS = 51
_RESISTANCE_KNOTS = 11
_TEMPERATURE_SPACING_K = 10.0
_MOST_TEMPERATURES = 6


@dataclass(frozen=True)
class Branches:
    """Resistors beside capacitors.

    Attributes
    ----------
    resistances_Ohm : one table for each
    temperature_degC : (T,) knots of the time constants; their logarithm is linear in between
    time_constants_s : (n, T)
    """

    resistances_Ohm: tuple[Table, ...]
    temperature_degC: FloatArray
    time_constants_s: FloatArray

    def __post_init__(self) -> None:
        """Check knots, shapes and signs."""
        check_knots("temperature_degC", self.temperature_degC)
        expected = (len(self.resistances_Ohm), len(self.temperature_degC))
        if self.time_constants_s.shape != expected or not (self.time_constants_s > 0.0).all():
            raise StructureError(f"time constants must be positive and of shape {expected}")

    @property
    def needs_temperature(self) -> bool:
        """Whether a resistance or a time constant depends on temperature."""
        return len(self.temperature_degC) > 1 or any(table.needs_temperature for table in self.resistances_Ohm)

    def currents_A(
        self, current_A: FloatArray, temperature_degC: FloatArray, dt_s: float, starts: np.ndarray
    ) -> list[FloatArray]:
        """(N,) current through each resistor; zero at each part's start."""
        drive = branch_drive(current_A, dt_s, starts)
        where = locate(self.temperature_degC, temperature_degC)
        return [state(drive, -np.log(row), where) for row in self.time_constants_s]

    def voltage_V(self, currents_A: list[FloatArray], soc: FloatArray, temperature_degC: FloatArray) -> FloatArray:
        """(N,) sum of the voltages."""
        out = np.zeros(len(soc))
        for table, current in zip(self.resistances_Ohm, currents_A, strict=True):
            out += table.at(soc, temperature_degC) * current
        return out

    def to_json(self) -> dict[str, Any]:
        """Return plain types."""
        return {
            "resistances_Ohm": [table.to_json() for table in self.resistances_Ohm],
            "temperature_degC": self.temperature_degC.tolist(),
            "time_constants_s": self.time_constants_s.tolist(),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Branches:
        """Read what `to_json` wrote."""
        tables = tuple(Table.from_json(part) for part in document["resistances_Ohm"])
        knots = array(document["temperature_degC"])
        return cls(tables, knots, array(document["time_constants_s"]).reshape(len(tables), len(knots)))


@dataclass(frozen=True)
class EquivalentCircuit:
    """An equivalent circuit.

    Attributes
    ----------
    ocv_V, r0_Ohm : tables over state of charge and temperature
    branches : resistors beside capacitors
    cell : capacity, efficiency, rest current
    dt_s : step of the grid that it was made on; it runs on any
    record : what it was made from and how well it did
    """

    ocv_V: Table
    r0_Ohm: Table
    branches: Branches
    cell: CellContext
    dt_s: float
    record: CircuitRecord = field(default_factory=CircuitRecord)

    @property
    def name(self) -> str:
        """What a person calls it, such as "2RC"."""
        return f"{len(self.branches.resistances_Ohm)}RC"

    @property
    def needs_temperature(self) -> bool:
        """Whether a parameter depends on temperature."""
        return self.ocv_V.needs_temperature or self.r0_Ohm.needs_temperature or self.branches.needs_temperature

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types with its schema version."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": KIND,
            "dt_s": self.dt_s,
            "cell": {"capacity_Ah": self.cell.capacity_Ah, "efficiency": self.cell.efficiency},
            "ocv_V": self.ocv_V.to_json(),
            "r0_Ohm": self.r0_Ohm.to_json(),
            "branches": self.branches.to_json(),
            "record": self.record.to_json(),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> EquivalentCircuit:
        """Read what `to_json` wrote.

        Raises
        ------
        StructureError
            The document is no equivalent circuit, of another schema version, or damaged.
        """
        check_kind(document, KIND, SCHEMA_VERSION)
        with reading(KIND):
            return cls(
                ocv_V=Table.from_json(document["ocv_V"]),
                r0_Ohm=Table.from_json(document["r0_Ohm"]),
                branches=Branches.from_json(document["branches"]),
                cell=read_cell(document),
                dt_s=read_step_s(document),
                record=CircuitRecord.from_json(document.get("record", {})),
            )


@free_run_V.register
def _(model: EquivalentCircuit, run: GridRun, initial_soc: float) -> FloatArray:
    """Simulate a run from its current and temperature alone, from rest."""
    temperature = known_temperature_degC(run, model.needs_temperature)
    soc = soc_by_counting(run.charge_Ah, initial_soc, model.cell.capacity_Ah, model.cell.efficiency)
    starts = np.array(run.segment_starts, dtype=np.int64)
    currents_A = model.branches.currents_A(run.current_A, temperature, run.dt_s, starts)
    ohmic = model.r0_Ohm.at(soc, temperature) * run.current_A
    return model.ocv_V.at(soc, temperature) + ohmic + model.branches.voltage_V(currents_A, soc, temperature)


@memory_s.register
def _(model: EquivalentCircuit) -> float:
    return min(MEMORY_OF_FILTERS * float(model.branches.time_constants_s.max(initial=0.0)), LONGEST_MEMORY_S)


def fit_equivalent_circuit(
    train: list[TimeSeries],
    *,
    capacity_Ah: float,
    n_branches: int = 2,
    initial_soc: list[float] | None = None,
    dt_s: float | None = None,
) -> EquivalentCircuit:
    """Fit an equivalent circuit on the free-run error.

    Parameters
    ----------
    train : runs that the circuit is made from
    capacity_Ah : cell capacity
    n_branches : resistors beside capacitors, 1 or 2
    initial_soc : fraction at the start of each run; by default its first `soc_ref`
    dt_s : grid step; by default the typical interval of the runs

    Raises
    ------
    NotIdentifiableError
        The data cannot determine the circuit; the message names what is missing in physical words.
    ModelError
        Bad capacity or number of branches, no run, or no initial state of charge.
    """
    if n_branches not in (1, 2):
        raise ModelError(f"{n_branches} branches; an equivalent circuit has 1 or 2")
    samples = gather(train, capacity_Ah, initial_soc, dt_s)
    temperature = samples.temperature_knots_degC(_TEMPERATURE_SPACING_K, _MOST_TEMPERATURES)
    layout = Layout(
        ocv_soc=soc_knots(samples, _OCV_KNOTS),
        ocv_degC=temperature,
        resistance_soc=soc_knots(samples, _RESISTANCE_KNOTS),
        temperature_degC=temperature,
        n_branches=n_branches,
        hysteresis=False,
    )
    found = fit(samples, layout)
    branches = Branches(found.resistances_Ohm, temperature, found.time_constants_s)
    return EquivalentCircuit(
        found.ocv_V, found.r0_Ohm, branches, samples.cell, samples.dt_s, circuit_record(samples, found)
    )


def soc_knots(samples: Samples, n: int) -> FloatArray:
    """Knots over 0..1, and beyond where the counted charge goes beyond."""
    return np.linspace(min(0.0, float(samples.soc.min())), max(1.0, float(samples.soc.max())), n)


def known_temperature_degC(run: GridRun, needed: bool) -> FloatArray:
    """Return the run's temperature; any will do where it is not needed.

    Raises
    ------
    StructureError
        It is needed, and was not measured.
    """
    if not np.isnan(run.temperature_degC).any():
        return run.temperature_degC
    if needed:
        raise StructureError(f"{run.name}: no temperature was measured, but the circuit's tables depend on it")
    return np.full(len(run), 25.0)
