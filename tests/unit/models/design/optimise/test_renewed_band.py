"""An ascent whose voltage band depends on the current."""

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray
from models.design.constraints.feasible import Demands, Feasible
from models.design.constraints.limits import Limits
from models.design.information.experiment import Experiment, Prediction
from models.design.optimise.ascent import optimise
from tests.unit.models.design.networks import experiment

LIMITS = Limits((-6.0, 6.0), (0.2, 0.8), voltage_V=(3.3, 3.8))


@dataclass(frozen=True)
class GrowingBand:
    """5 mV at rest and more with each ampere that flows on average."""

    def width_V(self, experiment: Experiment, current_A: FloatArray, prediction: Prediction) -> FloatArray:
        return np.full(len(current_A), 5e-3 + 0.02 * float(np.abs(current_A).mean()))


def test_the_best_climb_on_with_the_band_at_their_own_currents() -> None:
    demands = Demands(LIMITS, band=GrowingBand())
    found = optimise(experiment(), demands, 120, n_starts=6, seed=2)
    feasible = Feasible(experiment(), demands, 120)
    assert feasible.excess(found.current_A) == {}
    # The band is not far wider than the room that is left: the current has been moved, not shrunk to rest.
    low, high = feasible.voltage_band_V(found.current_A)
    assert high.max() > 3.8 - 0.02 or low.min() < 3.3 + 0.02
