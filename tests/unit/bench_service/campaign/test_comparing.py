"""A comparison from its order to its record: which runs baselines learn from, and what is told of them."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.campaign.modelling import Modelling
from bench_service.errors import BadRequestError, NotFoundError
from bench_service.jobs import modelling as jobs_modelling
from bench_service.jobs.modelling import plain
from bench_service.jobs.series import RunInput
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import ComparisonRecord, ModelOrigin, RunIntent
from models.baselines.beside import beside_baselines
from models.comparison.figures import compare
from models.data.timeseries import TimeSeries
from models.module.log import ModuleLog
from tests.unit.bench_service.jobs_at_once import JobsAtOnce
from tests.unit.models import hand_network, synthetic

# Where the synthetic runs begin.
SOC = 0.6
NETWORK = hand_network.everything(1)


class House:
    """A store with a model and its runs, and the samples that are read of these."""

    def __init__(self, store: MetadataStore, folder: Path) -> None:
        self.store, self.jobs = store, JobsAtOnce()
        self.series: dict[str, TimeSeries] = {}
        self.read: list[str] = []
        self.modelling = Modelling(store, self.jobs, folder, "1")  # pyright: ignore[reportArgumentType]
        self._profile_id = store.profiles.add("p", np.array([0.0, 1.0]), np.array([1.0, 0.0])).id
        self.learned, self.other, self.judged = self.run(2), self.run(4), self.run(3)

    def run(self, seed: int) -> str:
        intent = RunIntent(bench="b", profile_id=self._profile_id, dt_s=1.0, initial_soc=SOC,
                           capacity_Ah=synthetic.CAPACITY_AH, limits={}, code_version="1")  # fmt: skip
        run_id = self.store.runs.add(intent).id
        self.series[run_id] = synthetic.run(1000, seed=seed, noise_V=1e-3)
        return self.store.runs.end(run_id, "completed", None, n_samples=1000, sha256="ab").id

    def model(self, *train: str) -> str:
        origin = ModelOrigin(name="m", structure="minimal", capacity_Ah=synthetic.CAPACITY_AH, code_version="1",
                             train=self.store.runs.references(train))  # fmt: skip
        return self.store.models.add(NETWORK.to_json(), origin).id

    def compare(self, model_id: str, **beside: Any) -> ComparisonRecord:
        return asyncio.run(self.modelling.compare(model_id, [self.judged], **beside))

    def expected(self, names: list[str], learned: str) -> Any:
        """What the command line prints under ``baselines``."""
        sides = (([self.series[run_id]], [SOC]) for run_id in (learned, self.judged))
        return json.loads(json.dumps(plain(beside_baselines(NETWORK, names, *sides))))


@pytest.fixture
def house(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[House]:
    with closing(MetadataStore.open(tmp_path)) as store:
        found = House(store, tmp_path)

        def read(_directory: Path, runs: list[RunInput]) -> list[TimeSeries]:
            found.read += [run.run_id for run in runs]
            return [found.series[run.run_id] for run in runs]

        monkeypatch.setattr(jobs_modelling, "read_series", read)
        monkeypatch.setattr(jobs_modelling, "read_logs", lambda *asked: [ModuleLog(each) for each in read(*asked)])
        yield found


def test_without_baselines_it_is_the_models_alone_and_no_other_run_is_read(house: House) -> None:
    result = house.compare(house.model(house.learned)).result
    assert result == json.loads(json.dumps(plain(compare(NETWORK, [house.series[house.judged]], [SOC]))))
    assert "baselines" not in result and house.read == [house.judged]


def test_baselines_learn_from_the_runs_that_the_model_was_made_from(house: House) -> None:
    model_id = house.model(house.learned)
    record = house.compare(model_id, baselines=["1rc", "2rc"])
    assert record.result["baselines"] == house.expected(["1rc", "2rc"], house.learned)
    assert record.result["overall"] == house.compare(model_id).result["overall"]
    assert house.store.comparisons.get(record.id).result == record.result
    # A person waits for the answer.
    assert set(house.jobs.kinds) == {"comparison"}


def test_or_from_those_that_are_named(house: House) -> None:
    record = house.compare(house.model(house.learned), baselines=["1rc"], train_run_ids=[house.other])
    assert record.result["baselines"] == house.expected(["1rc"], house.other)
    imported = house.compare(house.model(), baselines=["1rc"], train_run_ids=[house.other])
    assert imported.result["baselines"] == record.result["baselines"]


def test_runs_that_nobody_names_or_that_are_not_there_are_told(house: House) -> None:
    with pytest.raises(BadRequestError, match="the model names no runs to fit baselines to") as refusal:
        house.compare(house.model(), baselines=["1rc"])
    assert refusal.value.where == ("train_run_ids",)
    with pytest.raises(NotFoundError):
        house.compare(house.model(house.learned), baselines=["1rc"], train_run_ids=["none"])
    assert house.jobs.kinds == []
