"""A surface is moved to where the runs have it."""

from dataclasses import replace

import numpy as np
import pytest

from models.identification.bounded.best_variant import best_variant
from models.identification.bounded.surfaces import Surface, moved_sphere, moved_surface, sphere
from models.identification.bounded.variants import Trials, Variant
from models.network.regression import SignalBank
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.identification.bounded.bank import bank


def ocv_V(soc: np.ndarray) -> np.ndarray:
    """A step of 0.2 V at half charge, which shows where the surface is."""
    return 3.4 + 0.4 * soc + 0.1 * np.tanh((soc - SOC) / 0.03)


def bowl(depth_h: float, tau_s: float, asked: list[Surface]) -> float:
    asked.append((depth_h, tau_s))
    return 1.0 + np.log(depth_h / 0.05) ** 2 + np.log(tau_s / 500.0) ** 2


def test_depth_and_time_constant_go_to_the_least_error() -> None:
    asked: list[Surface] = []
    found = moved_surface(lambda s: bowl(s[0], s[1], asked), (0.02, 200.0, 3500.0), 1.0)
    assert found[0] == pytest.approx(0.05, rel=0.15) and found[1] == pytest.approx(500.0, rel=0.15)
    assert found[2] == 3500.0 and len(asked) < 20


def test_what_does_not_pay_is_left() -> None:
    start = (0.02, 200.0, 3500.0)
    assert moved_surface(lambda s: 1.0 + 1e-3 * float(s != start), start, 1.0) == start
    assert moved_surface(lambda s: 1.0 - 1e-3 * float(s != start), start, 1.0) == start


def test_a_sphere_is_moved_along_its_only_constant_and_its_activation() -> None:
    def error(surface: Surface) -> float:
        assert surface[0] == pytest.approx(surface[1] / 2675.0, rel=0.01)
        return 1.0 + np.log(surface[1] / 300.0) ** 2 + np.log(max(surface[2], 1.0) / 5000.0) ** 2

    found = moved_sphere(error, sphere(150.0, 3500.0), 1.0, moves_K=True)
    assert found[1] == pytest.approx(300.0, rel=0.2) and found[2] == pytest.approx(5000.0, rel=0.2)
    still = moved_sphere(error, sphere(150.0, 3500.0), 1.0, moves_K=False)
    assert still[2] == 3500.0 and still[1] == pytest.approx(300.0, rel=0.2)


def test_no_further_than_runs_can_tell() -> None:
    faster = moved_surface(lambda s: s[1], (0.02, 200.0, 3500.0), 60.0)
    assert 120.0 <= faster[1] < 150.0
    deeper = moved_surface(lambda s: 1.0 / s[0], (0.02, 200.0, 3500.0), 1.0)
    assert 0.1 < deeper[0] <= 0.15


def test_a_cell_whose_surface_lies_between_those_of_the_table() -> None:
    plain, rng = bank(n=6000, seeds=(1,)), np.random.default_rng(3)
    at = plain.values("surface_soc:0.035/90/3500")
    runs = [
        replace(run, voltage_V=ocv_V(soc) + 0.02 * run.current_A + rng.normal(0.0, 1e-3, len(run)))
        for run, soc in zip(plain.runs, at, strict=True)
    ]
    tried = Trials(SignalBank(runs, plain.initial_soc, plain.cell))
    best = best_variant(tried)
    assert best.surface is not None and best.surface not in ((0.02, 200.0, 3500.0), (0.055, 150.0, 3500.0))
    assert best.surface[0] == pytest.approx(0.035, rel=0.3) and best.surface[1] == pytest.approx(90.0, rel=0.4)
    others = [tried.mean(tried.error(v)) for v in tried.known if v.surface != best.surface]
    assert tried.mean(tried.error(best)) < min(others)


def test_where_the_mean_is_the_axis_no_surface_is_moved() -> None:
    tried = Trials(bank(n=3000))
    assert best_variant(tried) == Variant()
