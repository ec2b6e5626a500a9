"""Of several kinds of networks the one that simulates unseen runs best, the bounded one where they are equals."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from models.comparison.placed_runs import free_run_metrics
from models.data.errors import ModelError
from models.identification.progress import Progress, silent
from models.pipeline import choosing
from models.pipeline.choosing import STRUCTURES, choose, is_physical
from models.pipeline.plans import BoundedNetwork, HeldOutError, SearchedNetwork, expected_V
from models.pipeline.training import Training, training
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import CELL, fitted, run

COUNT = np.full(5, 100.0)


@dataclass(frozen=True)
class Kind:
    """Stands for a plan and what it builds: a kind of network with its errors on outer folds in mV."""

    name: str
    rmse_mV: tuple[float, ...]

    @property
    def structure(self) -> "Kind":
        return self

    @property
    def network(self) -> "Kind":
        return self

    def build(self, _data: object, _report: Progress) -> "Kind":
        return self

    def held_out(self) -> HeldOutError:
        return HeldOutError((1e-3 * np.array(self.rmse_mV)) ** 2, COUNT)

    def held_out_blocks(self) -> HeldOutError:
        return HeldOutError((2.5e-4 * np.array(self.rmse_mV)) ** 2, COUNT)

    def best(self, family: str) -> "Kind":
        return replace(self, name=family)


def automatic(
    monkeypatch: pytest.MonkeyPatch, bounded: list[float], others: list[float], physical: bool = True
) -> choosing.Chosen:
    """What `auto` takes where all searched networks do as well as each other, and are physical or not."""
    monkeypatch.setattr(choosing, "is_physical", lambda _network: physical)
    monkeypatch.setattr(choosing, "_bounded", lambda *_: Kind("bounded", tuple(bounded)))
    monkeypatch.setattr(choosing, "_search", lambda *_: Kind("", tuple(others)))
    monkeypatch.setattr(choosing, "SearchedPlan", lambda _search, chosen: chosen)
    return choose(Noise(0.5), "auto", (), silent)  # pyright: ignore[reportArgumentType]


@dataclass(frozen=True)
class Noise:
    """Stands for training data of which only the noise, the number of runs and the temperature are asked."""

    noise_floor_mV: float | None
    grid: tuple[int, ...] = (0, 1, 2, 3, 4)
    has_temperature: bool = True


def name_of(chosen: choosing.Chosen) -> str:
    return chosen.built.network.structure.name


def test_within_one_standard_error_the_bounded_network_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    scattered = automatic(monkeypatch, [5.0, 5.0, 5.0, 5.0, 5.0], [3.0, 7.0, 3.0, 7.0, 4.5])
    assert name_of(scattered) == "bounded"
    assert [each["structure"] for each in scattered.compared] == ["bounded", "searched", "full", "minimal"]
    assert scattered.compared[0]["held_out_rmse_mV"] == pytest.approx(5.0)


def test_beyond_it_the_better_one_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    better = automatic(monkeypatch, [5.0, 5.0, 5.0, 5.0, 5.0], [4.0, 4.2, 3.8, 4.1, 3.9])
    assert name_of(better) == "searched"
    assert better.held_out.rmse_V == pytest.approx(4e-3, rel=0.01)
    assert len(better.compared) == 4


def test_of_blocks_more_is_asked_than_of_whole_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    bounded, others = [5.0, 5.0, 5.0, 5.0, 5.0], [4.0, 5.4, 3.6, 5.4, 4.6]
    assert name_of(automatic(monkeypatch, bounded, others)) == "searched"
    two_runs = Noise(3.0, (0, 1))
    assert name_of(choose(two_runs, "auto", (), silent)) == "bounded"  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("noise_mV, taken", [(None, "bounded"), (0.5, "bounded"), (3.0, "searched")])
def test_few_runs_speak_for_a_searched_network_only_where_it_leaves_little_but_noise(
    monkeypatch: pytest.MonkeyPatch, noise_mV: float | None, taken: str
) -> None:
    bounded, others = [5.0, 5.0, 5.0, 5.0, 5.0], [4.0, 4.2, 3.8, 4.1, 3.9]
    assert name_of(automatic(monkeypatch, bounded, others)) == "searched"
    three_runs = Noise(noise_mV, (0, 1, 2))
    assert name_of(choose(three_runs, "auto", (), silent)) == taken  # pyright: ignore[reportArgumentType]


def test_what_is_not_physical_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    found = automatic(monkeypatch, [5.0, 5.0, 5.0, 5.0, 5.0], [1.0, 1.2, 0.8, 1.1, 0.9], physical=False)
    assert name_of(found) == "bounded"
    assert len(found.compared) == 4


def test_at_the_noise_nothing_else_is_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    found = automatic(monkeypatch, [0.505] * 5, [0.1] * 5)
    assert name_of(found) == "bounded" and found.compared == []


@pytest.fixture(scope="module")
def data() -> Training:
    return training([run(2), run(4)], CELL.capacity_Ah, [SOC, SOC], 1.0, 1.0)


def test_effects_are_left_out_of_bounded_networks_only(data: Training) -> None:
    for structure in ("bounded", "auto"):
        chosen = choose(data, structure, ("hysteresis",), silent)
        assert isinstance(chosen.built, BoundedNetwork) and chosen.compared == []
    with pytest.raises(ModelError, match="not of 'full'; use --structure bounded"):
        choose(data, "full", ("hysteresis",), silent)
    with pytest.raises(ModelError, match="effect nonsense cannot be left out"):
        choose(data, "bounded", ("nonsense",), silent)


def test_names_are_what_they_say(data: Training) -> None:
    with pytest.raises(
        ModelError, match="structure 'huge' is unknown; use one of auto, full, minimal, bounded, searched"
    ):
        choose(data, "huge", (), silent)
    assert STRUCTURES[0] == "auto"
    assert isinstance(choose(data, "minimal", (), silent).built, SearchedNetwork)


def test_a_negative_resistance_is_not_physical() -> None:
    network = fitted().network
    assert is_physical(network)
    assert not is_physical(replace(network, theta=-network.theta))


@pytest.mark.parametrize(("runs", "expected_mV"), [(2, 8.0), (3, 4.0), (4, 4.0), (5, 8.0)])
def test_of_three_or_four_runs_whole_ones_and_blocks_bound_what_is_expected(runs: int, expected_mV: float) -> None:
    kind = Kind("bounded", (8.0,) * len(COUNT))
    found = expected_V(kind, kind.held_out(), runs)  # pyright: ignore[reportArgumentType]
    assert 1e3 * found == pytest.approx(expected_mV)


def test_the_expected_error_is_near_that_on_unseen_runs() -> None:
    found = fitted()
    unseen = [run(9), run(10), run(12)]
    error_mV = free_run_metrics(found.network, unseen, [SOC] * 3)["rmse_mV"]
    assert abs(found.expected_rmse_mV / error_mV - 1.0) < 0.3
    assert found.expected_rmse_mV > found.train["rmse_mV"]
