import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background
from models.diagnosis.likelihood.shapes import Linear
from models.diagnosis.likelihood.verdict import judge, try_shapes
from models.effects import effect

N = 60
TIME = np.linspace(0.0, 1.0, N)


def against(open_V: FloatArray, error_V: FloatArray) -> Background:
    """An error of 1 mV beside something open, of which nobody knows the size."""
    return Background(error_V, 1e-6 * np.eye(N) + np.outer(open_V, open_V), 1e-8 * np.eye(N))


def test_an_effect_that_raises_the_error_is_not_named() -> None:
    # What is open and the effect nearly cancel: together they are the small error, each alone is far larger.
    open_V = 0.1 * TIME
    column = 0.02 * (TIME + 0.1 * TIME**2)
    error_V = 3.0 * (column - 0.02 * TIME) + 1e-4 * np.sin(40.0 * TIME)
    one = effect("capacity")
    tried = try_shapes(against(open_V, error_V), one, (Linear(column[:, None], (), (), 0),))
    assert tried.weighed.log_likelihood > 10.0
    verdict = judge(against(open_V, error_V), [tried], N)
    assert verdict.single[0][0] == 0.0


def test_an_effect_that_lowers_it_is() -> None:
    column = 0.02 * np.sin(9.0 * TIME)
    back = against(0.1 * TIME, column)
    tried = try_shapes(back, effect("capacity"), (Linear(column[:, None], (), (), 0),))
    verdict = judge(back, [tried], N)
    assert verdict.something
    assert verdict.single[0][0] > 0.9
