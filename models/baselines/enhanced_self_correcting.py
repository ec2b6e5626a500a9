"""Plett's enhanced self-correcting (ESC) cell model.

v = OCV(soc, T) + M0(T) s + M(T) h + R0(T) i + sum_j R_j(T) i_j,   tau_j(T) di_j/dt = i - i_j
dh/dt = gamma(T) |i| / Q (s - h)

with positive current charging, s the direction of the last current and OCV linear in temperature (Plett, Battery
Management Systems I: Battery Modeling, 2015, ch. 2). All parameters but the open-circuit
voltage are tables over temperature alone.

It is fitted here on the free-run error, open-circuit voltage and all, rather than stage by stage from tests of their
own as there: for given time constants and gamma the voltage is linear in everything else.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.baselines.circuit_problem import Layout
from models.baselines.circuit_record import CircuitRecord, circuit_record
from models.baselines.documents import array, check_kind, read_cell, read_step_s, reading
from models.baselines.equivalent_circuit import Branches, known_temperature_degC, soc_knots
from models.baselines.recursions import direction, hysteresis_drive, state
from models.baselines.samples import check_both_directions, gather
from models.baselines.tables import Table, check_knots, locate
from models.baselines.variable_projection import fit
from models.data.errors import ModelError, StructureError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray, TimeSeries
from models.network.free_run import free_run_V
from models.network.regression import CellContext
from models.network.signals import soc_by_counting

KIND = "enhanced_self_correcting"
SCHEMA_VERSION = 1
_OCV_KNOTS = 51
_TEMPERATURE_SPACING_K = 10.0
_MOST_TEMPERATURES = 6
_MOST_BRANCHES = 5


@dataclass(frozen=True)
class Hysteresis:
    """One-state hysteresis with a jump.

    Attributes
    ----------
    amplitude_V : table of M over temperature; half the width of the major loop
    jump_V : table of M0 over temperature; moves at once with the direction
    temperature_degC : (T,) knots of gamma; its logarithm is linear in between
    gamma : (T,) rate: the state comes within 1/e of its end after 1 / gamma of the capacity
    """

    amplitude_V: Table
    jump_V: Table
    temperature_degC: FloatArray
    gamma: FloatArray

    def __post_init__(self) -> None:
        """Check knots, shape and sign."""
        check_knots("temperature_degC", self.temperature_degC)
        if self.gamma.shape != self.temperature_degC.shape or not (self.gamma > 0.0).all():
            raise StructureError(f"gamma must be positive, one for each of {len(self.temperature_degC)} temperatures")

    def state(self, current_A: FloatArray, temperature_degC: FloatArray, dt_s: float, cell: CellContext) -> FloatArray:
        """(N,) hysteresis state h in -1..1 over one run, from 0."""
        drive = hysteresis_drive(current_A, dt_s, cell.capacity_Ah, cell.rest_A, _ONE_PART)
        return state(drive, np.log(self.gamma), locate(self.temperature_degC, temperature_degC))

    def voltage_V(
        self, current_A: FloatArray, temperature_degC: FloatArray, dt_s: float, cell: CellContext
    ) -> FloatArray:
        """(N,) M h + M0 s over one run."""
        h = self.state(current_A, temperature_degC, dt_s, cell)
        s = direction(current_A, cell.rest_A, _ONE_PART)
        return self.amplitude_V.at(0.5, temperature_degC) * h + self.jump_V.at(0.5, temperature_degC) * s

    def to_json(self) -> dict[str, Any]:
        """Return plain types."""
        return {
            "amplitude_V": self.amplitude_V.to_json(),
            "jump_V": self.jump_V.to_json(),
            "temperature_degC": self.temperature_degC.tolist(),
            "gamma": self.gamma.tolist(),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Hysteresis:
        """Read what `to_json` wrote."""
        return cls(
            Table.from_json(document["amplitude_V"]),
            Table.from_json(document["jump_V"]),
            array(document["temperature_degC"]),
            array(document["gamma"]),
        )


# A run is one part for hysteresis: a gap in the log lets relaxation die out, but not this.
_ONE_PART = np.zeros(1, dtype=np.int64)


@dataclass(frozen=True)
class EnhancedSelfCorrecting:
    """Plett's ESC model.

    Attributes
    ----------
    ocv_V : table over state of charge and temperature
    r0_Ohm : table over temperature
    branches : resistors beside capacitors, tables over temperature
    hysteresis : M, M0 and gamma
    cell : capacity, efficiency, rest current
    dt_s : step of the grid that it was made on; it runs on any
    record : what it was made from and how well it did
    """

    ocv_V: Table
    r0_Ohm: Table
    branches: Branches
    hysteresis: Hysteresis
    cell: CellContext
    dt_s: float
    record: CircuitRecord = field(default_factory=CircuitRecord)

    @property
    def name(self) -> str:
        """What a person calls it, such as "ESC 3RC"."""
        return f"ESC {len(self.branches.resistances_Ohm)}RC"

    @property
    def needs_temperature(self) -> bool:
        """Whether a parameter depends on temperature."""
        tables = (self.ocv_V, self.r0_Ohm, self.hysteresis.amplitude_V, self.hysteresis.jump_V)
        rates = len(self.hysteresis.temperature_degC) > 1
        return self.branches.needs_temperature or rates or any(table.needs_temperature for table in tables)

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
            "hysteresis": self.hysteresis.to_json(),
            "record": self.record.to_json(),
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> EnhancedSelfCorrecting:
        """Read what `to_json` wrote.

        Raises
        ------
        StructureError
            The document is no ESC model, of another schema version, or damaged.
        """
        check_kind(document, KIND, SCHEMA_VERSION)
        with reading(KIND):
            return cls(
                ocv_V=Table.from_json(document["ocv_V"]),
                r0_Ohm=Table.from_json(document["r0_Ohm"]),
                branches=Branches.from_json(document["branches"]),
                hysteresis=Hysteresis.from_json(document["hysteresis"]),
                cell=read_cell(document),
                dt_s=read_step_s(document),
                record=CircuitRecord.from_json(document.get("record", {})),
            )


@free_run_V.register
def _(model: EnhancedSelfCorrecting, run: GridRun, initial_soc: float) -> FloatArray:
    """Simulate a run from its current and temperature alone, from rest and in the middle of the hysteresis loop."""
    temperature = known_temperature_degC(run, model.needs_temperature)
    soc = soc_by_counting(run.charge_Ah, initial_soc, model.cell.capacity_Ah, model.cell.efficiency)
    starts = np.array(run.segment_starts, dtype=np.int64)
    currents_A = model.branches.currents_A(run.current_A, temperature, run.dt_s, starts)
    out = model.ocv_V.at(soc, temperature) + model.r0_Ohm.at(soc, temperature) * run.current_A
    out += model.branches.voltage_V(currents_A, soc, temperature)
    return out + model.hysteresis.voltage_V(run.current_A, temperature, run.dt_s, model.cell)


def fit_enhanced_self_correcting(
    train: list[TimeSeries],
    *,
    capacity_Ah: float,
    n_branches: int = 3,
    initial_soc: list[float] | None = None,
    dt_s: float | None = None,
) -> EnhancedSelfCorrecting:
    """Fit Plett's ESC model on the free-run error.

    Parameters
    ----------
    train : runs that the model is made from
    capacity_Ah : cell capacity
    n_branches : resistors beside capacitors, 1..5
    initial_soc : fraction at the start of each run; by default its first `soc_ref`
    dt_s : grid step; by default the typical interval of the runs

    Raises
    ------
    NotIdentifiableError
        The data cannot determine the model, such as hysteresis where the current never turns; the message names what
        is missing in physical words.
    ModelError
        Bad capacity or number of branches, no run, or no initial state of charge.
    """
    if not 1 <= n_branches <= _MOST_BRANCHES:
        raise ModelError(f"{n_branches} branches; 1..{_MOST_BRANCHES} can be fitted")
    samples = gather(train, capacity_Ah, initial_soc, dt_s)
    check_both_directions(samples)
    temperature = samples.temperature_knots_degC(_TEMPERATURE_SPACING_K, _MOST_TEMPERATURES)
    layout = Layout(
        ocv_soc=soc_knots(samples, _OCV_KNOTS),
        # Two temperatures: the model's open-circuit voltage is linear in temperature.
        ocv_degC=temperature[[0, -1]] if len(temperature) > 1 else temperature,
        resistance_soc=np.array([0.5]),
        temperature_degC=temperature,
        n_branches=n_branches,
        hysteresis=True,
    )
    found = fit(samples, layout)
    assert found.hysteresis_V is not None and found.jump_V is not None and found.gamma is not None
    return EnhancedSelfCorrecting(
        ocv_V=found.ocv_V,
        r0_Ohm=found.r0_Ohm,
        branches=Branches(found.resistances_Ohm, temperature, found.time_constants_s),
        hysteresis=Hysteresis(found.hysteresis_V, found.jump_V, temperature, found.gamma),
        cell=samples.cell,
        dt_s=samples.dt_s,
        record=circuit_record(samples, found),
    )
