import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background
from models.diagnosis.likelihood.shapes import Linear
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.verdict import Tried, judge, try_shapes
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


def curve_against_a_loss(extra_V: float) -> tuple[Background, list[Tried]]:
    """A moved curve that can be anything, beside lost lithium, which is nearly all of it."""
    bumps = np.stack([np.exp(-0.5 * ((TIME - each) / 0.1) ** 2) for each in np.linspace(0.0, 1.0, 8)], axis=1)
    slipped = bumps @ np.array([0.4, -1.0, 0.7, 0.2, -0.9, 1.0, 0.1, -0.5])
    error_V = 0.02 * slipped + extra_V * bumps[:, 3]
    back = against(1e-4 * TIME, error_V)
    shapes = {"ocv_shape": 0.01 * bumps, "lithium_loss": 0.01 * slipped[:, None], "relaxation": 0.01 * TIME[:, None]}
    return back, [try_shapes(back, effect(name), (Linear(each, (), (), 0),)) for name, each in shapes.items()]


def test_a_cause_of_one_size_stands_before_a_free_curve_that_explains_hardly_more() -> None:
    back, tried = curve_against_a_loss(4e-3)
    curve, loss, _ = (each.weighed.log_likelihood for each in tried)
    assert THRESHOLDS.as_good * curve < loss < curve
    verdict = judge(back, tried, N)
    (first, named), (second, rival) = verdict.single[:2]
    assert (named.effect.name, rival.effect.name) == ("lithium_loss", "ocv_shape")
    # They share what spoke for the curve.
    assert second * THRESHOLDS.rival > first > second


def test_one_that_explains_clearly_less_does_not() -> None:
    back, tried = curve_against_a_loss(0.0)
    poor = Linear(tried[1].columns + 0.02 * np.cos(31.0 * TIME)[:, None], (), (), 0)
    tried[1] = try_shapes(back, effect("lithium_loss"), (poor,))
    assert tried[1].weighed.log_likelihood < THRESHOLDS.as_good * tried[0].weighed.log_likelihood
    assert judge(back, tried, N).single[0][1].effect.name == "ocv_shape"
