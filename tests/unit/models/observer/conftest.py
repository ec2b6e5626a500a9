"""One fitted observer of the simple cell for all tests of this folder."""

import pytest

from models.observer import FuzzyObserver
from models.observer.tuning.tuning import with_tuned_observer
from models.pipeline.fit import fit_network
from tests.unit.models import synthetic


@pytest.fixture(scope="session")
def fitted() -> FuzzyObserver:
    """Observer of `synthetic`'s cell, fitted to one noisy run."""
    runs = [synthetic.run(5000, seed=2, noise_V=1e-3)]
    return FuzzyObserver(fit_network(runs, capacity_Ah=synthetic.CAPACITY_AH, structure="full").network)


@pytest.fixture(scope="session")
def tuned(fitted: FuzzyObserver) -> FuzzyObserver:
    """The same with the noise that its own data and a further run make most likely."""
    runs = [synthetic.run(5000, seed=seed, noise_V=1e-3) for seed in (2, 3)]
    return FuzzyObserver(with_tuned_observer(fitted.network, runs, [0.6, 0.6]))
