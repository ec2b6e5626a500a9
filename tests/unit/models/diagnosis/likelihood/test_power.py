"""The smallest size that would have been told: as often as promised, and larger where less can be seen."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from models.diagnosis.likelihood.analysis import analyse
from models.diagnosis.likelihood.background import Background
from models.diagnosis.likelihood.power import first_direction, power_of, smallest_shown
from models.diagnosis.likelihood.shapes import Linear, Moving
from models.diagnosis.likelihood.sight import Sight
from models.diagnosis.likelihood.thresholds import THRESHOLDS
from models.diagnosis.likelihood.tried import Tried, try_shapes
from models.effects import effect, effects
from models.effects.effect import Parameter
from models.effects.expected import Told
from tests.unit.models.diagnosis.known.hand_cell import SOC, known_runs, trained

N, PRIOR = 60, 0.02
FIXED_V2 = 1e-6 * np.eye(N)
ELSEWHERE_V2 = 4e-6 * np.exp(-np.abs(np.subtract.outer(np.arange(N), np.arange(N))) / 8.0)
# A resistance of 5 mOhm, usual for it, under a current that goes both ways.
CURRENT_A = 2.0 * np.sign(np.sin(np.arange(N) / 3.0))
USUAL_OHM = 5e-3


@dataclass(frozen=True)
class _Told:
    weights: tuple[float, ...] = (USUAL_OHM,)
    name: str = "resistance_Ohm"
    unit: str = "Ohm"


@dataclass(frozen=True)
class _Shape:
    told: tuple[_Told, ...] = (_Told(),)


@dataclass(frozen=True)
class _Tried:
    columns: np.ndarray
    shape: _Shape = _Shape()


def tried(share: float = 1.0) -> Tried:
    """An effect that shows in a share of what a resistance does."""
    return cast(Tried, cast(Any, _Tried(share * USUAL_OHM * CURRENT_A[:, None])))


@dataclass(frozen=True)
class _Lost:
    parameters: tuple[Parameter, ...] = (Parameter("share_lost", "1", "what is lost"),)


@dataclass(frozen=True)
class _Moved:
    shape: Moving
    columns: np.ndarray
    effect: _Lost = _Lost()


def lost(limits: tuple[float, float], per_usual_V: float = USUAL_OHM, usual: float = 0.1) -> Tried:
    """An effect that is simulated, of which so many usual sizes are possible; a resistance's voltage for each."""

    def simulate(sizes: np.ndarray) -> np.ndarray:
        return per_usual_V * CURRENT_A * sizes[0]

    shape = Moving(
        simulate,
        1,
        ((0.0,),),
        np.array([[limits[0]], [limits[1]]]),
        lambda sizes: (usual * float(sizes[0]),),
        lambda sizes, _view: simulate(sizes),
    )
    return cast(Tried, cast(Any, _Moved(shape, simulate(np.ones(1))[:, None])))


def noise_V(rng: np.random.Generator) -> np.ndarray:
    """An error as it was learned."""
    return np.linalg.cholesky(FIXED_V2 + ELSEWHERE_V2) @ rng.standard_normal(N)


NOISE_V = noise_V(np.random.default_rng(3))


def back(error_V: np.ndarray = NOISE_V, larger: float = 1.0) -> Background:
    return Background(np.sqrt(larger) * error_V, larger * FIXED_V2, larger * ELSEWHERE_V2)


def shown(of: Tried, larger: float = 1.0, prior: float = PRIOR) -> float:
    return smallest_shown(back(larger=larger), of, prior, np.zeros(N))


def test_a_size_is_said_in_the_unit_of_the_first_figure() -> None:
    direction, name, unit = first_direction(tried())
    assert (name, unit) == ("resistance_Ohm", "Ohm")
    np.testing.assert_allclose(tried().columns @ direction, CURRENT_A)  # V of one Ohm


def test_what_shows_less_or_stands_in_a_larger_error_must_be_larger() -> None:
    size = shown(tried())
    assert 1e-4 < size < 1e-2
    # Half of what shows is a usual size twice as large in its unit.
    assert shown(tried(0.5)) == pytest.approx(2.0 * size, rel=0.15)
    assert shown(tried(), larger=4.0) == pytest.approx(2.0 * size, rel=0.15)
    assert shown(tried(), prior=1e-4) > 1.05 * size
    assert np.isinf(shown(tried(1e-9)))


def test_an_effect_of_that_size_is_told_as_often_as_promised() -> None:
    rng = np.random.default_rng(5)
    column = tried().columns
    size = float(np.median([smallest_shown(back(noise_V(rng)), tried(), PRIOR, np.zeros(N)) for _ in range(20)]))
    needed = np.log(THRESHOLDS.nothing * (1.0 / THRESHOLDS.claim - 1.0) / PRIOR) / THRESHOLDS.tempering

    def share_told(of_the_size: float) -> float:
        errors = (of_the_size * size * CURRENT_A + noise_V(rng) for _ in range(150))
        return float(np.mean([back(error_V).weigh(column).log_likelihood > needed for error_V in errors]))

    assert share_told(1.0) > THRESHOLDS.power - 0.1
    assert share_told(1.4) > THRESHOLDS.power
    assert share_told(0.5) < 0.5
    assert share_told(0.0) < 0.02


def test_a_share_that_is_lost_shows_as_what_grows_in_proportion_does() -> None:
    size = shown(tried())
    # A tenth is what USUAL_OHM makes of the voltage.
    assert shown(lost((-0.25, 5.0))) == pytest.approx(0.1 * size / USUAL_OHM, rel=0.05)
    assert shown(lost((-5.0, 5.0))) == pytest.approx(0.1 * size / USUAL_OHM, rel=0.05)


def test_no_size_is_said_that_is_not_possible() -> None:
    size = shown(lost((-5.0, 5.0))) / 0.1  # in usual ones
    for furthest in (0.5 * size, 2.0 * size):
        of = lost((-0.05 * furthest, furthest))
        assert np.isinf(shown(of)) == (furthest < size)
    # Both ways are possible, and one of them shows nothing.
    assert np.isinf(shown(lost((-0.5 * size, 2.0 * size))))


def test_an_effect_of_many_shapes_shows_by_the_size_that_most_of_them_ask() -> None:
    told = (Told("resistance_Ohm", "Ohm", (USUAL_OHM,)),)
    # The last two are a loop near empty alone in a log that stays half full.
    seen = (1.0, 0.9, 0.3, 0.6, 0.8, 0.01, 1e-6)
    shapes = tuple(
        Linear(share * USUAL_OHM * CURRENT_A[:, None], told, (), number) for number, share in enumerate(seen)
    )
    one = try_shapes(back(), effect("series_resistance"), shapes)
    sight = cast(Sight, cast(Any, SimpleNamespace(n_voltage=N)))
    (power,) = power_of(sight, back(), [one], (), (), np.zeros(N))
    prior = 0.3
    alone = [smallest_shown(back(), try_shapes(back(), one.effect, (each,)), prior, np.zeros(N)) for each in shapes]
    assert alone[-1] > 50.0 * alone[0] and min(alone) < power.size < alone[2]
    # The most demanding one of those whose own size is no larger.
    assert power.rms_V == pytest.approx(0.6 * power.size * float(np.sqrt(np.mean(CURRENT_A**2))))
    rng, needed = np.random.default_rng(6), np.log(THRESHOLDS.nothing * (1.0 / THRESHOLDS.claim - 1.0) / prior)

    def share_told(size: float) -> float:
        """Of logs with that size of any of the five shapes, how many are told from nothing by just this shape."""
        found = []
        for share, shape in zip(seen[:5], shapes, strict=False):
            errors = (share * size * CURRENT_A + noise_V(rng) for _ in range(80))
            found += [back(error_V).weigh(shape.columns).log_likelihood for error_V in errors]
        return float(np.mean(np.array(found) > needed / THRESHOLDS.tempering))

    assert share_told(power.size) == pytest.approx(THRESHOLDS.power, abs=0.06)
    assert share_told(0.6 * power.size) < THRESHOLDS.power - 0.1


def test_what_no_size_of_shows_is_said_and_is_none_of_those_that_hide_best() -> None:
    still = replace(trained(3), ambient_degC=None)
    analysis = analyse(known_runs(), [still], [SOC], None, list(effects().values()))
    of = {each.effect.name: each for each in analysis.power}
    assert set(of) == set(effects())
    # The temperature neither moves nor is it known what the chamber's is.
    never = {"temperature_dependence", "heat_transfer", "reversible_heat"}
    assert all(np.isinf(of[name].size) for name in never)
    assert np.isfinite(of["series_resistance"].size)
    assert len(analysis.hides_best) == 3
    assert not never.intersection(analysis.hides_best)
