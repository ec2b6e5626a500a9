"""A known cell that is written down, not fitted: a straight open-circuit curve and one resistance."""

from dataclasses import replace
from functools import cache

import numpy as np

from models.data.resampling import GridRun
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.likelihood.learning import know
from models.effects import effects
from models.identification.bounded.variants import Variant
from tests.unit.models.diagnosis.hand_reference import SOC, steps_A, true_run
from tests.unit.models.hand_network import CAPACITY_AH

__all__ = ["SOC", "known_runs", "steps_A", "trained", "true_run"]


def trained(seed: int) -> GridRun:
    """A run of 3.4 V + 0.7 V soc + 0.02 Ohm current that goes through a good part of the state of charge."""
    steps = steps_A(4000, seed, largest_A=4.0)
    slow = 0.5 * CAPACITY_AH * np.sin(2.0 * np.pi * np.arange(4000) / 4000.0)
    run = true_run(steps + slow, noise_V=5e-4, seed=seed)
    return replace(run, name=f"trained {seed}")


@cache
def known_runs() -> KnownRuns:
    """What two such runs tell."""
    return know([trained(1), trained(2)], [SOC, SOC], CAPACITY_AH, list(effects().values()), Variant())
