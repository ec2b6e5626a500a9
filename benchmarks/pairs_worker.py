"""Pairs of records of electrochemical cells, without and with one effect; run by an environment that has PyBaMM.

``python pairs_worker.py FOLDER [--seed 0] [--cases NAME,...]``, which needs PyBaMM and numpy (PyBaMM 26.10 was used).

Written is, for each case, FOLDER/CASE with `base_ident`, `base_valid`, `hidden_ident`, `hidden_valid` (CSV, one sample
a second, positive currents charge) and `meta.json`, as `diagnosis_pybamm.py` reads them. Parameter set, constants,
sizes, window, profiles and sensors are drawn anew for each case; case and seed tell all of them. What is there is not
made again.
"""

import argparse
import gzip
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pybamm  # pyright: ignore[reportMissingImports]

FARADAY, KELVIN = 96485.33212, 273.15
SETS = ("OKane2022", "Chen2020", "Mohtat2020", "Marquis2019", "Ecker2015", "NCA_Kim2011")
NOMINAL_AH = dict(zip((*SETS, "Prada2013", "Chen2020_composite"), (5.0, 5.0, 5.0, 0.68, 0.156, 0.43, 2.3, 5.0), strict=True))
ELECTRODES = ("Negative", "Positive")
_COLUMNS = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC", "soc_ref")
_MOVED = {"particle radius [m]": 0.2, "particle diffusivity [m2.s-1]": 0.3, "electrode exchange-current density [A.m-2]": 0.3}
# What a charge lifts to 25 degC of: exchange currents and diffusion, J/mol.
_ARRHENIUS = ((25e3, 45e3), (15e3, 35e3))


@dataclass
class Cell:
    """One cell of a pair.

    Attributes
    ----------
    values, parameters, options, model : of PyBaMM; the parameters by the name of their set
    capacity_Ah : between the voltages at rest
    leak_A : that discharges the cell and that no sensor sees
    ambient : (mean, swing) in degC
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


@dataclass(frozen=True)
class Sensors:
    """What a log makes of the truth: noise, and what is wrong with the current and the temperature."""

    volts: float
    kelvins: float
    current_offset_A: float = 0.0
    temperature_share: float = 1.0


@dataclass
class Case:
    """A pair: cell and sensors without and with the effect, and how it is driven."""

    base: Cell
    hidden: Cell
    sensors: tuple[Sensors, Sensors]
    truth: str
    window: tuple[float, float] = (0.2, 0.9)
    peak_C: float = 2.0
    rest_s: float = 3600.0
    runs: dict[str, dict[str, float]] = field(default_factory=dict)


def main() -> int:
    arguments = _arguments()
    for number, (name, make) in enumerate(CASES.items()):
        folder = arguments.folder / name
        if name in arguments.cases and not (folder / "meta.json").exists():
            written(folder, name, arguments.seed, make(np.random.default_rng([arguments.seed, number])), number)
    return 0


def written(folder: Path, name: str, seed: int, case: Case, number: int) -> None:
    """Drive both cells of a case and write what the sensors read; less deeply where one of them cannot follow."""
    rng = np.random.default_rng([seed, number, 1])
    while (runs := _driven(case, name, rng)) is None:
        low, high = case.window
        if low + 0.1 > high - 0.2:
            raise SystemExit(f"{name}, seed {seed}: the cell follows no profile between {low:g} and {high:g}")
        case = replace(case, window=(low + 0.1, high))
    folder.mkdir(parents=True, exist_ok=True)
    for run, columns in runs.items():
        _write(folder / f"{run}.csv.gz", columns)
    meta = {"case": name, "true_size": case.truth, "capacity_Ah": case.base.capacity_Ah, "seed": seed}
    meta |= {"parameter_set": case.base.parameters, "model": case.base.model, "window": case.window}
    (folder / "meta.json").write_text(json.dumps(meta, indent=1))


def _driven(case: Case, name: str, rng: np.random.Generator) -> dict[str, np.ndarray] | None:
    """Logs of a pair; None where a cell reaches an end of what it can do."""
    still, out = {"": case.base.ambient_degC[0]}, {}
    for kind in ("ident",) if name == "sei_growth" else ("ident", "valid"):
        for suffix, ambient in case.runs.get(kind, still).items():
            rates = (ident_C if kind == "ident" else valid_C)(case, rng)
            pair = zip(("base", "hidden"), (case.base, case.hidden), case.sensors, strict=True)
            for role, cell, sensors in pair:
                there = replace(cell, ambient_degC=(ambient, cell.ambient_degC[1]))
                columns = driven(there, rates * case.base.capacity_Ah, case.window[1])
                run = "_".join(each for each in (role, kind, suffix) if each)
                print(f"{name} {run}: {len(rates)} s", file=sys.stderr, flush=True)
                if not np.isfinite(columns).all():
                    return None
                out[run] = logged(columns, sensors, rng)
    return out


def a_cell(rng: np.random.Generator, parameters: str | None = None, model: str | None = None) -> Cell:
    """A published parameter set with constants moved."""
    parameters = parameters or str(rng.choice(SETS))
    values = pybamm.ParameterValues(parameters)
    for electrode in ELECTRODES:
        for what, spread in _MOVED.items():
            _scale(values, f"{electrode} {what}", float(np.exp(spread * rng.uniform(-1.0, 1.0))))
    values["Total heat transfer coefficient [W.m-2.K-1]"] = float(rng.uniform(8.0, 30.0))
    values["Contact resistance [Ohm]"] = float(rng.uniform(2e-3, 8e-3)) / NOMINAL_AH[parameters]
    options: dict[str, Any] = {"thermal": "lumped", "contact resistance": "true", "calculate discharge energy": "false"}
    cell = Cell(values, parameters, options, model or ("DFN" if rng.random() < 0.3 else "SPMe"), 0.0)
    full, empty = _fillings(cell)
    return replace(cell, capacity_Ah=(full[0] - empty[0]) * electrode_Ah(values))


def _scale(values: Any, name: str, factor: float) -> None:
    own = values[name]
    values[name] = (lambda *arguments: factor * own(*arguments)) if callable(own) else own * factor


def electrode_Ah(values: Any) -> float:
    """Capacity of the negative electrode."""
    area_m2 = values["Electrode width [m]"] * values["Electrode height [m]"]
    area_m2 *= values["Number of electrodes connected in parallel to make a cell"]
    most = values["Maximum concentration in negative electrode [mol.m-3]"]
    share = values["Negative electrode active material volume fraction"]
    return most * share * area_m2 * values["Negative electrode thickness [m]"] * FARADAY / 3600.0


def _fillings(cell: Cell) -> tuple[Any, Any]:
    solver = pybamm.lithium_ion.ElectrodeSOHSolver(cell.values, pybamm.LithiumIonParameters(cell.options))
    return solver.get_initial_stoichiometries(1.0), solver.get_initial_stoichiometries(0.0)


def driven(cell: Cell, current_A: np.ndarray, soc: float) -> np.ndarray:
    """(n, 6) true columns of a run: what flows is linear between seconds, and told as its mean over each."""
    values = cell.values.copy()
    n = len(current_A)
    if cell.model != "SPM" or "particle phases" not in cell.options:
        _fill(values, cell, soc)
    else:
        values.set_initial_state(soc, options=cell.options)
    mean, swing = cell.ambient_degC
    values["Initial temperature [K]"] = mean + KELVIN
    if swing:
        values["Ambient temperature [K]"] = lambda y, z, t: mean + KELVIN + swing * pybamm.sin(2.0 * np.pi * t / (0.8 * n))
    else:
        values["Ambient temperature [K]"] = mean + KELVIN
    for name, by in (("Lower", -1.0), ("Upper", 1.0)):
        values[f"{name} voltage cut-off [V]"] = values[f"{name} voltage cut-off [V]"] + by
    seconds = np.arange(float(n))
    through_A = -current_A + cell.leak_A
    bends = np.flatnonzero(np.abs(np.diff(through_A, 2)) > 1e-9) + 1
    nodes = np.unique(np.concatenate([[0], bends, [n - 1]]))
    values["Current function [A]"] = pybamm.Interpolant(seconds[nodes], through_A[nodes], pybamm.t)
    model = getattr(pybamm.lithium_ion, cell.model)(cell.options)
    simulation = pybamm.Simulation(model, parameter_values=values, solver=pybamm.IDAKLUSolver(rtol=1e-5, atol=1e-6))
    solution = simulation.solve([0.0, float(n - 1)], t_interp=seconds)
    kelvins = solution["Volume-averaged cell temperature [K]"](seconds)
    volts = solution["Terminal voltage [V]"](seconds)
    ambient = mean + swing * np.sin(2.0 * np.pi * seconds / (0.8 * n))
    told_A = np.concatenate([current_A[:1], 0.5 * (current_A[1:] + current_A[:-1])])
    counted = soc + np.concatenate([[0.0], np.cumsum(told_A[1:])]) / 3600.0 / cell.capacity_Ah
    return np.column_stack([seconds, told_A, volts, kelvins - KELVIN, ambient, counted])


def _fill(values: Any, cell: Cell, soc: float) -> None:
    """The cell at a state of charge of its own, which lost lithium has changed."""
    full, empty = _fillings(cell)
    if cell.lithium_lost:
        own = pybamm.lithium_ion.ElectrodeSOHSolver(cell.values, pybamm.LithiumIonParameters(cell.options))
        held = (full[0] * electrode_Ah(cell.values) + full[1] * _positive_Ah(cell.values)) * 3600.0 / FARADAY
        less = held - cell.lithium_lost * cell.capacity_Ah * 3600.0 / FARADAY
        found = own.solve(
            {"Q_n": electrode_Ah(cell.values), "Q_p": _positive_Ah(cell.values), "Q_Li": less * FARADAY / 3600.0}
        )
        full = (float(found["x_100"]), float(found["y_100"]))
        empty = (float(found["x_0"]), float(found["y_0"]))
    for k, name in enumerate(ELECTRODES):
        most = values[f"Maximum concentration in {name.lower()} electrode [mol.m-3]"]
        filled = soc * full[k] + (1.0 - soc) * empty[k]
        values[f"Initial concentration in {name.lower()} electrode [mol.m-3]"] = filled * most


def _positive_Ah(values: Any) -> float:
    area_m2 = values["Electrode width [m]"] * values["Electrode height [m]"]
    area_m2 *= values["Number of electrodes connected in parallel to make a cell"]
    most = values["Maximum concentration in positive electrode [mol.m-3]"]
    share = values["Positive electrode active material volume fraction"]
    return most * share * area_m2 * values["Positive electrode thickness [m]"] * FARADAY / 3600.0


def logged(columns: np.ndarray, sensors: Sensors, rng: np.random.Generator) -> np.ndarray:
    """What the sensors read."""
    seconds, current, volts, degC, ambient, soc = columns.T
    warm = ambient + sensors.temperature_share * (degC - ambient)
    return np.column_stack(
        [
            seconds,
            np.round(current + sensors.current_offset_A, 4),
            np.round(volts + sensors.volts * rng.standard_normal(len(volts)), 3),
            np.round(warm + sensors.kelvins * rng.standard_normal(len(volts)), 2),
            np.round(ambient, 2),
            np.round(soc, 5),
        ]
    )


def _write(path: Path, columns: np.ndarray) -> None:
    with gzip.open(path, "wt", encoding="utf-8") as file:
        np.savetxt(file, columns, fmt="%g", delimiter=",", header=",".join(_COLUMNS), comments="")


def ident_C(case: Case, rng: np.random.Generator) -> np.ndarray:
    """(n,) rates: pulses and rests at levels of charge down the window, loads between them, and back up."""
    low, high = case.window
    parts, soc = [np.zeros(600)], high
    for sign in (-1.0, 1.0):
        end = low if sign < 0.0 else high
        while sign * (end - soc) > 0.02:
            parts.append(_pulses(case.peak_C, rng))
            step = min(0.1, sign * (end - soc))
            part = _load(sign, step, 0.6 * case.peak_C if sign < 0.0 else 0.3, rng)
            parts += [part, np.zeros(int(rng.choice([0.2, 0.4, 1.0]) * case.rest_s))]
            soc += float(part.sum()) / 3600.0
    return np.concatenate([*parts, np.zeros(int(case.rest_s))])


def valid_C(case: Case, rng: np.random.Generator) -> np.ndarray:
    """(n,) rates of a drive down to the middle of the window, with a long rest now and then."""
    low, high = case.window
    parts, soc = [np.zeros(300)], high
    while soc > 0.5 * (low + high) - 0.1:
        n = int(rng.integers(200, 700))
        noise = np.convolve(rng.standard_normal(n + 10), np.ones(6) / 2.5, mode="same")[:n]
        part = np.clip(-0.45 + 0.6 * noise, -case.peak_C, 0.35)
        if rng.random() < 0.3:
            part = np.zeros(int(rng.integers(60, 600)))
        parts.append(part)
        soc += float(part.sum()) / 3600.0
    return np.concatenate([*parts, np.zeros(1200)])


def _pulses(peak_C: float, rng: np.random.Generator) -> np.ndarray:
    parts = []
    for rate in peak_C * np.array([0.25, 0.5, 1.0]):
        back = float(rng.choice([0.15, 0.4])) * rate
        parts += [np.full(10, -rate), np.zeros(60), np.full(round(10 * rate / back), back), np.zeros(60)]
    return np.concatenate(parts)


def _load(sign: float, step: float, most_C: float, rng: np.random.Generator) -> np.ndarray:
    parts, moved = [], 0.0
    while moved < step:
        rate, n = rng.uniform(0.15, most_C), int(rng.integers(30, 300))
        n = max(1, min(n, int(3600.0 * (step - moved) / rate) + 1))
        parts += [np.full(n, sign * rate), np.zeros(int(rng.integers(40, 90))) if rng.random() < 0.3 else np.zeros(0)]
        moved += n * rate / 3600.0
    return np.concatenate(parts)


def _sensors(rng: np.random.Generator) -> Sensors:
    return Sensors(float(rng.uniform(6e-4, 2e-3)), 0.1)


def _alike(rng: np.random.Generator, base: Cell, hidden: Cell, truth: str, **others: Any) -> Case:
    sensors = _sensors(rng)
    window = (float(rng.choice([0.1, 0.2, 0.3])), 0.9)
    return Case(base, hidden, (sensors, sensors), truth, **({"window": window} | others))


def _with(cell: Cell, **changed: Any) -> Cell:
    """The cell with parameters of PyBaMM set anew."""
    values = cell.values.copy()
    for name, value in changed.items():
        values[_NAMES[name]] = value
    return replace(cell, values=values)


_NAMES = {
    "contact": "Contact resistance [Ohm]",
    "cooling": "Total heat transfer coefficient [W.m-2.K-1]",
    "entropic": "Positive electrode OCP entropic change [V.K-1]",
}


def capacity_fade(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    lost = float(rng.uniform(0.05, 0.14))
    return _alike(rng, base, replace(base, lithium_lost=lost), f"lithium lost: {lost:.3f} of the capacity", window=(0.25, 0.9))


def contact_resistance(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    more = float(rng.uniform(0.02, 0.05)) / base.capacity_Ah
    return _alike(
        rng, base, _with(base, contact=base.values["Contact resistance [Ohm]"] + more), f"{1e3 * more:.3g} mOhm in series"
    )


def current_offset(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    offset = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.005, 0.012)) * base.capacity_Ah
    case = _alike(rng, base, base, f"current read {1e3 * offset:.3g} mA too high")
    return replace(case, sensors=(case.sensors[0], replace(case.sensors[0], current_offset_A=offset)))


def entropic_effect(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    swing = float(rng.uniform(10.0, 15.0))
    base = replace(_with(base, entropic=0.0), ambient_degC=(25.0, swing))
    low, bend, place = rng.uniform(-4e-4, -2e-4), rng.uniform(2e-4, 4e-4), rng.uniform(0.5, 0.8)

    def slope(sto: Any) -> Any:
        return low + bend * pybamm.tanh((sto - place) / 0.12)

    return _alike(rng, base, _with(base, entropic=slope), "an entropic change of the positive electrode")


def hysteresis(rng: np.random.Generator) -> Case:
    base = a_cell(rng, "Prada2013", "SPMe")
    half, decay = float(rng.uniform(0.008, 0.022)), float(rng.uniform(30.0, 90.0))
    curve = base.values["Positive electrode OCP [V]"]
    values = base.values.copy()
    values.update(
        {
            "Positive electrode lithiation OCP [V]": lambda sto: curve(sto) - half,
            "Positive electrode delithiation OCP [V]": lambda sto: curve(sto) + half,
            "Positive particle hysteresis decay rate": decay,
            "Initial hysteresis state in positive electrode": 0.0,
        },
        check_already_exists=False,
    )
    options = base.options | {"open-circuit potential": ("single", "one-state hysteresis"), "thermal": "isothermal"}
    base = replace(base, options=base.options | {"thermal": "isothermal"})
    return _alike(rng, base, replace(base, values=values, options=options), f"+-{1e3 * half:.3g} mV, decay {decay:.3g}")


def nonlinear_kinetics(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    for electrode in ELECTRODES:
        _scale(base.values, f"{electrode} particle diffusivity [m2.s-1]", 8.0)
        _scale(base.values, f"{electrode} electrode exchange-current density [A.m-2]", float(rng.uniform(0.8, 1.5)))
    _scale(base.values, "Electrolyte diffusivity [m2.s-1]", 4.0)
    _scale(base.values, "Electrolyte conductivity [S.m-1]", 4.0)
    linear = replace(base, options=base.options | {"intercalation kinetics": "linear"})
    return _alike(rng, linear, base, "Butler-Volmer for linear kinetics", window=(0.3, 0.8), peak_C=5.0)


def nothing(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    return _alike(rng, base, base, "nothing but noise")


def sei_growth(rng: np.random.Generator) -> Case:
    base = a_cell(rng, "OKane2022", "SPM")
    options = base.options | {"SEI": "solvent-diffusion limited", "SEI film resistance": "average"}
    values = base.values.copy()
    factor = float(rng.uniform(2500.0, 6000.0))
    _scale(values, "SEI solvent diffusivity [m2.s-1]", factor)
    hidden = replace(base, values=values, options=options)
    still = replace(base, options=base.options | {"SEI": "constant", "SEI film resistance": "average"})
    return _alike(rng, still, hidden, f"a film that grows, diffusivity x {factor:.0f}", peak_C=1.1, rest_s=9000.0)


def self_discharge(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    leak = float(rng.uniform(0.004, 0.008)) * base.capacity_Ah
    return _alike(rng, base, replace(base, leak_A=leak), f"{1e3 * leak:.3g} mA leak", window=(0.35, 0.9), rest_s=6000.0)


def slow_diffusion(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    electrode, factor = str(rng.choice(ELECTRODES)), float(rng.uniform(0.2, 0.4))
    values = base.values.copy()
    _scale(values, f"{electrode} particle diffusivity [m2.s-1]", factor)
    return _alike(rng, base, replace(base, values=values), f"{electrode} diffusivity x {factor:.2f}")


def soc_dependent_resistance(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    name = "Positive electrode exchange-current density [A.m-2]"
    own = base.values[name]
    steep = float(rng.uniform(1.8, 3.0))
    full, empty = _fillings(base)

    def even(c_e: Any, c_s_surf: Any, c_s_max: Any, temperature: Any) -> Any:
        return own(c_e, 0.5 * c_s_max, c_s_max, temperature)

    def leaning(c_e: Any, c_s_surf: Any, c_s_max: Any, temperature: Any) -> Any:
        soc = (c_s_surf / c_s_max - empty[1]) / (full[1] - empty[1])
        return even(c_e, c_s_surf, c_s_max, temperature) * pybamm.exp(steep * (soc - 0.5))

    values = base.values.copy()
    values[name] = leaning
    base.values[name] = even
    return _alike(rng, base, replace(base, values=values), f"exchange current of the positive electrode x exp({steep:.2f} (SoC - 0.5))")


def temperature_kinetics(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    values, still = base.values.copy(), base.values.copy()
    for electrode in ELECTRODES:
        for name, (least, most) in zip(
            ("electrode exchange-current density [A.m-2]", "particle diffusivity [m2.s-1]"), _ARRHENIUS, strict=True
        ):
            whole, own = f"{electrode} {name}", base.values[f"{electrode} {name}"]
            values[whole], still[whole] = _arrhenius(own, float(rng.uniform(least, most))), _frozen(own)
    runs = {"ident": {"10C": 10.0, "25C": 25.0, "40C": 40.0}, "valid": {"17C": 17.0, "33C": 33.0}}
    return _alike(rng, replace(base, values=still), replace(base, values=values), "Arrhenius laws", runs=runs, peak_C=1.5)


def _frozen(own: Any) -> Any:
    return (lambda *arguments: own(*arguments[:-1], 298.15)) if callable(own) else own


def _arrhenius(own: Any, activation: float) -> Any:
    def grows(*arguments: Any) -> Any:
        held = own(*arguments[:-1], 298.15) if callable(own) else own
        return held * pybamm.exp(activation / 8.314 * (1.0 / 298.15 - 1.0 / arguments[-1]))

    return grows


def temperature_sensor(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    share = float(rng.uniform(0.25, 0.5))
    case = _alike(rng, base, base, f"{share:.2f} of the warming is read")
    return replace(case, sensors=(case.sensors[0], replace(case.sensors[0], temperature_share=share)))


def thermal_contact(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    share = float(rng.uniform(0.15, 0.35))
    cooling = 25.0
    return _alike(
        rng, _with(base, cooling=cooling), _with(base, cooling=share * cooling), f"heat transfer x {share:.2f}", peak_C=3.0
    )


CASES: dict[str, Callable[[np.random.Generator], Case]] = {
    "capacity_fade": capacity_fade,
    "contact_resistance": contact_resistance,
    "current_offset": current_offset,
    "entropic_effect": entropic_effect,
    "hysteresis": hysteresis,
    "nonlinear_kinetics": nonlinear_kinetics,
    "null": nothing,
    "sei_growth": sei_growth,
    "self_discharge": self_discharge,
    "slow_diffusion": slow_diffusion,
    "soc_dependent_resistance": soc_dependent_resistance,
    "temperature_kinetics": temperature_kinetics,
    "temperature_sensor": temperature_sensor,
    "thermal_contact": thermal_contact,
}


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=lambda text: text.split(","), default=list(CASES), metavar="NAME,...")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
