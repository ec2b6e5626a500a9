"""The chain of a model's versions, which runs judge, and an experiment's request on a bench."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.bench.limits import Limits
from bench_service.campaign.diagnosing import catalogue, on_bench
from bench_service.campaign.versions import chain, judging_runs
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ModelOrigin, RunIntent

BENCH = Limits((2.5, 4.2), (-4.0, 2.0), (-20.0, 60.0), (0.0, 1.0), None, 7200.0)
ASKED: dict[str, Any] = {
    "duration_s": 14400.0,
    "limits": {"current_A": [-5.0, 5.0], "voltage_V": [3.0, 4.1], "soc": [0.2, 0.8], "temperature_degC": [20.0, 22.0]},
    "initial_soc": 0.5,
    "dt_s": 1.0,
    "rivals": ["hysteresis", "relaxation"],
}


class House:
    """A store with what a diagnosis works on, without workers."""

    def __init__(self, store: MetadataStore) -> None:
        self.store = store
        self.profile_id = store.profiles.add("p", np.array([0.0, 1.0]), np.array([1.0, 0.0])).id

    def run(self, campaign_id: str | None = None) -> str:
        run = self.store.runs.add(
            RunIntent(
                bench="b",
                profile_id=self.profile_id,
                dt_s=1.0,
                initial_soc=0.5,
                capacity_Ah=2.5,
                limits={},
                code_version="1",
                campaign_id=campaign_id,
            ),
        )
        return self.store.runs.end(run.id, "completed", None, n_samples=2, sha256="ab").id

    def model(self, parent_id: str | None = None, effect: str | None = None, errors: Any = None, **more: Any) -> str:
        metrics = None
        if effect is not None:
            before, after = errors
            metrics = {"effect": effect, "error_before_mV": before, "error_after_mV": after, "noise_floor_mV": 1.0}
        given = {"name": effect or "first", "structure": "minimal", "capacity_Ah": 2.5, "code_version": "1"}
        return self.store.models.add({}, ModelOrigin(parent_id=parent_id, metrics=metrics, **given, **more)).id


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    with closing(MetadataStore.open(tmp_path)) as store:
        yield House(store)


def test_a_chain_sets_every_step_beside_what_else_was_tried(house: House) -> None:
    judge = house.store.runs.references([house.run()])
    first = house.model()
    kept = house.model(first, "hysteresis", (9.0, 4.0), validate=judge)
    worse = house.model(first, "relaxation", (9.0, 9.5), validate=judge)
    last = house.model(kept, "charge_transfer", (4.0, 2.0), validate=judge)
    found = chain(house.store, last)
    assert found["chain"] == [first, kept, last] and found["noise_floor_mV"] == 1.0
    assert [each["id"] for each in found["models"]] == [first, kept, worse, last]
    assert [each["in_chain"] for each in found["models"]] == [True, True, False, True]
    assert [each["held_out"]["rmse_mV"] for each in found["models"]] == [9.0, 4.0, 9.5, 2.0]
    assert [each["held_out"]["before_mV"] for each in found["models"]] == [None, 9.0, 9.0, 4.0]
    assert chain(house.store, worse)["chain"] == [first, worse]


def test_a_first_version_is_judged_by_a_comparison_with_runs_that_it_has_not_seen(house: House) -> None:
    learned, unseen = house.run(), house.run()
    model = house.model(train=house.store.runs.references([learned]))
    assert chain(house.store, model)["models"][0]["held_out"] is None
    result = {"overall": {"rmse_mV": 7.0}, "noise_floor_mV": 0.9}
    house.store.comparisons.add(model, house.store.runs.references([unseen]), result, code_version="1")
    flattering = {"overall": {"rmse_mV": 1.0}, "noise_floor_mV": 0.9}
    house.store.comparisons.add(model, house.store.runs.references([learned]), flattering, code_version="1")
    found = chain(house.store, model)
    assert found["models"][0]["held_out"]["rmse_mV"] == 7.0 and found["noise_floor_mV"] == 0.9
    assert found["models"][0]["held_out"]["run_ids"] == [unseen]


def test_runs_that_judge_where_nobody_names_any(house: House) -> None:
    campaign = house.store.campaigns.add(name="c", bench="b", stage="run", stages=[], request={}, code_version="1")
    learned, other, own = house.run(campaign.id), house.run(campaign.id), house.run()
    train = house.store.runs.references([learned])

    def judging(**fields: Any) -> list[str]:
        return judging_runs(house.store, house.store.models.get(house.model(train=train, **fields)))

    assert judging() == []
    assert judging(campaign_id=campaign.id) == [other]
    assert judging(campaign_id=campaign.id, validate=house.store.runs.references([own])) == [own]


def test_an_experiment_stays_inside_the_bench_and_starts_where_its_cell_stands() -> None:
    fitted = on_bench(ASKED, BENCH, 0.9)
    assert fitted["limits"] == {"current_A": [-4.0, 2.0], "voltage_V": [3.0, 4.1], "soc": [0.2, 0.9]}
    assert (fitted["initial_soc"], fitted["duration_s"]) == (0.9, 7200.0)
    slow = Limits((2.5, 4.2), (-4.0, 2.0), (-20.0, 60.0), (0.0, 1.0), 0.5, 7200.0)
    assert on_bench(ASKED, slow, 0.5)["limits"]["ramp_A_per_s"] == [-0.5, 0.5]


def test_the_catalogue_is_plain_data() -> None:
    for effect in catalogue():
        assert effect["title"] and effect["recognise"] and effect["source"] and effect["parameters"]
        assert set(effect["contains"]) <= {each["name"] for each in catalogue()}
