"""Random cells of two particles, and what can change in one."""

import math
from dataclasses import replace

import numpy as np

from simulators.particle_cell import Electrode, ParticleParameters

__all__ = ["PARTICLE_AGEING", "PARTICLE_EFFECTS", "aged", "random_particle_cell"]


def random_particle_cell(rng: np.random.Generator) -> ParticleParameters:
    """Draw a cell: graphite against a layered oxide or an olivine, every constant at random."""

    def near(value: float, spread: float = 1.4) -> float:
        return value * float(np.exp(rng.uniform(-1.0, 1.0) * math.log(spread)))

    capacity_Ah = float(rng.uniform(1.5, 6.0))
    graphite = Electrode(
        at_empty=near(0.02, 1.5),
        at_full=near(0.84, 1.06),
        curve=((near(0.30), 0.0, 0.04), (near(0.06), near(0.18), 0.05), (near(0.035), near(0.52, 1.08), near(0.02))),
        base_V=0.24,
        slope_V=near(0.05),
        diffusion_s=near(4000.0, 2.0),
        crowding=float(rng.uniform(-1.0, 1.0)),
        exchange_A=near(1.2, 2.0) * capacity_Ah,
        transfer=float(rng.uniform(0.35, 0.65)),
        kinetics_K=near(5500.0),
        diffusion_K=near(3500.0),
        entropy_V_per_K=(float(rng.uniform(-1e-4, 1e-4)), float(rng.uniform(-2e-4, 2e-4))),
    )
    olivine = bool(rng.random() < 0.4)
    steps = ((near(0.10), 0.03, 0.015), (near(0.14), 0.98, 0.015)) if olivine else ((near(0.25), near(0.6, 1.1), 0.12),)
    positive = Electrode(
        at_empty=near(0.93, 1.02),
        at_full=near(0.06 if olivine else 0.28, 1.2),
        curve=steps,
        base_V=3.46 if olivine else 4.45,
        slope_V=near(0.02 if olivine else 0.75),
        diffusion_s=near(2500.0, 2.0),
        crowding=float(rng.uniform(-1.0, 1.0)),
        exchange_A=near(0.8, 2.0) * capacity_Ah,
        transfer=float(rng.uniform(0.35, 0.65)),
        kinetics_K=near(4500.0),
        diffusion_K=near(2500.0),
        entropy_V_per_K=(float(rng.uniform(-1e-4, 1e-4)), float(rng.uniform(-1e-4, 1e-4))),
    )
    return ParticleParameters(
        capacity_Ah=capacity_Ah,
        negative=graphite,
        positive=positive,
        film_Ohm=near(0.045) / capacity_Ah,
        film_K=near(1500.0, 2.0),
        electrolyte_V=near(0.012),
        electrolyte_A=near(8.0) * capacity_Ah,
        electrolyte_s=(near(60.0), near(8.0)),
        lag_V=near(0.012 if olivine else 0.005, 2.0),
        lag_rate=near(25.0, 2.0),
        heat_J_per_K=near(17.0) * capacity_Ah,
        cooling_W_per_K=near(0.05) * math.sqrt(capacity_Ah),
    )


def _replaced(p: ParticleParameters, electrode: str, **changes: float) -> ParticleParameters:
    return replace(p, **{electrode: replace(getattr(p, electrode), **changes)})


def aged(
    p: ParticleParameters, lithium: float = 0.0, negative: float = 0.0, positive: float = 0.0
) -> ParticleParameters:
    """Return the cell without some lithium, or material with the lithium that it held when the cell was half full.

    The aged cell is empty and full at the voltages at which the fresh one is.

    Parameters
    ----------
    p : fresh
    lithium : over the fresh capacity
    negative, positive : shares of the electrodes' material
    """
    n, c = p.negative, p.positive
    size_n, size_c = 1.0 / (n.at_full - n.at_empty), 1.0 / (c.at_empty - c.at_full)
    half_n, half_c = 0.5 * (n.at_full + n.at_empty), 0.5 * (c.at_full + c.at_empty)
    held = n.at_empty * size_n + c.at_empty * size_c - lithium - negative * half_n * size_n - positive * half_c * size_c
    size_n, size_c = size_n * (1.0 - negative), size_c * (1.0 - positive)

    def charge_at(volts: float) -> float:
        """Charge in the negative electrode at which the cell rests there: halved, for it rises with the charge."""
        low, high = 0.0, size_n
        for _ in range(60):
            middle = 0.5 * (low + high)
            rest_V = c.potential_V((held - middle) / size_c) - n.potential_V(middle / size_n)
            low, high = (middle, high) if rest_V < volts else (low, middle)
        return low

    empty, full = (
        charge_at(c.potential_V(each_c) - n.potential_V(each_n))
        for each_n, each_c in ((n.at_empty, c.at_empty), (n.at_full, c.at_full))
    )
    return replace(
        p,
        capacity_Ah=p.capacity_Ah * (full - empty),
        negative=replace(n, at_empty=empty / size_n, at_full=full / size_n),
        positive=replace(c, at_empty=(held - empty) / size_c, at_full=(held - full) / size_c),
    )


# By contract name: parameters with the effect of a size, where 1 is large.
PARTICLE_EFFECTS = {
    "capacity": lambda p, x: replace(p, capacity_Ah=p.capacity_Ah * (1.0 - 0.15 * x)),
    "charge_discharge_asymmetry": lambda p, x: replace(p, film_on_charge=x),
    "charge_transfer": lambda p, x: _replaced(p, "positive", exchange_A=p.positive.exchange_A / (1.0 + 3.0 * x)),
    "entropic_voltage": lambda p, x: replace(p, entropy_V_per_K=1e-3 * x),
    "heat_transfer": lambda p, x: replace(p, cooling_W_per_K=p.cooling_W_per_K / (1.0 + x)),
    "hysteresis": lambda p, x: replace(p, lag_V=p.lag_V + 0.03 * x),
    "ocv_shape": lambda p, x: _replaced(p, "negative", at_full=p.negative.at_full - 0.1 * x),
    "relaxation": lambda p, x: _replaced(p, "negative", diffusion_s=p.negative.diffusion_s * (1.0 + 3.0 * x)),
    "resistance_growth": lambda p, x: replace(p, film_growth_per_Ah=0.3 * x / p.capacity_Ah),
    "self_discharge": lambda p, x: replace(p, leakage_A=0.01 * p.capacity_Ah * x),
    "series_resistance": lambda p, x: replace(p, series_Ohm=0.03 * x / p.capacity_Ah),
    "soc_dependence": lambda p, x: replace(p, film_at_empty_Ohm=0.15 * x / p.capacity_Ah),
    "temperature_dependence": lambda p, x: replace(p, film_K=p.film_K + 4000.0 * x),
}
# The same for what ages: apart, so that what is drawn from the effects above stays what it was.
PARTICLE_AGEING = {
    "active_material_loss": lambda p, x: aged(p, negative=0.25 * x),
    "lithium_loss": lambda p, x: aged(p, lithium=0.15 * x),
}
