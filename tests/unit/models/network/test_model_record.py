"""A record is read and written without a change: a model's hash is taken over its document."""

import json

import pytest

from models.data.errors import StructureError
from models.network.model_record import ModelRecord

METRICS = {"rmse_mV": 2.0, "mae_mV": 1.0, "p95_mV": 4.0, "max_mV": 9.0, "bias_mV": 0.1, "nrmse": 0.01, "n_samples": 7}
FULL = {
    "domain": {"soc": [0, 0.9], "current_A": [-3.0, 3.0]},
    "train_runs": ["a", "b"],
    "choices": {"n_models": 6},
    "candidates": [{"n_models": 6, "held_out_rmse_mV": 1.0}],
    "reservations": [],
    "refinement": {"chosen": None},
    "uncertainty": {"kind": "parameter_uncertainty"},
    "tables": {},
    "thermal": None,
    "residuals": [{"run": "a", "std_mV": 1.0}],
    "train": METRICS,
    "validation": None,
    "noise_floor_mV": None,
    "sums": {"kind": "stored_sums"},
    "diagnosis": {"kind": "diagnosis_memory"},
    "version": {"number": 1},
    "effects": [{"effect": "hysteresis", "correction": False, "parameters": {}}],
    "observer": {"gain": "kalman"},
    "update": {"n_samples": 3},
    "parent": "former.json",
}


@pytest.mark.parametrize("document", [FULL, {}, {"thermal": None}, {"reservations": []}, {"domain": {}}])
def test_a_document_comes_back_as_it_was(document: dict) -> None:
    assert json.dumps(ModelRecord.from_json(document).to_json()) == json.dumps(document)


def test_what_this_version_does_not_know_is_kept() -> None:
    document = {"from_the_future": {"a": [1, 2]}, "train": METRICS, "note": None}
    record = ModelRecord.from_json(document)
    assert record.other == {"from_the_future": {"a": [1, 2]}, "note": None}
    assert record.to_json() == document


def test_parts_that_say_nothing_are_empty_and_not_written() -> None:
    record = ModelRecord()
    assert record.tables is None and record.effects == () and dict(record.domain) == {}
    assert record.to_json() == {}


def test_a_part_that_is_left_out_is_not_named_in_the_document_either() -> None:
    record = ModelRecord.from_json(FULL).without("validation", "tables", "domain")
    assert record.tables is None and dict(record.domain) == {}
    assert record.to_json() == {key: FULL[key] for key in FULL if key not in ("validation", "tables", "domain")}


def test_the_training_error_is_read_with_what_stands_for_an_unknown_one() -> None:
    assert ModelRecord.from_json(FULL).train_rmse_mV(10.0) == 2.0
    assert ModelRecord().train_rmse_mV(10.0) == 10.0


def test_records_that_say_the_same_are_equal_whatever_their_documents_state() -> None:
    assert ModelRecord.from_json({"thermal": None}) == ModelRecord()


@pytest.mark.parametrize(
    "damaged", [5, ["domain"], {"domain": {"soc": 1.0}}, {"domain": [0.0, 1.0]}, {"effects": 3}, {"train_runs": "a"}]
)
def test_a_damaged_document_is_refused(damaged: object) -> None:
    with pytest.raises(StructureError, match="record"):
        ModelRecord.from_json(damaged)
