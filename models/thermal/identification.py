"""Heat capacity and heat transfer from measured temperature: least squares on the simulation error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.readouts.ocv import OcvTable
from models.readouts.resistance import ResistanceTable
from models.thermal.model import ThermalModel
from models.thermal.problem import ENTROPIC, POLARISATION, SIGNED, ThermalProblem
from models.uncertainty.correlated_errors import least_squares_covariance

# A temperature that stays within this range shows the sensor and the chamber, not the cell.
_LEAST_RANGE_K = 1.0
# Relative standard deviation above which a parameter counts as not determined.
_WEAK = 0.3
_MAX_ITERATIONS = 60
_HALVINGS = 25
_WORDS = {
    "heat_capacity_J_per_K": "heat capacity",
    "heat_transfer_W_per_K": "heat transfer to the ambient",
    "surface_heat_capacity_J_per_K": "heat capacity of the surface",
    "core_to_surface_W_per_K": "heat transfer from core to surface",
    "dU_dT_V_per_K": "entropic coefficient",
    "polarisation_Ohm": "polarisation",
}
_ADVICE = "Record a run that warms up under load and cools down at rest"
_ONE_NODE = ("heat_capacity_J_per_K", "heat_transfer_W_per_K")
_TWO_NODES = (*_ONE_NODE, "surface_heat_capacity_J_per_K", "core_to_surface_W_per_K")


@dataclass(frozen=True)
class ThermalFit:
    """An identified thermal model.

    Attributes
    ----------
    model : with standard deviations
    simulated_degC : of each run, what the sensor should read
    rmse_K : over all runs
    reservations : what a person should know before trusting the model
    """

    model: ThermalModel
    simulated_degC: list[FloatArray]
    rmse_K: float
    reservations: tuple[str, ...] = ()


def identify_thermal(
    runs: list[GridRun],
    soc: list[FloatArray],
    losses: ResistanceTable | OcvTable,
    *,
    surface: bool = False,
    reversible: bool = False,
    polarisation_s: float | None = 600.0,
    start: ThermalModel | None = None,
) -> ThermalFit:
    """Fit the heat balance to measured temperature.

    Parameters
    ----------
    runs : each with `ambient_degC` and `temperature_degC`; all nodes are taken to start alike
    soc : (n,) of each run
    losses : a resistance table makes the heat I^2 R, an open-circuit table I (V - U) with the measured voltage, which
        is the better one: it is right in pulses too short for the resistance to settle
    surface : identify a core and a surface instead of one node
    reversible : identify a constant entropic coefficient too; otherwise the one of `start` is kept
    polarisation_s : time constant of the polarisation whose resistance is identified too, for its heat comes later;
        None, and always with a resistance table: that of `start` is kept, for a smaller resistance cannot be told from
        a larger heat capacity with a larger transfer
    start : first guess; by default a cell of 50 J/K that loses a sixth of a watt per kelvin

    Returns
    -------
    ThermalFit
        The temperature at the start of each run is fitted too. Standard deviations allow for residuals that hang
        together in time, not for wrong losses.

    Raises
    ------
    ModelError
        A run lacks its ambient or cell temperature, or its SoC.
    NotIdentifiableError
        The temperature hardly moves, or a parameter is not determined; the message says which.
    """
    _check(runs, soc)
    if surface and start is None:
        start = identify_thermal(runs, soc, losses, reversible=reversible, polarisation_s=polarisation_s).model
    names = list(_TWO_NODES if surface else _ONE_NODE)
    names += [ENTROPIC] if reversible else []
    guess = _first_guess(surface, reversible, start)
    if polarisation_s is not None and isinstance(losses, OcvTable):
        names.append(POLARISATION)
        guess = replace(guess, polarisation_s=polarisation_s)
    problem = ThermalProblem(runs, soc, losses, tuple(names), guess)
    x = _gauss_newton(problem, problem.start())
    residual, jacobian = problem.linearised(x)
    covariance = _checked_covariance(problem, x, residual, jacobian)
    spread, values = np.sqrt(np.diag(covariance)), problem.values(x)
    std = {n: float(spread[i] * (1.0 if n in SIGNED else values[n])) for i, n in enumerate(names)}
    rmse = float(np.sqrt(np.mean(residual**2)))
    record = {"runs": [run.name for run in runs], "rmse_K": rmse, "n_samples": len(residual), "losses": _source(losses)}
    model = replace(problem.model(x), std=std, record=record)
    return ThermalFit(model, problem.simulated(x), rmse, tuple(_reservations(model)))


def _source(losses: ResistanceTable | OcvTable) -> str:
    return "resistance" if isinstance(losses, ResistanceTable) else "overpotential"


def _reservations(model: ThermalModel) -> list[str]:
    if model.polarisation_Ohm < -2.0 * model.std.get(POLARISATION, 0.0):
        return [
            f"polarisation came out at {1e3 * model.polarisation_Ohm:.2f} mOhm; it must be positive: the losses are "
            "too small, or the temperature comes late for another reason, such as a second node"
        ]
    return []


def _check(runs: list[GridRun], soc: list[FloatArray]) -> None:
    if not runs or len(runs) != len(soc):
        raise ModelError(f"thermal model: {len(runs)} run(s) with {len(soc)} SoC; one for each is needed")
    moved = 0.0
    for run, fraction in zip(runs, soc, strict=True):
        if run.ambient_degC is None or np.isnan(run.ambient_degC).any() or np.isnan(run.temperature_degC).any():
            raise ModelError(f"{run.name}: the thermal model needs both the cell's and the ambient temperature")
        if len(fraction) != len(run) or not np.isfinite(fraction).all():
            raise ModelError(f"{run.name}: its SoC must be finite and have a value for each of {len(run)} samples")
        # 2 % at either end are left out: a sensor's noise grows with the number of samples, the cell's warmth does not.
        low, high = np.percentile(run.temperature_degC, [2.0, 98.0])
        moved = max(moved, float(high - low))
    if moved < _LEAST_RANGE_K:
        raise NotIdentifiableError(
            f"the cell's temperature moves by {moved:.2f} K only, at least {_LEAST_RANGE_K:g} K are needed: neither "
            "heat capacity nor heat transfer can be seen. Load the cell harder or longer"
        )


def _first_guess(surface: bool, reversible: bool, start: ThermalModel | None) -> ThermalModel:
    guess = start or ThermalModel(50.0, 1.0 / 6.0)
    if surface and guess.n_nodes == 1:
        h = guess.heat_transfer_W_per_K
        c = guess.heat_capacity_J_per_K
        guess = replace(
            guess,
            heat_capacity_J_per_K=0.7 * c,
            surface_heat_capacity_J_per_K=0.3 * c,
            core_to_surface_W_per_K=10.0 * h,
        )
    elif not surface and guess.n_nodes == 2:
        raise ModelError("thermal model: the first guess has a surface; ask for one, or give a guess without")
    if reversible:
        guess = replace(guess, dU_dT_V_per_K=(float(np.mean(guess.dU_dT_V_per_K)),), dU_dT_soc=(0.5,))
    return guess


def _gauss_newton(problem: ThermalProblem, x: FloatArray) -> FloatArray:
    cost = float(np.sum(problem.residual(x) ** 2))
    for _ in range(_MAX_ITERATIONS):
        residual, jacobian = problem.linearised(x)
        scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-12)
        step = np.linalg.lstsq(jacobian / scale, residual, rcond=1e-10)[0] / scale
        n_logs = sum(name not in SIGNED for name in problem.names)
        step *= min(1.0, 1.0 / max(float(np.abs(step[:n_logs]).max()), 1e-12))
        for _ in range(_HALVINGS):
            trial = float(np.sum(problem.residual(x + step) ** 2))
            if np.isfinite(trial) and trial < cost:
                break
            step *= 0.5
        else:
            return x
        done = cost - trial < 1e-9 * cost
        x, cost = x + step, trial
        if done:
            return x
    return x


def _checked_covariance(
    problem: ThermalProblem, x: FloatArray, residual: FloatArray, jacobian: FloatArray
) -> FloatArray:
    """Covariance of x.

    Raises
    ------
    NotIdentifiableError
        A positive parameter, or a common or opposite change of several, is not determined.
    """
    scale = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    _, sizes, directions = np.linalg.svd(jacobian / scale, full_matrices=False)
    positive = [i for i, name in enumerate(problem.names) if name not in SIGNED]
    if sizes[-1] < 1e-9 * sizes[0]:
        weak = (directions[-1] / scale)[: len(problem.names)]
        raise NotIdentifiableError(
            f"{_weak_words(problem.names, weak)} without any effect on the temperature. {_ADVICE}"
        )
    starts = tuple(np.cumsum([0, *(len(run) for run in problem.runs[:-1])]).tolist())
    covariance = least_squares_covariance(jacobian, residual, starts)
    values, vectors = np.linalg.eigh(covariance[np.ix_(positive, positive)])
    if not np.sqrt(values[-1]) <= _WEAK:
        words = _weak_words(tuple(problem.names[i] for i in positive), vectors[:, -1])
        percent = 100.0 * np.sqrt(values[-1])
        raise NotIdentifiableError(
            f"{words} by {percent:.0f} % (one standard deviation) in the data's noise. {_ADVICE}"
        )
    return covariance


def _weak_words(names: tuple[str, ...], direction: FloatArray) -> str:
    """Say which parameters can change together along a direction of their logarithms."""
    main = [j for j in range(len(names)) if abs(direction[j]) > 0.4 * np.abs(direction).max()]
    alike = len({bool(direction[j] > 0.0) for j in main}) == 1
    how = "" if len(main) == 1 else " by a common factor" if alike else " against each other"
    return f"{' and '.join(_WORDS[names[j]] for j in main)} can change{how}"
