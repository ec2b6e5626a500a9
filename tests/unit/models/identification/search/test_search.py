"""The search as a whole: what is chosen, what is tried, and what is kept of it."""

from dataclasses import replace

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.identification.progress import silent
from models.identification.search.candidate import Candidate
from models.identification.search.chooser import Chooser
from models.identification.search.search import Search
from models.identification.search.temperature_parts import temperature_parts
from models.network.regression import CellContext
from models.network.structure import minimal_structure
from tests.unit.models import synthetic


@pytest.fixture(scope="module")
def search() -> Search:
    runs = [to_grid(synthetic.run(1500, seed=seed, noise_V=1e-3), 1.0) for seed in (1, 2)]
    return Search(runs, [0.6, 0.6], CellContext(synthetic.CAPACITY_AH), silent)


def test_a_candidate_is_judged_once_and_stands_in_the_table(search: Search) -> None:
    candidate = Candidate("minimal", n_models=3)
    error_V = search.judge.error_V(candidate, candidate)
    before = len(search.table)
    assert search.judge.error_V(candidate, candidate) == error_V > 0.0
    assert len(search.table) == before
    row = next(each for each in search.table if each["n_models"] == 3)
    assert row["held_out_rmse_mV"] == 1e3 * error_V and row["n_models_built"] <= 3


def test_the_present_choice_stays_unless_another_is_worth_the_change(search: Search) -> None:
    said: list[str] = []
    chooser = Chooser(search.judge, lambda _share, text: said.append(text))
    one, more = Candidate("minimal", n_models=1), Candidate("minimal", n_models=6)
    errors = {each: search.judge.error_V(each, one) for each in (one, more)}
    chosen = chooser.choose(one, [more, one], 0.5)
    assert chosen == (more if errors[more] < 0.995 * errors[one] else one)
    assert len(said) == 2 and all(text.startswith("trying poles") for text in said)


def test_beginning_again_forgets_errors_and_keeps_the_table(search: Search) -> None:
    candidate = Candidate("minimal", n_models=3)
    search.judge.error_V(candidate, candidate)
    rows, strengths = len(search.table), search.judge.strengths(candidate)
    search.judge.begin_again()
    assert len(search.table) == rows and search.judge.strengths(candidate) == strengths is not None


def test_a_given_structure_gets_poles_and_a_size_and_is_fitted(search: Search) -> None:
    given = minimal_structure(1.0)
    chosen = search.best_within(given)
    assert chosen.given == given and len(chosen.poles_s) == given.output_order
    assert all(pole >= search.fastest_s for pole in chosen.poles_s)
    fitted = search.fitted(chosen)
    assert fitted.theta.shape == (fitted.partition.n_models, given.n_regressors)
    assert fitted.held_out_rmse_V < 0.02


@pytest.mark.parametrize(
    ("degC", "parts"),
    [((25.0, 25.2), 1), ((10.0, 40.0), 2), ((10.0, 25.0, 40.0), 3), ((25.0,) * 300 + (40.0,), 1)],
)  # fmt: skip
def test_only_temperatures_that_were_measured_in_have_a_part(degC: tuple[float, ...], parts: int) -> None:
    run = synthetic.run(1500, seed=1, noise_V=1e-3)
    moved = replace(run, temperature_degC=np.resize(np.repeat(degC, max(1, 1500 // len(degC))), 1500))
    search = Search([to_grid(moved, 1.0)], [0.6], CellContext(synthetic.CAPACITY_AH), silent)
    assert temperature_parts(search.judge.bank) == parts
    chosen = search.best("full")
    assert isinstance(chosen, Candidate) and chosen.temperature_parts == parts
    assert [axis.initial for axis in chosen.structure(1.0).axes] == [1, 2, parts]
