"""What may change between the two cells of a pair, or in their sensors: for `pybamm_pairs.py`, with PyBaMM."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pybamm  # pyright: ignore[reportMissingImports]
from pybamm_pair_cells import ELECTRODES, Cell, a_cell, fillings_of, scale

# Sets of cells that warm by kelvins under load, as those of laboratories' single layers do not.
_WARM = ("OKane2022", "Chen2020", "Mohtat2020")
# What a charge lifts to 25 degC of: exchange currents and diffusion, J/mol.
_ARRHENIUS = ((25e3, 45e3), (15e3, 35e3))


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


def _sensors(rng: np.random.Generator) -> Sensors:
    return Sensors(float(rng.uniform(6e-4, 2e-3)), 0.1)


def _alike(rng: np.random.Generator, base: Cell, hidden: Cell, truth: str, **others: Any) -> Case:
    sensors, low = _sensors(rng), float(rng.choice([0.1, 0.2, 0.3]))
    options: dict[str, Any] = {"window": (low, 0.9)} | others
    return Case(base, hidden, (sensors, sensors), truth, **options)


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
    return _alike(
        rng, base, replace(base, lithium_lost=lost), f"lithium lost: {lost:.3f} of the capacity", window=(0.25, 0.9)
    )


def contact_resistance(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    more = float(rng.uniform(0.02, 0.05)) / base.capacity_Ah
    return _alike(
        rng,
        base,
        _with(base, contact=base.values["Contact resistance [Ohm]"] + more),
        f"{1e3 * more:.3g} mOhm in series",
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
            "Positive particle lithiation hysteresis decay rate": decay,
            "Positive particle delithiation hysteresis decay rate": decay,
            "Initial hysteresis state in positive electrode": 0.0,
        },
        check_already_exists=False,
    )
    options = base.options | {"open-circuit potential": ("single", "one-state hysteresis"), "thermal": "isothermal"}
    base = replace(base, options=base.options | {"thermal": "isothermal"})
    return _alike(rng, base, replace(base, values=values, options=options), f"+-{1e3 * half:.3g} mV, decay {decay:.3g}")


def hysteresis_composite(rng: np.random.Generator) -> Case:
    values = pybamm.ParameterValues("Chen2020_composite")
    decay = float(rng.uniform(20.0, 60.0))
    for name in ("lithiation", "delithiation"):
        key = f"Secondary: Negative particle {name} hysteresis decay rate"
        values.update({key: decay}, check_already_exists=False)
    initial = "Secondary: Initial hysteresis state in negative electrode"
    values.update({initial: 0.0}, check_already_exists=False)
    for electrode in ("Primary: Negative", "Secondary: Negative", "Positive"):
        scale(values, f"{electrode} electrode exchange-current density [A.m-2]", float(np.exp(rng.uniform(-0.3, 0.3))))
    options = {"particle phases": ("2", "1"), "calculate discharge energy": "false"}
    looped = options | {"open-circuit potential": (("single", "one-state hysteresis"), "single")}
    base = Cell(values, "Chen2020_composite", options, "SPM", float(values["Nominal cell capacity [A.h]"]))
    truth = f"branches of the silicon, decay {decay:.3g}"
    # The silicon takes part where the cell is nearly empty.
    window = (float(rng.choice([0.08, 0.15])), 0.85)
    return _alike(rng, base, replace(base, options=looped), truth, window=window, peak_C=1.2)


def nonlinear_kinetics(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    for electrode in ELECTRODES:
        scale(base.values, f"{electrode} particle diffusivity [m2.s-1]", 8.0)
        scale(base.values, f"{electrode} electrode exchange-current density [A.m-2]", float(rng.uniform(0.3, 1.0)))
    scale(base.values, "Electrolyte diffusivity [m2.s-1]", 4.0)
    scale(base.values, "Electrolyte conductivity [S.m-1]", 4.0)
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
    scale(values, "SEI solvent diffusivity [m2.s-1]", factor)
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
    scale(values, f"{electrode} particle diffusivity [m2.s-1]", factor)
    return _alike(rng, base, replace(base, values=values), f"{electrode} diffusivity x {factor:.2f}")


def soc_dependent_resistance(rng: np.random.Generator) -> Case:
    base = a_cell(rng)
    name = "Positive electrode exchange-current density [A.m-2]"
    own = base.values[name]
    steep = float(rng.uniform(1.8, 3.0))
    full, empty = fillings_of(base)

    def even(c_e: Any, c_s_surf: Any, c_s_max: Any, temperature: Any) -> Any:
        return own(c_e, 0.5 * c_s_max, c_s_max, temperature)

    def leaning(c_e: Any, c_s_surf: Any, c_s_max: Any, temperature: Any) -> Any:
        soc = (c_s_surf / c_s_max - empty[1]) / (full[1] - empty[1])
        return even(c_e, c_s_surf, c_s_max, temperature) * pybamm.exp(steep * (soc - 0.5))

    values = base.values.copy()
    values[name] = leaning
    base.values[name] = even
    return _alike(
        rng,
        base,
        replace(base, values=values),
        f"exchange current of the positive electrode x exp({steep:.2f} (SoC - 0.5))",
    )


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
    return _alike(
        rng, replace(base, values=still), replace(base, values=values), "Arrhenius laws", runs=runs, peak_C=1.5
    )


def _frozen(own: Any) -> Any:
    return (lambda *arguments: own(*arguments[:-1], 298.15)) if callable(own) else own


def _arrhenius(own: Any, activation: float) -> Any:
    def grows(*arguments: Any) -> Any:
        held = own(*arguments[:-1], 298.15) if callable(own) else own
        return held * pybamm.exp(activation / 8.314 * (1.0 / 298.15 - 1.0 / arguments[-1]))

    return grows


def temperature_sensor(rng: np.random.Generator) -> Case:
    base = a_cell(rng, str(rng.choice(_WARM)))
    share = float(rng.uniform(0.25, 0.5))
    case = _alike(rng, base, base, f"{share:.2f} of the warming is read", peak_C=3.0)
    return replace(case, sensors=(case.sensors[0], replace(case.sensors[0], temperature_share=share)))


def thermal_contact(rng: np.random.Generator) -> Case:
    base = a_cell(rng, str(rng.choice(_WARM)))
    share = float(rng.uniform(0.15, 0.35))
    cooling = 25.0
    return _alike(
        rng,
        _with(base, cooling=cooling),
        _with(base, cooling=share * cooling),
        f"heat transfer x {share:.2f}",
        peak_C=3.0,
    )


CASES: dict[str, Callable[[np.random.Generator], Case]] = {
    "capacity_fade": capacity_fade,
    "contact_resistance": contact_resistance,
    "current_offset": current_offset,
    "entropic_effect": entropic_effect,
    "hysteresis": hysteresis,
    "hysteresis_composite": hysteresis_composite,
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
