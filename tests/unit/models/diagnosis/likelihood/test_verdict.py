from dataclasses import replace

import numpy as np
import pytest

from models.data.timeseries import FloatArray
from models.diagnosis.likelihood.background import Background, Weighed
from models.diagnosis.likelihood.shapes import Linear, Moving
from models.diagnosis.likelihood.simpler import Simpler, price_of_shape
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.tried import Tried, together, try_shapes, weigh_both
from models.diagnosis.likelihood.verdict import Verdict, as_whole_loss, chances_of, in_other_explanations, judge
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


@pytest.mark.parametrize(("name", "stands"), [("relaxation", True), ("voltage_offset", False)])
def test_what_the_start_hides_is_no_error_that_an_overvoltage_raises(name: str, stands: bool) -> None:
    # A slow effect, most of which is taken back by what went on before the log began.
    began_V, slow_V = 0.02 * np.exp(-TIME / 0.5), 0.02 * np.exp(-TIME / 0.5) + 0.004 * np.sin(9.0 * TIME)
    error_V = slow_V - began_V
    fixed_V2 = 1e-6 * np.eye(N) + np.outer(began_V, began_V)
    shown = {}
    for starts in (None, began_V[:, None]):
        back = Background(error_V, fixed_V2, 1e-8 * np.eye(N), starts=starts)
        tried = try_shapes(back, effect(name), (Linear(slow_V[:, None], (), (), 0),))
        shown[starts is None] = judge(back, [tried], N)
    assert shown[True].single[0][0] == 0.0
    assert (shown[False].single[0][0] > 0.5) is stands


@pytest.mark.parametrize(("warms_K", "usual_K", "stands"), [(0.0, 0.1, True), (1.0, 0.1, False), (1.0, 2.0, True)])
def test_a_voltage_that_would_warm_the_cell_otherwise_than_it_was_is_not_named(
    warms_K: float, usual_K: float, stands: bool
) -> None:
    # Half of the points are of the temperature, which nothing moved and which the heat balance is usually off by.
    n = N // 2
    volts, kelvins = 0.02 * np.sin(9.0 * TIME[:n]), warms_K * TIME[:n]
    usual_2 = np.diag(np.repeat([1e-8, usual_K**2], n))
    back = Background(np.concatenate([volts, np.zeros(n)]), np.diag(np.repeat([1e-6, 1e-4], n)), usual_2)
    shape = Linear(np.concatenate([volts, kelvins])[:, None], (), (), 0)
    tried = try_shapes(back, effect("series_resistance"), (shape,))
    sized = replace(tried, weighed=replace(tried.weighed, mean=np.ones(1)))
    assert Simpler(back, [sized], n).single(0) is not stands
    assert Simpler(back, [sized], n).pair(0, 0, sized.contribution) is not stands


def test_an_effect_that_lowers_it_is() -> None:
    column = 0.02 * np.sin(9.0 * TIME)
    back = against(0.1 * TIME, column)
    tried = try_shapes(back, effect("capacity"), (Linear(column[:, None], (), (), 0),))
    verdict = judge(back, [tried], N)
    assert verdict.something
    assert verdict.single[0][0] > 0.9


def test_a_cell_known_to_white_noise_shows_smaller_effects_but_not_which_of_two_it_is() -> None:
    back = against(1e-4 * TIME, 1.5e-3 * np.sin(9.0 * TIME))
    shapes = {"capacity": 0.02 * np.sin(9.0 * TIME), "relaxation": 0.02 * np.sin(9.5 * TIME)}
    tried = [try_shapes(back, effect(name), (Linear(each[:, None], (), (), 0),)) for name, each in shapes.items()]
    careful, known = (judge(replace(back, tempering=each), tried, N) for each in (0.35, 0.7))
    assert 0.0 < known.nothing < careful.nothing
    best = max(each.weighed.log_likelihood for each in tried)
    np.testing.assert_allclose(known.sharper, (0.7 - THRESHOLDS.tempering) * best)
    among = [[p / sum(p for p, _ in verdict.single) for p, _ in verdict.single] for verdict in (careful, known)]
    np.testing.assert_allclose(among[0], among[1])


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


def shape_against_a_constant(extra_V: float) -> tuple[Background, list[Tried]]:
    """A larger resistance, and one bump of its curve over the state of charge, beside something open."""
    bumps = np.stack([np.exp(-0.5 * ((TIME - each) / 0.15) ** 2) for each in np.linspace(0.0, 1.0, 6)], axis=1)
    back = against(1e-4 * TIME, 0.0125 * bumps.sum(axis=1) + extra_V * bumps[:, 3])
    shapes = {"soc_dependence": 0.01 * bumps, "series_resistance": 0.01 * bumps.sum(axis=1)[:, None]}
    return back, [try_shapes(back, effect(name), (Linear(each, (), (), 0),)) for name, each in shapes.items()]


def likeliest(back: Background, tried: list[Tried]) -> str:
    return judge(back, tried, N).single[0][1].effect.name


def test_a_constant_stands_before_a_shape_that_explains_a_little_more() -> None:
    back, tried = shape_against_a_constant(2.7e-3)
    shape, constant = (each.weighed.log_likelihood for each in tried)
    # Beyond a shape's smaller prior weight, but not beyond that of a second change.
    assert THRESHOLDS.tempering * (shape - constant) > np.log(4.0)
    assert likeliest(back, tried) == "series_resistance"


def test_a_shape_that_explains_clearly_more_stands_before_the_constant() -> None:
    assert likeliest(*shape_against_a_constant(2e-2)) == "soc_dependence"


def test_a_shape_pays_no_more_than_the_constant_explains() -> None:
    back, tried = shape_against_a_constant(0.0)
    known = 2.0
    worth = [25.0, known]
    tried = [
        replace(each, weighed=replace(each.weighed, log_likelihood=log)) for each, log in zip(tried, worth, strict=True)
    ]
    logs = np.zeros(2)
    price_of_shape(tried, [], logs, np.zeros(0))
    assert logs.tolist() == [-THRESHOLDS.tempering * known, 0.0]


def test_what_leaves_more_error_than_a_simpler_explanation_is_not_named() -> None:
    # A slope that only what is open hides comes with the second effect, which explains hardly anything.
    open_V = 0.1 * TIME
    column = 0.02 * np.sin(9.0 * TIME)
    second = 0.02 * TIME + 1e-3 * np.cos(25.0 * TIME)
    back = against(open_V, column + 1.5e-2 * np.cos(25.0 * TIME))
    shapes = {"capacity": column, "relaxation": second}
    tried = [try_shapes(back, effect(name), (Linear(each[:, None], (), (), 0),)) for name, each in shapes.items()]
    simpler = Simpler(back, tried, N)
    assert tried[0].weighed.log_likelihood > THRESHOLDS.asked
    assert not simpler.single(0)
    assert simpler.pair(0, 1, together(back, tried)[1])
    assert judge(back, tried, N).pairs[0][0] == 0.0


def test_a_size_beyond_all_usual_ones_is_rarer_than_the_tempered_likelihood_has_it() -> None:
    column = 0.02 * np.sin(9.0 * TIME)[:, None]
    tried = try_shapes(against(0.1 * TIME, column[:, 0]), effect("current_gain"), (Linear(column, (), (), 0),))
    far = 4.0 * max(THRESHOLDS.sizes)
    np.testing.assert_allclose(tried.rare(np.array([far])), -0.5 * (1.0 - THRESHOLDS.tempering) * 16.0)
    assert tried.rare(np.array([1.0])) > -0.1
    assert tried.rare(np.array([far, far])) == 0.0


@pytest.mark.parametrize("start_gain", [0.0, 6.0, 12.0])
def test_an_effect_that_was_not_weighed_has_the_odds_that_it_would_have_had(start_gain: float) -> None:
    far = 2.0 * max(THRESHOLDS.sizes)
    columns = {"series_resistance": 1.4e-4 * np.sin(9.0 * TIME), "current_gain": 1.4e-4 * np.cos(5.0 * TIME)}
    back = against(1e-4 * TIME, far * columns["current_gain"])
    weighed, left = (
        try_shapes(back, effect(name), (Linear(each[:, None], (), (), 0),)) for name, each in columns.items()
    )
    assert left.rare(left.weighed.mean) < -0.5
    verdict = judge(back, [weighed], N, start_gain)
    (chance,) = chances_of(back, verdict, [weighed], [left], N)
    both = judge(back, [weighed, left], N, start_gain)
    (alone,) = (p for p, each in both.single if each is left)
    assert chance / verdict.nothing == pytest.approx(alone / both.nothing)


def test_a_cause_beside_the_whole_loss_of_capacity_or_what_looks_like_it_is_no_explanation() -> None:
    columns = {"capacity": np.sin(9.0 * TIME), "current_gain": np.sin(9.3 * TIME), "lithium_loss": np.cos(5.0 * TIME)}
    back = against(1e-4 * TIME, 0.02 * (columns["capacity"] + columns["lithium_loss"]))
    tried = [
        try_shapes(back, effect(name), (Linear(0.02 * each[:, None], (), (), 0),)) for name, each in columns.items()
    ]
    chances = {frozenset((a.effect.name, b.effect.name)): p for p, a, b in judge(back, tried, N).pairs}
    assert chances[frozenset(("capacity", "lithium_loss"))] == 0.0
    assert chances[frozenset(("current_gain", "lithium_loss"))] == 0.0
    assert chances[frozenset(("capacity", "current_gain"))] > 0.0


def test_a_pair_is_weighed_by_what_a_simulation_bears_out_of_it() -> None:
    shapes = {"capacity": 0.02 * np.sin(9.0 * TIME), "relaxation": 0.02 * np.cos(5.0 * TIME)}
    back = against(1e-4 * TIME, shapes["capacity"] + shapes["relaxation"])
    both = [try_shapes(back, effect(name), (Linear(each[:, None], (), (), 0),)) for name, each in shapes.items()]
    part, more = weigh_both(back, both)
    np.testing.assert_allclose(part, shapes["capacity"] + shapes["relaxation"], atol=1e-3)
    assert -0.5 < more <= 0.0
    # The second one goes no further than half of what its derivative promises.
    limits = np.array([[-8.0], [8.0]])
    slow_V = 0.5 * shapes["relaxation"]
    half = Moving(lambda sizes: slow_V * sizes[0], 1, ((0.0,),), limits, tuple, lambda sizes, _view: slow_V * sizes[0])
    _, less = weigh_both(back, [both[0], replace(both[1], shape=half)])
    assert less < more - 1.0


def test_sizes_in_other_explanations_are_those_that_the_effect_would_have_there() -> None:
    first, second = 0.02 * np.sin(9.0 * TIME), 0.02 * TIME
    back = Background(first + 0.5 * second, 1e-8 * np.eye(N), 1e-12 * np.eye(N))
    loss, slow, cold = (
        try_shapes(back, effect(name), (Linear(each[:, None], (), (), 0),))
        for name, each in (("capacity", first), ("relaxation", second), ("hysteresis", first * TIME))
    )
    verdict = Verdict(0.0, 0.0, ((0.5, loss), (0.4, slow), (0.0, cold)), ((0.09, slow, loss), (0.01, cold, loss)))
    # The pair, in which it is the second; the other pair is too unlikely, and what lacks it says nothing of it.
    ((chance, sizes),) = in_other_explanations(back, verdict, loss, [loss], 1.0)
    assert chance == 0.09
    np.testing.assert_allclose(sizes.mean, [1.0], atol=0.01)
    assert abs(float(loss.weighed.mean[0]) - 1.0) > 0.02
    # Named beside it, what it would be alone is the other explanation.
    ((chance, sizes),) = in_other_explanations(back, verdict, loss, [slow, loss], 1.0)
    assert chance == 0.5
    np.testing.assert_allclose(sizes.mean, loss.weighed.mean)


@pytest.mark.parametrize(
    ("whole", "electrodes", "told"),
    [
        (95.0, False, "capacity"),  # whose curves nobody knows: the shape says little
        (95.0, True, "lithium_loss"),
        (60.0, False, "lithium_loss"),  # far more than a capacity
    ],
)
def test_a_cause_of_a_lost_capacity_rests_on_electrodes_that_are_known(
    whole: float, electrodes: bool, told: str
) -> None:
    weighed = [Weighed(log, np.ones(1), np.eye(1)) for log in (whole, 100.0)]
    names = ("capacity", "lithium_loss")
    shape = Linear(np.zeros((4, 1)), (), (), 0)
    tried = [Tried(effect(n), shape, shape.columns, None, w) for n, w in zip(names, weighed, strict=True)]
    verdict = Verdict(0.0, 0.0, ((0.99, tried[1]), (0.01, tried[0])), ())
    found = as_whole_loss(verdict, tried, [tried[1]], electrodes=electrodes)
    assert (found or (tried[1],))[0].effect.name == told
