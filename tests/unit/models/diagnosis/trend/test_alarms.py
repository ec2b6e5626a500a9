import numpy as np
import pytest

from models.diagnosis.trend.alarms import claimed, lasting


def test_one_run_needs_what_a_diagnosis_needs() -> None:
    assert claimed(np.array([0.04]), 0.5, 0.05).tolist() == [True]
    assert claimed(np.array([0.06]), 0.5, 0.05).tolist() == [False]


def test_one_among_many_needs_more_and_many_alike_need_no_more() -> None:
    many = np.full(100, 0.5)
    many[3] = 0.01
    assert not claimed(many, 0.5, 0.05).any()
    many[3] = 1e-5
    assert np.flatnonzero(claimed(many, 0.5, 0.05)).tolist() == [3]
    assert claimed(np.full(100, 0.04), 0.5, 0.05).all()


def test_few_claims_are_false_where_nothing_is_new() -> None:
    """Odds of mean one are the worst there can be: twenty with the chance of one in twenty, else none."""
    rng = np.random.default_rng(1)
    odds = np.where(rng.uniform(size=(400, 50)) < 0.05, 20.0, 1e-9)
    false = [claimed(1.0 / (1.0 + each), 0.5, 0.05).any() for each in odds]
    assert np.mean(false) <= 0.05


@pytest.mark.parametrize("prior", [0.5, 0.9])
def test_what_was_likely_before_is_no_evidence(prior: float) -> None:
    odds = 30.0
    nothing = prior / (prior + (1.0 - prior) * odds)
    assert claimed(np.array([nothing]), prior, 0.05).all()
    assert not claimed(np.array([nothing, 0.99]), prior, 0.05).any()


def test_what_was_borne_out_once_lasts_where_later_runs_lean_to_it() -> None:
    said = np.array([False, False, True, False, False, False])
    alone = np.array([0.3, 0.3, 0.001, 0.3, 0.8, 0.3])
    together = np.array([0.01, 0.01, 0.001, 0.01, 0.01, 0.4])
    assert lasting(said, alone, together, 0.5, 0.05).tolist() == [False, False, True, True, False, False]
    assert not lasting(np.zeros(6, dtype=bool), alone, together, 0.5, 0.05).any()
