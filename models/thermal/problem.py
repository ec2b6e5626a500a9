"""The simulation error of a heat balance and its exact derivatives to all unknowns."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import expm_frechet

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.signals import KELVIN
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable
from models.thermal.model import ThermalModel, losses_W, polarisation_W_per_Ohm

ENTROPIC, POLARISATION = "dU_dT_V_per_K", "polarisation_Ohm"
# These may take either sign; all others are positive and sought as logarithms.
SIGNED = (ENTROPIC, POLARISATION)


class ThermalProblem:
    """Unknowns x: logarithms of positive parameters, then those of either sign, then each run's first temperature.

    Parameters
    ----------
    runs, soc : measured runs with the SoC of each
    losses : table that their heat comes from
    names : parameters to identify, positive ones first
    guess : first guess, and the values of all that is not identified

    Raises
    ------
    ModelError
        The heat is not finite everywhere.
    """

    def __init__(
        self,
        runs: list[GridRun],
        soc: list[FloatArray],
        losses: ResistanceTable | OcvTable,
        names: tuple[str, ...],
        guess: ThermalModel,
    ) -> None:
        self.runs, self.soc, self.names, self.guess = runs, soc, names, guess
        self._heat_W = [losses_W(run, s, losses) for run, s in zip(runs, soc, strict=True)]
        if not all(np.isfinite(heat).all() for heat in self._heat_W):
            raise ModelError("thermal model: the table of losses has points at which the network does not settle")
        tau = guess.polarisation_s
        self._late = [polarisation_W_per_Ohm(run.current_A, tau, run.dt_s, losses) for run in runs]

    def start(self) -> FloatArray:
        """Unknowns of the first guess."""
        signed = {ENTROPIC: self.guess.dU_dT_V_per_K[0], POLARISATION: self.guess.polarisation_Ohm}
        first = [float(np.median(run.temperature_degC[:5])) for run in self.runs]
        return np.array([*(signed[n] if n in SIGNED else np.log(getattr(self.guess, n)) for n in self.names), *first])

    def values(self, x: FloatArray) -> dict[str, float]:
        """Parameters by name in their units."""
        return {n: float(v if n in SIGNED else np.exp(v)) for n, v in zip(self.names, x, strict=False)}

    def model(self, x: FloatArray) -> ThermalModel:
        """Thermal model that the unknowns stand for."""
        values = self.values(x)
        entropic = values.pop(ENTROPIC, None)
        changed = replace(self.guess, **values)
        return changed if entropic is None else replace(changed, dU_dT_V_per_K=(entropic,))

    def simulated(self, x: FloatArray) -> list[FloatArray]:
        """Temperature at the case of each run in degC."""
        model = self.model(x)
        return [self._nodes(model, i, x[len(self.names) + i])[:, -1] for i in range(len(self.runs))]

    def residual(self, x: FloatArray) -> FloatArray:
        """(N,) measured minus simulated temperature of all runs in K."""
        pairs = zip(self.runs, self.simulated(x), strict=True)
        return np.concatenate([run.temperature_degC - simulated for run, simulated in pairs])

    def linearised(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Residual, and the derivatives of the simulated temperature to the unknowns."""
        model, n_names = self.model(x), len(self.names)
        residuals, blocks = [], []
        for i, run in enumerate(self.runs):
            nodes = self._nodes(model, i, x[n_names + i])
            own = self._sensitivities(model, i, nodes)
            jacobian = np.zeros((len(run), len(x)))
            jacobian[:, :n_names], jacobian[:, n_names + i] = own[:, :-1], own[:, -1]
            residuals.append(run.temperature_degC - nodes[:, -1])
            blocks.append(jacobian)
        return np.concatenate(residuals), np.vstack(blocks)

    def _nodes(self, model: ThermalModel, i: int, first_degC: float) -> FloatArray:
        run = self.runs[i]
        assert run.ambient_degC is not None
        heat = self._heat_W[i] + model.polarisation_Ohm * self._late[i]
        return model.simulate(heat, run.ambient_degC, run.dt_s, float(first_degC), run.current_A, self.soc[i])

    def _sensitivities(self, model: ThermalModel, i: int, nodes: FloatArray) -> FloatArray:
        """(N, P + 1) derivatives of the outermost node to the parameters and the first temperature."""
        run, n = self.runs[i], model.n_nodes
        assert run.ambient_degC is not None
        a, b = model.discrete(run.dt_s)
        moved = np.zeros((len(self.names), n + 2, n + 2))
        slope = np.zeros((len(self.names), len(run)))
        absolute = np.concatenate([[0.0], nodes[:-1, 0] + KELVIN])
        for j, name in enumerate(self.names):
            if name == ENTROPIC:
                slope[j] = run.current_A * absolute
            elif name == POLARISATION:
                slope[j] = self._late[i]
            else:
                direction = run.dt_s * _log_derivative(model, name)
                moved[j] = expm_frechet(run.dt_s * model.continuous(), direction, compute_expm=False)
        entropic = run.current_A * model.entropic_V_per_K(self.soc[i])
        heat = self._heat_W[i] + model.polarisation_Ohm * self._late[i] + entropic * absolute
        da, db = np.ascontiguousarray(moved[:, :n, :n]), np.ascontiguousarray(moved[:, :n, n:])
        return _run_sensitivities(_Transition(a, b, da, db), slope, entropic, nodes, heat, run.ambient_degC)


def _log_derivative(model: ThermalModel, name: str) -> FloatArray:
    """Derivative of the continuous heat balance to the logarithm of a parameter."""
    matrix = model.continuous()
    rows = {"heat_capacity_J_per_K": 0, "surface_heat_capacity_J_per_K": 1}
    out = np.zeros_like(matrix)
    if name in rows:
        out[rows[name]] = -matrix[rows[name]]
        return out
    n, value = model.n_nodes, float(getattr(model, name))
    if name == "core_to_surface_W_per_K":
        c, s = model.heat_capacity_J_per_K, model.surface_heat_capacity_J_per_K
        assert s is not None
        out[:2, :2] = value * np.array([[-1.0 / c, 1.0 / c], [1.0 / s, -1.0 / s]])
        return out
    outer = model.heat_capacity_J_per_K if n == 1 else model.surface_heat_capacity_J_per_K
    assert outer is not None
    out[n - 1, n - 1], out[n - 1, n + 1] = -value / outer, value / outer
    return out


class _Transition(NamedTuple):
    """Step of the nodes' temperatures over one sample, and its derivatives to the parameters."""

    a: np.ndarray  # (n, n) of the nodes
    b: np.ndarray  # (n, 2) of heat and ambient temperature
    da: np.ndarray  # (P, n, n)
    db: np.ndarray  # (P, n, 2)


@njit(cache=True)
def _run_sensitivities(
    transition: _Transition,
    heat_slope: np.ndarray,
    entropic_W_per_K: np.ndarray,
    nodes: np.ndarray,
    heat_W: np.ndarray,
    ambient_degC: np.ndarray,
) -> np.ndarray:
    """(N, P + 1) derivatives of the outermost node; `heat_slope` (P, N) is the heat's own derivative."""
    a, b, da, db = transition
    n_samples, n = nodes.shape
    n_params = da.shape[0]
    out = np.zeros((n_samples, n_params + 1))
    s, moved = np.zeros((n_params + 1, n)), np.zeros(n)
    s[n_params, :] = 1.0
    out[0, n_params] = 1.0
    for k in range(1, n_samples):
        for p in range(n_params + 1):
            heat_moves = entropic_W_per_K[k] * s[p, 0]
            if p < n_params:
                heat_moves += heat_slope[p, k]
            for i in range(n):
                total = b[i, 0] * heat_moves
                for j in range(n):
                    total += a[i, j] * s[p, j]
                if p < n_params:
                    total += db[p, i, 0] * heat_W[k] + db[p, i, 1] * ambient_degC[k]
                    for j in range(n):
                        total += da[p, i, j] * nodes[k - 1, j]
                moved[i] = total
            for i in range(n):
                s[p, i] = moved[i]
            out[k, p] = s[p, n - 1]
    return out
