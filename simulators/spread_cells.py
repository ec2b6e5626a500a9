"""Random cells of a spread of relaxation times, and what can change in one."""

import math
from dataclasses import replace

import numpy as np

from simulators.spread_cell import SpreadParameters

__all__ = ["SPREAD_EFFECTS", "random_spread_cell"]


def random_spread_cell(rng: np.random.Generator) -> SpreadParameters:
    """Draw a cell, every constant at random: a steep curve or a flat one with a wide loop."""

    def near(value: float, spread: float = 1.4) -> float:
        return value * float(np.exp(rng.uniform(-1.0, 1.0) * math.log(spread)))

    capacity_Ah = float(rng.uniform(1.0, 20.0))
    flat = bool(rng.random() < 0.4)
    if flat:
        bumps = (
            (near(0.9), -0.06, near(0.02)),
            (near(0.07), near(0.3), near(0.04)),
            (near(0.03), near(0.7, 1.1), 0.02),
        )
    else:
        bumps = (
            (near(0.9), -0.08, near(0.04)),
            (near(0.5), near(0.45), near(0.2)),
            (near(0.5), near(0.9, 1.1), near(0.12)),
        )
    end_V = near(0.4), 1.06, near(0.015 if flat else 0.03)
    return SpreadParameters(
        capacity_Ah=capacity_Ah,
        empty_V=float(rng.uniform(2.9, 3.1) if flat else rng.uniform(3.1, 3.3)),
        bumps=(*bumps, end_V),
        ohmic_Ohm=near(0.045) / capacity_Ah,
        knee_A=near(3.0, 2.0) * capacity_Ah,
        spread_Ohm=near(0.04) / capacity_Ah,
        exponent=float(rng.uniform(-0.2, 0.3)),
        slow_Ohm=near(0.05) / capacity_Ah,
        slow_exponent=float(rng.uniform(-0.1, 0.5)),
        freezing_degC=float(rng.uniform(-110.0, -80.0)),
        brittle_K=near(350.0),
        loop_V=near(0.015 if flat else 0.004, 1.8),
        loop_wide=near(0.08, 1.8),
        entropy_V_per_K=(float(rng.uniform(-2e-4, 2e-4)), float(rng.uniform(-2e-4, 2e-4))),
        core_J_per_K=near(13.0) * capacity_Ah,
        case_J_per_K=near(4.0) * capacity_Ah,
        core_W_per_K=near(0.25) * math.sqrt(capacity_Ah),
        cooling_W_per_K=near(0.05) * math.sqrt(capacity_Ah),
    )


# By contract name: parameters with the effect of a size, where 1 is large.
SPREAD_EFFECTS = {
    "capacity": lambda p, x: replace(p, capacity_Ah=p.capacity_Ah * (1.0 - 0.15 * x)),
    "charge_discharge_asymmetry": lambda p, x: replace(p, on_charge=x),
    "charge_transfer": lambda p, x: replace(p, ohmic_Ohm=p.ohmic_Ohm * (1.0 + x), knee_A=p.knee_A / (1.0 + 10.0 * x)),
    "entropic_voltage": lambda p, x: replace(
        p, entropy_V_per_K=(p.entropy_V_per_K[0] + 1e-3 * x, p.entropy_V_per_K[1] + 1e-3 * x)
    ),
    "heat_transfer": lambda p, x: replace(p, cooling_W_per_K=p.cooling_W_per_K / (1.0 + x)),
    "hysteresis": lambda p, x: replace(p, loop_V=p.loop_V + 0.03 * x),
    "ocv_shape": lambda p, x: replace(p, moved_V=0.04 * x),
    "relaxation": lambda p, x: replace(p, slow_Ohm=p.slow_Ohm * (1.0 + 2.0 * x)),
    "resistance_growth": lambda p, x: replace(p, growth_per_Ah=0.3 * x / p.capacity_Ah),
    "self_discharge": lambda p, x: replace(p, leakage_A=0.01 * p.capacity_Ah * x),
    "series_resistance": lambda p, x: replace(p, series_Ohm=0.03 * x / p.capacity_Ah),
    "soc_dependence": lambda p, x: replace(p, ohmic_at_empty_Ohm=0.15 * x / p.capacity_Ah),
    "temperature_dependence": lambda p, x: replace(p, brittle_K=p.brittle_K * (1.0 + 1.5 * x)),
}
