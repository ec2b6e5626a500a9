"""Cells for `pybamm_pairs.py`, with PyBaMM: published parameters with constants moved, and their runs."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pybamm  # pyright: ignore[reportMissingImports]
from ageing_worker import electrode_Ah

_KELVIN = 273.15
SETS = ("OKane2022", "Chen2020", "Mohtat2020", "Marquis2019", "Ecker2015", "NCA_Kim2011")
_NOMINAL_AH: dict[str, float] = {
    **dict(zip(SETS, (5.0, 5.0, 5.0, 0.68, 0.156, 0.43), strict=True)),
    "Prada2013": 2.3,
}
ELECTRODES = ("Negative", "Positive")
_MOVED = {
    "particle radius [m]": 0.2,
    "particle diffusivity [m2.s-1]": 0.3,
    "electrode exchange-current density [A.m-2]": 0.3,
}
# How long a current takes to turn.
_TURN_S = 1e-3


@dataclass
class Cell:
    """One cell of a pair.

    Attributes
    ----------
    values, parameters, options, model : of PyBaMM; the parameters by the name of their set
    capacity_Ah : between the voltages at rest
    leak_A : that discharges the cell and that no sensor sees
    ambient_degC : (mean, swing)
    lithium_lost : share of the capacity that is missing as lithium, before the run
    """

    values: Any
    parameters: str
    options: dict[str, Any]
    model: str
    capacity_Ah: float
    leak_A: float = 0.0
    ambient_degC: tuple[float, float] = (25.0, 0.0)
    lithium_lost: float = 0.0


def a_cell(rng: np.random.Generator, parameters: str | None = None, model: str | None = None) -> Cell:
    """A published parameter set with constants moved."""
    parameters = parameters or str(rng.choice(SETS))
    values = pybamm.ParameterValues(parameters)
    for electrode in ELECTRODES:
        for what, spread in _MOVED.items():
            scale(values, f"{electrode} {what}", float(np.exp(spread * rng.uniform(-1.0, 1.0))))
    values["Total heat transfer coefficient [W.m-2.K-1]"] = float(rng.uniform(8.0, 30.0))
    values["Contact resistance [Ohm]"] = float(rng.uniform(2e-3, 8e-3)) / _NOMINAL_AH[parameters]
    options: dict[str, Any] = {"thermal": "lumped", "contact resistance": "true", "calculate discharge energy": "false"}
    cell = Cell(values, parameters, options, model or ("DFN" if rng.random() < 0.3 else "SPMe"), 0.0)
    full, empty = fillings_of(cell)
    return replace(cell, capacity_Ah=(full[0] - empty[0]) * electrode_Ah(values, "Negative"))


def scale(values: Any, name: str, factor: float) -> None:
    """Multiply a parameter, also one that is a function."""
    own: Any = values[name]

    def scaled(*arguments: Any) -> Any:
        return factor * own(*arguments)

    values[name] = scaled if callable(own) else factor * own


def fillings_of(cell: Cell) -> tuple[Any, Any]:
    """Filling of the negative and of the positive electrode of a full cell, and of an empty one."""
    solver = pybamm.lithium_ion.ElectrodeSOHSolver(cell.values, pybamm.LithiumIonParameters(cell.options))
    return solver.get_initial_stoichiometries(1.0), solver.get_initial_stoichiometries(0.0)


def driven(cell: Cell, current_A: np.ndarray, soc: float) -> np.ndarray:
    """(n, 6) true columns of a run: the current holds from one second to the next, where it is told."""
    values = cell.values.copy()
    n = len(current_A)
    if "particle phases" in cell.options:
        # Both cells of a pair begin with as much lithium in each phase, whatever branch the looped one is on.
        alike = {name: value for name, value in cell.options.items() if name != "open-circuit potential"}
        values.set_initial_state(soc, options=alike)
    else:
        _fill(values, cell, soc)
    mean, swing = cell.ambient_degC
    values["Initial temperature [K]"] = mean + _KELVIN
    if swing:
        values["Ambient temperature [K]"] = lambda y, z, t: (
            mean + _KELVIN + swing * pybamm.sin(2.0 * np.pi * t / (0.8 * n))
        )
    else:
        values["Ambient temperature [K]"] = mean + _KELVIN
    for name, by in (("Lower", -1.0), ("Upper", 1.0)):
        values[f"{name} voltage cut-off [V]"] = values[f"{name} voltage cut-off [V]"] + by
    seconds, through_A = np.arange(float(n)), cell.leak_A - current_A
    turns = np.flatnonzero(np.diff(through_A)) + 0.0
    nodes_s = np.unique(np.concatenate([[0.0], turns, turns + _TURN_S, [n - 1.0]]))
    nodes_A = np.interp(nodes_s, *_held(through_A))
    values["Current function [A]"] = pybamm.Interpolant(nodes_s, nodes_A, pybamm.t)
    model = getattr(pybamm.lithium_ion, cell.model)(cell.options)
    simulation = pybamm.Simulation(model, parameter_values=values, solver=pybamm.IDAKLUSolver(rtol=1e-5, atol=1e-6))
    # Where the current bends the solver stops: it would step over a pulse.
    solution = simulation.solve(nodes_s, t_interp=seconds)
    kelvins = solution["Volume-averaged cell temperature [K]"](seconds)
    volts = solution["Terminal voltage [V]"](seconds)
    ambient = mean + swing * np.sin(2.0 * np.pi * seconds / (0.8 * n))
    counted = soc + np.concatenate([[0.0], np.cumsum(current_A[1:])]) / 3600.0 / cell.capacity_Ah
    return np.column_stack([seconds, current_A, volts, kelvins - _KELVIN, ambient, counted])


def _held(through_A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a current that turns just after each second, to what the next second tells."""
    seconds = np.arange(float(len(through_A)))
    return (
        np.column_stack([seconds[:-1] + _TURN_S, seconds[1:]]).ravel(),
        np.repeat(through_A[1:], 2),
    )


def _fill(values: Any, cell: Cell, soc: float) -> None:
    """The cell at a state of charge of its own, which lost lithium has changed."""
    full, empty = fillings_of(cell)
    if cell.lithium_lost:
        own = pybamm.lithium_ion.ElectrodeSOHSolver(cell.values, pybamm.LithiumIonParameters(cell.options))
        positive_Ah, negative_Ah = (electrode_Ah(cell.values, name) for name in ("Positive", "Negative"))
        lithium_Ah = full[0] * negative_Ah + full[1] * positive_Ah - cell.lithium_lost * cell.capacity_Ah
        found = own.solve({"Q_n": negative_Ah, "Q_p": positive_Ah, "Q_Li": lithium_Ah})
        full = (float(found["x_100"]), float(found["y_100"]))
        empty = (float(found["x_0"]), float(found["y_0"]))
    for k, name in enumerate(ELECTRODES):
        most = values[f"Maximum concentration in {name.lower()} electrode [mol.m-3]"]
        filled = soc * full[k] + (1.0 - soc) * empty[k]
        values[f"Initial concentration in {name.lower()} electrode [mol.m-3]"] = filled * most
