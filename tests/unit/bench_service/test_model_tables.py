"""Read-outs of a stored model: from its document, or from a worker where the document is older."""

import asyncio
import json
from pathlib import Path
from typing import Any

from bench_service.campaign.modelling import Modelling
from bench_service.jobs.modelling import read_tables
from tests.unit.bench_service.jobs_at_once import JobsAtOnce
from tests.unit.models import hand_network


class Store:
    """A store of one document."""

    def __init__(self, document: dict[str, Any]) -> None:
        self._document = document

    @property
    def models(self) -> "Store":
        return self

    def document(self, model_id: str) -> dict[str, Any]:
        assert model_id == "m1"
        return self._document


def tables(document: dict[str, Any]) -> tuple[dict[str, Any], JobsAtOnce]:
    jobs = JobsAtOnce()
    modelling = Modelling(Store(document), jobs, Path(), "test")  # pyright: ignore[reportArgumentType]
    return asyncio.run(modelling.tables("m1")), jobs


def test_a_document_without_tables_is_read_out_by_a_worker() -> None:
    document = hand_network.everything(1).to_json()
    found, jobs = tables(document)
    assert jobs.kinds == ["tables"]
    assert found["ocv"]["kind"] == "ocv_table" and found["resistance"]["kind"] == "resistance_table"
    assert found["thermal"] is None and found["local_models"] is None
    json.dumps(found, allow_nan=False)


def test_a_document_with_tables_is_answered_at_once() -> None:
    document = hand_network.everything(1).to_json()
    kept = read_tables(lambda share, text: None, Path(), document)  # pyright: ignore[reportArgumentType]
    local = [{"samples": 3.0, "thin": True}]
    document["record"] |= {"tables": kept, "uncertainty": {"local_models": local}, "thermal": {"model": None}}
    found, jobs = tables(document)
    assert jobs.kinds == []
    assert found["ocv"] == kept["ocv"] and found["local_models"] == local and found["thermal"] == {"model": None}
