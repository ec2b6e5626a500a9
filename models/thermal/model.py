"""Lumped heat balance of a cell: one node, or a core inside a surface.

Eq. 2.24 of the method, c_p dT/dt = h (T_ambient - T) + heat, with heat = I^2 R or I (V - U) and, where asked for, the
reversible part I T dU/dT (Bernardi, Pawlikowski and Newman, J. Electrochem. Soc. 132, 1985; positive current charges).
Heat and ambient temperature are held over each step, for which the step is exact at any length.

Slow polarisation stores energy and releases it later: a pair of resistance R_p and time constant tau, through which the
low-passed current i_p flows, dissipates R_p i_p^2, while I (V - U) counts R_p I i_p and a settled resistance counts
R_p I^2. The difference is a third part of the heat. Left out, it is taken for heat capacity: 3 to 5 % too much on
simulated cells with I (V - U); with settled resistances, heat capacity and transfer come out 25 to 45 % too large.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.linalg import expm

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.signals import KELVIN
from models.network.signals.filters import low_pass
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class ThermalModel:
    """Heat capacities and transfers.

    Attributes
    ----------
    heat_capacity_J_per_K : of the whole cell, or of its core where there is a surface
    heat_transfer_W_per_K : from the cell, or its surface, to the ambient
    surface_heat_capacity_J_per_K, core_to_surface_W_per_K : of the second node, both or neither
    dU_dT_V_per_K, dU_dT_soc : entropic coefficient and the SoC of its values; one value: the same everywhere
    polarisation_Ohm, polarisation_s : resistance and time constant of the polarisation whose heat comes later
    std : standard deviations by the names of the parameters, where they were identified
    record : what the model was made from; plain types
    """

    heat_capacity_J_per_K: float
    heat_transfer_W_per_K: float
    surface_heat_capacity_J_per_K: float | None = None
    core_to_surface_W_per_K: float | None = None
    dU_dT_V_per_K: tuple[float, ...] = (0.0,)
    dU_dT_soc: tuple[float, ...] = (0.5,)
    polarisation_Ohm: float = 0.0
    polarisation_s: float = 600.0
    std: dict[str, float] = field(default_factory=dict)
    record: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the parameters once."""
        if (self.surface_heat_capacity_J_per_K is None) != (self.core_to_surface_W_per_K is None):
            raise ModelError("thermal model: a surface needs both its heat capacity and its transfer from the core")
        positive = (
            self.heat_capacity_J_per_K,
            self.surface_heat_capacity_J_per_K,
            self.core_to_surface_W_per_K,
            self.polarisation_s,
        )
        if any(value is not None and not value > 0.0 for value in positive) or not self.heat_transfer_W_per_K >= 0.0:
            raise ModelError("thermal model: heat capacities, transfers and time constants must be positive")
        if len(self.dU_dT_soc) != len(self.dU_dT_V_per_K) or (np.diff(self.dU_dT_soc) <= 0.0).any():
            raise ModelError("thermal model: one entropic coefficient is needed for each SoC, and the SoC must rise")

    @property
    def n_nodes(self) -> int:
        """1, or 2 with a surface."""
        return 1 if self.surface_heat_capacity_J_per_K is None else 2

    def entropic_V_per_K(self, soc: ArrayLike) -> FloatArray:
        """Entropic coefficient at given SoC in V/K."""
        return np.interp(np.asarray(soc, np.float64), self.dU_dT_soc, self.dU_dT_V_per_K)

    def discrete(self, dt_s: float) -> tuple[FloatArray, FloatArray]:
        """Exact step over `dt_s` for held inputs.

        Returns
        -------
        (n, n) and (n, 2)
            T(k) = A T(k-1) + B [heat in W, ambient temperature in degC], nodes from the core outwards.
        """
        n = self.n_nodes
        whole = expm(dt_s * self.continuous())
        return np.ascontiguousarray(whole[:n, :n]), np.ascontiguousarray(whole[:n, n:])

    def continuous(self) -> FloatArray:
        """(n + 2, n + 2) matrix of the heat balance with its two inputs as states that stay as they are."""
        c, h = self.heat_capacity_J_per_K, self.heat_transfer_W_per_K
        if self.surface_heat_capacity_J_per_K is None or self.core_to_surface_W_per_K is None:
            return np.array([[-h / c, 1.0 / c, h / c], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        s, k = self.surface_heat_capacity_J_per_K, self.core_to_surface_W_per_K
        core, surface = [-k / c, k / c, 1.0 / c, 0.0], [k / s, -(k + h) / s, 0.0, h / s]
        return np.array([core, surface, [0.0] * 4, [0.0] * 4])

    def simulate(
        self,
        heat_W: FloatArray,
        ambient_degC: FloatArray,
        dt_s: float,
        initial_degC: float,
        current_A: FloatArray | None = None,
        soc: FloatArray | None = None,
    ) -> FloatArray:
        """Temperatures over a run from its heat.

        Parameters
        ----------
        heat_W : (N,) without the reversible part; heat_W[k] is released from sample k-1 to sample k
        ambient_degC : (N,)
        dt_s : sampling time
        initial_degC : of all nodes at the first sample
        current_A, soc : (N,) for the reversible heat; without them there is none

        Returns
        -------
        (N, n)
            In degC, nodes from the core outwards; the last is what a sensor on the case reads.
        """
        a, b = self.discrete(dt_s)
        entropic_W_per_K = np.zeros(len(heat_W))
        if current_A is not None and soc is not None:
            entropic_W_per_K = current_A * self.entropic_V_per_K(soc)
        return run_heat_balance(a, b, heat_W, entropic_W_per_K, ambient_degC, np.full(self.n_nodes, initial_degC))

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "thermal_model",
            "heat_capacity_J_per_K": self.heat_capacity_J_per_K,
            "heat_transfer_W_per_K": self.heat_transfer_W_per_K,
            "surface_heat_capacity_J_per_K": self.surface_heat_capacity_J_per_K,
            "core_to_surface_W_per_K": self.core_to_surface_W_per_K,
            "dU_dT_V_per_K": list(self.dU_dT_V_per_K),
            "dU_dT_soc": list(self.dU_dT_soc),
            "polarisation_Ohm": self.polarisation_Ohm,
            "polarisation_s": self.polarisation_s,
            "std": dict(self.std),
            "record": self.record,
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> ThermalModel:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no thermal model, or damaged.
        """
        if not isinstance(document, dict) or document.get("kind") != "thermal_model":
            raise ModelError("not a thermal model")
        if document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not a thermal model of schema version {SCHEMA_VERSION}")
        fields = {key: value for key, value in document.items() if key not in ("schema_version", "kind")}
        try:
            for key in ("dU_dT_V_per_K", "dU_dT_soc"):
                fields[key] = tuple(float(value) for value in fields[key])
            return cls(**fields)
        except (KeyError, TypeError) as error:
            raise ModelError(f"thermal model is damaged: {error!r}") from None


def losses_W(run: GridRun, soc: FloatArray, table: ResistanceTable | OcvTable) -> FloatArray:
    """Irreversible heat of a run, polarisation counted at once.

    Parameters
    ----------
    run : with current and cell temperature; with voltage where the table is one of open-circuit voltage
    soc : (n,) fraction
    table : a resistance table gives I^2 R; an open-circuit table I (V - U) with U the mean of the voltages after charge
        and after discharge, so that hysteresis counts as loss

    Returns
    -------
    (n,) in W; a missing voltage is bridged by the overpotential on either side
    """
    if isinstance(table, ResistanceTable):
        return run.current_A**2 * table.at(soc, run.current_A, run.temperature_degC)
    overpotential = run.voltage_V - table.at(soc, run.temperature_degC)
    known = np.isfinite(overpotential)
    if not known.any():
        raise ModelError(f"{run.name}: no voltage was measured; heat from the overpotential needs one")
    return run.current_A * np.interp(run.time_s, run.time_s[known], overpotential[known])


def polarisation_W_per_Ohm(
    current_A: FloatArray, time_constant_s: float, dt_s: float, table: ResistanceTable | OcvTable
) -> FloatArray:
    """(n,) heat that polarisation releases less what a table counts for it, for a resistance of 1 ohm.

    Parameters
    ----------
    current_A : (n,)
    time_constant_s : of the polarisation
    dt_s : sampling time
    table : that the losses come from
    """
    through = low_pass(current_A, time_constant_s, dt_s)
    return through**2 - current_A * (current_A if isinstance(table, ResistanceTable) else through)


@njit(cache=True)
def run_heat_balance(
    a: np.ndarray,
    b: np.ndarray,
    heat_W: np.ndarray,
    entropic_W_per_K: np.ndarray,
    ambient_degC: np.ndarray,
    initial_degC: np.ndarray,
) -> np.ndarray:
    """Solve T(k) = A T(k-1) + B [heat(k) + entropic(k) T_core(k-1), ambient(k)].

    Parameters
    ----------
    a, b : (n, n), (n, 2) exact step
    heat_W : (N,) irreversible heat
    entropic_W_per_K : (N,) I dU/dT, times the core's absolute temperature
    ambient_degC : (N,)
    initial_degC : (n,)

    Returns
    -------
    (N, n) in degC
    """
    n_samples, n = heat_W.shape[0], initial_degC.shape[0]
    out = np.empty((n_samples, n))
    out[0] = initial_degC
    for k in range(1, n_samples):
        heat = heat_W[k] + entropic_W_per_K[k] * (out[k - 1, 0] + KELVIN)
        for i in range(n):
            total = b[i, 0] * heat + b[i, 1] * ambient_degC[k]
            for j in range(n):
                total += a[i, j] * out[k - 1, j]
            out[k, i] = total
    return out
