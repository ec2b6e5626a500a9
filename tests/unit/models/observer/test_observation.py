"""What is said of a run beside its estimates."""

from dataclasses import replace

import numpy as np
import pytest

from models.observer import FuzzyObserver
from models.observer.health import MODEL, REASONS, alarms_of
from models.observer.observation import observe
from tests.unit.models import synthetic


@pytest.mark.parametrize(("away_K", "word"), [(-15.0, "colder"), (15.0, "warmer"), (0.0, None), (1.0, None)])
def test_it_is_said_that_a_run_is_colder_or_warmer_than_all_that_was_trained(
    fitted: FuzzyObserver, away_K: float, word: str | None
) -> None:
    low, high = fitted.network.record.domain["temperature_degC"]
    temperature = (low if away_K < 0.0 else high) + away_K
    run = replace(synthetic.run(300, seed=5, noise_V=1e-3), temperature_degC=np.full(300, temperature))
    said = [each for each in observe(fitted, run, 0.6, 0.02).alarms if "made from" in each]
    assert len(said) == (0 if word is None else 1)
    for each in said:
        assert each.startswith(f"100 % of the samples are {word} than any run")
        assert f"here {temperature:.0f} degC" in each


def test_nothing_is_said_of_a_temperature_that_nobody_measured(fitted: FuzzyObserver) -> None:
    run = replace(synthetic.run(300, seed=5, noise_V=1e-3), temperature_degC=np.full(300, np.nan))
    assert not [each for each in observe(fitted, run, 0.6, 0.02).alarms if "made from" in each]


def test_an_alarm_of_a_few_samples_is_not_told_as_no_share() -> None:
    watched = np.zeros((3000, 3))
    watched[-1, 2] = MODEL
    assert alarms_of(watched) == [f"{REASONS[MODEL]} (1 of its 3000 samples)"]
    watched[-30:, 2] = MODEL
    assert alarms_of(watched) == [f"{REASONS[MODEL]} (1.0 % of the run)"]
