from dataclasses import replace

import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.information.experiment import Evaluator
from models.design.optimise.block_design import DesignRequest
from models.design.optimise.sequential import sequential_design
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import ModelRecord
from tests.unit.models.design.networks import experiment, resistive

DT_S = 10.0
REQUEST = DesignRequest(Limits((-6.0, 4.0), (0.1, 0.9)), 20_000.0, soc_levels=(0.3, 0.5, 0.7), n_starts=2)
TRUTH = resistive()


class Bench:
    """Plays on the true network with noise, and keeps what it played."""

    def __init__(self) -> None:
        self.played: list[np.ndarray] = []
        self.starts: list[float] = []

    def play(self, current: np.ndarray, soc: float) -> TimeSeries:
        self.played.append(current)
        self.starts.append(soc)
        voltage = Evaluator(experiment(initial_soc=soc), len(current)).predict(current).voltage_V
        noise = 2e-3 * np.random.default_rng(len(self.played)).standard_normal(len(current))
        return TimeSeries(DT_S * np.arange(len(current)), current, voltage + noise, np.full(len(current), 25.0))

    @property
    def current(self) -> np.ndarray:
        return np.concatenate(self.played)


def keep(runs: list[TimeSeries], starts: list[float]) -> LocalModelNetwork:
    return TRUTH


def test_it_ends_when_every_parameter_is_known_as_well_as_asked() -> None:
    full = sequential_design(experiment(), REQUEST, 1e-12, Bench().play, keep)
    assert not full.reached and len(full.rounds) == 5 and full.saved_h < 0.2
    asked = full.rounds[2].largest_std * 1.001
    early = sequential_design(experiment(), REQUEST, asked, Bench().play, keep)
    assert early.reached and len(early.rounds) == 3
    assert early.saved_h == pytest.approx((early.planned_s - early.played_s) / 3600.0) and early.saved_h > 0.5
    # However little is asked for: not before every level has been visited.
    assert len(sequential_design(experiment(), REQUEST, 1e9, Bench().play, keep).rounds) == 3
    stds = [each.mean_std for each in full.rounds]
    assert stds == sorted(stds, reverse=True)


def test_what_is_played_hangs_together_and_keeps_the_limits() -> None:
    bench = Bench()
    found = sequential_design(experiment(), REQUEST, 1e-12, bench.play, keep)
    soc = 0.5 + np.concatenate([[0.0], np.cumsum(bench.current)]) * DT_S / 7200.0
    assert soc.min() >= 0.1 - 1e-9 and soc.max() <= 0.9 + 1e-9
    at = np.cumsum([0, *(len(piece) for piece in bench.played)])[:-1]
    np.testing.assert_allclose(soc[at], bench.starts, atol=1e-9)
    assert found.played_s == len(bench.current) * DT_S


def test_each_block_is_designed_from_the_model_so_far() -> None:
    """A refit that says that one local model is another one changes what is asked next."""
    theta = TRUTH.theta.copy()
    theta[:, 0] = 0.2
    other = LocalModelNetwork(TRUTH.structure, TRUTH.partition, theta, TRUTH.scaling, TRUTH.cell, TRUTH.record)
    same, changed = Bench(), Bench()
    sequential_design(experiment(), REQUEST, 1e-12, same.play, keep)
    found = sequential_design(experiment(), REQUEST, 1e-12, changed.play, lambda runs, starts: other)
    np.testing.assert_array_equal(same.played[0], changed.played[0])
    assert not np.array_equal(same.played[1], changed.played[1])
    assert found.network is other


def test_a_refit_that_leaves_no_room_designs_nothing() -> None:
    """The next visit is designed with the last network that knew enough of the voltage."""
    request = DesignRequest(
        Limits((-6.0, 4.0), (0.1, 0.9), voltage_V=(3.0, 4.2)), 20_000.0, soc_levels=(0.3, 0.5, 0.7), n_starts=2
    )
    lost = replace(TRUTH, record=ModelRecord(train={"max_mV": 2000.0, "rmse_mV": 1000.0}))
    sure, unsure = Bench(), Bench()
    sequential_design(experiment(), request, 1e-12, sure.play, keep)
    found = sequential_design(experiment(), request, 1e-12, unsure.play, lambda runs, starts: lost)
    assert len(found.rounds) == 5 and found.network is lost
    np.testing.assert_array_equal(sure.current, unsure.current)
    with pytest.raises(InfeasibleError, match="voltage_V"):
        sequential_design(replace(experiment(), network=lost), request, 1e-12, Bench().play, keep)


@pytest.mark.parametrize("target", [0.0, -1.0, np.nan])
def test_bad_accuracies_are_refused(target: float) -> None:
    with pytest.raises(ModelError, match="accuracy"):
        sequential_design(experiment(), REQUEST, target, Bench().play, keep)
