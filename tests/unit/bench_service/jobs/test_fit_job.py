"""What a worker answers of a fit."""

import json
from pathlib import Path
from typing import Any

import pytest

from bench_service.jobs import modelling
from bench_service.jobs.series import RunInput
from models.data.errors import ModelError
from tests.unit.models.diagnosis.cells import SOC
from tests.unit.models.pipeline.bounded_cell import CELL, run


def silent(fraction: float, message: str = "") -> None:
    pass


def fit(without: list[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(modelling, "read_series", lambda _directory, runs: [run(int(each.run_id)) for each in runs])
    train, capacity_Ah = [RunInput("2", SOC), RunInput("4", SOC)], CELL.capacity_Ah
    return modelling.fit(silent, Path(), train, [], capacity_Ah, "bounded", without=without)  # pyright: ignore[reportArgumentType]


def test_it_names_structure_expected_error_and_terms(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fit(["hysteresis"], monkeypatch)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    metrics, choices = found["metrics"], found["document"]["record"]["choices"]
    assert metrics["structure"] == "bounded" and metrics["compared"] == []
    assert metrics["expected_rmse_mV"] == choices["expected_rmse_mV"] > metrics["train"]["rmse_mV"]
    assert metrics["terms"] == choices["terms"] and choices["without"] == ["hysteresis"]
    assert not any("hysteresis" in term["effects"] for term in metrics["terms"])


def test_an_effect_that_cannot_be_left_out_fails_it_with_the_models_words(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ModelError, match="effect gravity cannot be left out"):
        fit(["gravity"], monkeypatch)
