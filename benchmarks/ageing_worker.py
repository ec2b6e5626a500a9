"""Cycles cells that have aged by known amounts, by PyBaMM; for `ageing_pybamm.py`, in an environment of its own.

``python ageing_worker.py REQUEST.json RECORDS.npz``, which needs PyBaMM and numpy (PyBaMM 26.10 was used).

Written are, for each state of the request in turn and each of its cycles, ``STATE_CYCLE_charge`` and
``STATE_CYCLE_discharge``: (n, 4) time in s, current in A (positive charges), voltage in V and cell temperature in degC.
Lost material takes along the lithium that is in it when the cell is half full; `capacity_Ah` is that of the fresh cell
between its voltages at rest.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pybamm  # pyright: ignore[reportMissingImports]

_FARADAY = 96485.33212
_ELECTRODES = ("Negative", "Positive")
_AREAS = ("Electrode width [m]", "Electrode height [m]")
_PARALLEL = "Number of electrodes connected in parallel to make a cell"
OPTIONS = {
    "thermal": "lumped",
    "contact resistance": "true",
    "SEI": "constant",
    "SEI film resistance": "distributed",
    "calculate discharge energy": "false",
}


def main() -> int:
    request: dict[str, Any] = json.loads(Path(sys.argv[1]).read_text())
    records, told = {}, {}
    for number, state in enumerate(request["states"]):
        for key, columns in cycled(request, state, told).items():
            records[f"{number}_{key}"] = columns
    np.savez_compressed(sys.argv[2], **records, capacity_Ah=told["capacity_Ah"])
    return 0


def cell_of(request: dict[str, Any]) -> pybamm.ParameterValues:
    """The fresh cell: a published parameter set with constants moved."""
    values = pybamm.ParameterValues(request["parameters"])
    for name, factor in request["factors"].items():
        own = values[name]
        if callable(own):
            values[name] = _scaled(own, factor)
        else:
            values[name] = own * factor
    values["Ambient temperature [K]"] = values["Initial temperature [K]"] = request["ambient_degC"] + 273.15
    values["Total heat transfer coefficient [W.m-2.K-1]"] = request["cooling_W_per_m2_K"]
    return values


def _scaled(function: Any, factor: float) -> Any:
    return lambda *arguments: factor * function(*arguments)


def aged(values: pybamm.ParameterValues, state: dict[str, float], fillings: tuple[float, float], capacity_Ah: float):
    """The cell with lithium and material lost while half full, and with its resistances."""
    out = values.copy()
    filling = dict(zip(_ELECTRODES, fillings, strict=True))
    for name in _ELECTRODES:
        out[f"{name} electrode active material volume fraction"] *= 1.0 - state[f"{name.lower()}_lost"]
    held_Ah = electrode_Ah(out, "Negative")
    filling["Negative"] -= state["lithium_lost"] * capacity_Ah / held_Ah
    for name in _ELECTRODES:
        most = out[f"Maximum concentration in {name.lower()} electrode [mol.m-3]"]
        out[f"Initial concentration in {name.lower()} electrode [mol.m-3]"] = filling[name] * most
    out["Contact resistance [Ohm]"] = state["contact_Ohm"]
    radius_m = out["Negative particle radius [m]"]
    share = out["Negative electrode active material volume fraction"]
    area_m2 = 3.0 * share / radius_m * _volume_m3(out, "Negative")
    # What a film has as a resistance of the whole cell.
    thickness_m = out["Initial SEI thickness [m]"]
    out["SEI resistivity [Ohm.m]"] = state["film_Ohm"] * area_m2 / thickness_m
    return out


def _volume_m3(values: pybamm.ParameterValues, name: str) -> float:
    area_m2 = values[_AREAS[0]] * values[_AREAS[1]] * values[_PARALLEL]
    return area_m2 * values[f"{name} electrode thickness [m]"]


def electrode_Ah(values: pybamm.ParameterValues, name: str) -> float:
    """Capacity of an electrode."""
    most = values[f"Maximum concentration in {name.lower()} electrode [mol.m-3]"]
    share = values[f"{name} electrode active material volume fraction"]
    return most * share * _volume_m3(values, name) * _FARADAY / 3600.0


def cycled(request: dict[str, Any], state: dict[str, float], told: dict[str, float]) -> dict[str, np.ndarray]:
    """A charge that empties into, and a discharge, for each cycle; the first of them after one that is not logged."""
    values = cell_of(request)
    model = getattr(pybamm.lithium_ion, request["model"])(OPTIONS)
    solver = pybamm.lithium_ion.ElectrodeSOHSolver(values, pybamm.LithiumIonParameters(OPTIONS))
    full, empty = (solver.get_initial_stoichiometries(soc) for soc in (1.0, 0.0))
    half = (0.5 * (full[0] + empty[0]), 0.5 * (full[1] + empty[1]))
    capacity_Ah = (full[0] - empty[0]) * electrode_Ah(values, "Negative")
    told["capacity_Ah"] = capacity_Ah
    steps = _steps(request, values, capacity_Ah)
    cycles = [steps["begin"], *(steps["cycle"] for _ in range(int(state["cycles"])))]
    experiment = pybamm.Experiment(cycles, period="1 second")
    simulation = pybamm.Simulation(
        model, parameter_values=aged(values, state, half, capacity_Ah), experiment=experiment
    )
    solution = simulation.solve()
    out = {}
    for number, cycle in enumerate(solution.cycles[1:]):
        charge, between, discharge, rest = cycle.steps[:2], cycle.steps[2], cycle.steps[3], cycle.steps[4]
        before = solution.cycles[number].steps[-1]
        out[f"{number}_charge"] = _file(
            [(before, -10, None), *((each, None, None) for each in charge), (between, 0, 60)]
        )
        out[f"{number}_discharge"] = _file([(between, -10, None), (discharge, None, None), (rest, 0, 60)])
    return out


def _steps(request: dict[str, Any], values: pybamm.ParameterValues, capacity_Ah: float) -> dict[str, tuple]:
    low_V, high_V = values["Lower voltage cut-off [V]"], values["Upper voltage cut-off [V]"]
    step = pybamm.step
    charge = [
        step.current(-request["charge_C"] * capacity_Ah, termination=f"{high_V} V", duration=20000),
        step.voltage(high_V, termination=f"{0.05 * capacity_Ah} A", duration=20000),
    ]
    rest = step.rest(request["rest_s"])
    constant = step.current(request["discharge_C"] * capacity_Ah, termination=f"{low_V} V", duration=40000)
    if request["drive_C"] is None:
        discharge = constant
    else:
        drive_A = np.array(request["drive_C"]) * capacity_Ah
        drive = np.column_stack([np.arange(len(drive_A), dtype=float), drive_A])
        discharge = step.current(drive, termination=f"<{low_V} V", duration=len(drive_A) - 1)
    return {"begin": (constant, step.rest(request["rest_s"])), "cycle": (*charge, rest, discharge, rest)}


def _file(parts: list[tuple[Any, int | None, int | None]]) -> np.ndarray:
    """(n, 4) samples of parts of steps on a clock of whole seconds."""
    rows = []
    for step, first, last in parts:
        names = ("Current [A]", "Terminal voltage [V]", "Volume-averaged cell temperature [K]")
        time_s = step["Time [s]"].entries
        columns = [step[name].entries for name in names]
        even_s = np.arange(np.ceil(time_s[0]), time_s[-1] + 1e-9, 1.0)
        even = np.column_stack([np.interp(even_s, time_s, each) for each in columns])
        rows.append(even[first:last])
    amps, volts, kelvins = np.vstack(rows).T
    return np.column_stack([np.arange(len(amps), dtype=float), -amps, volts, kelvins - 273.15])


if __name__ == "__main__":
    sys.exit(main())
