"""Random cells of strands side by side, and what can change in one."""

import math
from dataclasses import replace

import numpy as np

from simulators.strand_cell import StrandParameters

__all__ = ["STRAND_EFFECTS", "random_strand_cell"]


def random_strand_cell(rng: np.random.Generator) -> StrandParameters:
    """Draw a cell, every constant at random: of 3.5 V with a curve that rises, or of 2.3 V with a flat one."""

    def near(value: float, spread: float = 1.4) -> float:
        return value * float(np.exp(rng.uniform(-1.0, 1.0) * math.log(spread)))

    capacity_Ah = float(rng.uniform(1.0, 30.0))
    flat = bool(rng.random() < 0.4)
    steps = (
        ((near(0.10), near(0.85, 1.05), near(0.05)), (near(0.05), near(0.35), near(0.06)))
        if flat
        else ((near(0.25), near(0.72, 1.1), near(0.12)), (near(0.12), near(0.3), near(0.1)))
    )
    strands = int(rng.integers(3, 7))
    shares = tuple(near(1.0, 1.5) for _ in range(strands))
    return StrandParameters(
        capacity_Ah=capacity_Ah,
        full_V=float(rng.uniform(2.5, 2.7) if flat else rng.uniform(4.05, 4.25)),
        steps=steps,
        tilt_V=near(0.12 if flat else 0.5),
        knee_V=near(0.3 if flat else 0.5),
        knee_at=near(0.03),
        share=shares,
        strand_Ohm=tuple(near(0.05, 2.0) / capacity_Ah for _ in range(strands)),
        bend=float(rng.uniform(0.0, 0.35)),
        bend_A=near(1.0, 2.0) * capacity_Ah,
        slow_Ohm=near(0.03) / capacity_Ah,
        slow_s=near(90.0, 3.0),
        slow_A=near(3.0, 1.5) * capacity_Ah,
        play_V=near(0.02 if flat else 0.008, 1.8),
        play_wide=near(0.06, 1.8),
        cold=near(0.3),
        cold_bend=float(rng.uniform(-0.02, 0.04)),
        entropy_V_per_K=(float(rng.uniform(-2e-4, 2e-4)), float(rng.uniform(-2e-4, 2e-4))),
        heat_J_per_K=near(18.0) * capacity_Ah,
        cooling_W_per_K=near(0.05) * math.sqrt(capacity_Ah),
    )


# By contract name: parameters with the effect of a size, where 1 is large.
STRAND_EFFECTS = {
    "capacity": lambda p, x: replace(p, capacity_Ah=p.capacity_Ah * (1.0 - 0.15 * x)),
    "charge_discharge_asymmetry": lambda p, x: replace(p, on_charge=x),
    "charge_transfer": lambda p, x: replace(
        p,
        strand_Ohm=tuple(each * (1.0 + x) for each in p.strand_Ohm),
        bend=p.bend + 0.3 * x,
        bend_A=p.bend_A / (1.0 + 5.0 * x),
    ),
    "entropic_voltage": lambda p, x: replace(
        p, entropy_V_per_K=(p.entropy_V_per_K[0] + 1e-3 * x, p.entropy_V_per_K[1] + 1e-3 * x)
    ),
    "heat_transfer": lambda p, x: replace(p, cooling_W_per_K=p.cooling_W_per_K / (1.0 + x)),
    "hysteresis": lambda p, x: replace(p, play_V=p.play_V + 0.06 * x),
    "ocv_shape": lambda p, x: replace(p, moved_V=0.04 * x),
    "relaxation": lambda p, x: replace(p, slow_Ohm=p.slow_Ohm * (1.0 + 3.0 * x)),
    "resistance_growth": lambda p, x: replace(p, growth_per_Ah=0.3 * x / p.capacity_Ah),
    "self_discharge": lambda p, x: replace(p, leakage_A=0.01 * p.capacity_Ah * x),
    "series_resistance": lambda p, x: replace(p, series_Ohm=0.03 * x / p.capacity_Ah),
    "soc_dependence": lambda p, x: replace(p, near_empty=3.0 * x),
    "temperature_dependence": lambda p, x: replace(p, cold=p.cold * (1.0 + 1.5 * x)),
}
