"""Model documents that something has happened to: refused, or read without a crash."""

import copy
import json
import random
from collections.abc import Iterator
from typing import Any

import pytest

from bench_service.jobs.screening import checked_model
from models.data.errors import ModelError
from models.data.seal import sealed
from models.pipeline.fit import fit_network
from tests.unit.bench_service.test_diagnosing_jobs import CELL, SOC, series

OTHERS = (None, "x", -1e300, 1e12, 0, {}, [], True, [[1]], {"a": 1})


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    fitted = fit_network([series("learned")], capacity_Ah=CELL.capacity_Ah, structure="minimal", initial_soc=[SOC])
    return json.loads(json.dumps(fitted.network.to_json()))


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every key, and the first and last of each list."""
    if path:
        yield path
    if isinstance(value, dict):
        for key, part in value.items():
            yield from places(part, (*path, key))
    elif isinstance(value, list) and value:
        for index in {0, len(value) - 1}:
            yield from places(value[index], (*path, index))


def mutants(document: dict[str, Any], n: int) -> Iterator[dict[str, Any]]:
    rng = random.Random(11)
    every = [(path, other) for path in places(document) for other in (*OTHERS, "cut out")]
    for path, other in rng.sample(every, n):
        made: Any = copy.copy(document)
        at = made
        for key in path[:-1]:
            at[key] = copy.copy(at[key])
            at = at[key]
        if other == "cut out":
            del at[path[-1]]
        else:
            at[path[-1]] = other
        if made != document:
            yield made


def test_the_document_as_it_was_written_is_read(document: dict[str, Any]) -> None:
    for written in (document, sealed(document)):
        assert json.loads(json.dumps(checked_model(written).to_json())) == document


def test_whatever_is_changed_in_a_sealed_document_it_is_refused(document: dict[str, Any]) -> None:
    for made in mutants(sealed(document), 120):
        if "sha256" in made:
            with pytest.raises(ModelError):
                checked_model(made)
    digit = copy.deepcopy(sealed(document))
    digit["theta"][0][0] += 1e-9
    with pytest.raises(ModelError, match="damaged or changed after it was written"):
        checked_model(digit)


@pytest.mark.filterwarnings("ignore")
def test_in_a_document_without_a_seal_what_is_not_of_its_kind_is_refused_and_nothing_crashes(
    document: dict[str, Any],
) -> None:
    refused = read = 0
    for made in mutants(document, 120):
        try:
            checked_model(made)
            read += 1
        except ModelError:
            refused += 1
    assert refused > read


def test_numbers_are_the_same_however_a_program_writes_them(document: dict[str, Any]) -> None:
    """A page's own JSON has 1 for 1.0 and 0 for -0.0."""
    as_in_a_browser = json.loads(
        json.dumps(sealed(document)), parse_float=lambda text: int(float(text)) if float(text) % 1 == 0 else float(text)
    )
    checked_model(as_in_a_browser)


@pytest.mark.parametrize("pole", [1.2, -3.0])
def test_a_model_whose_voltage_grows_without_bound_is_refused(document: dict[str, Any], pole: float) -> None:
    wild = copy.deepcopy(document)
    for local in wild["theta"]:
        local[0] = pole
    with pytest.raises(ModelError, match="without bound|damaged"):
        checked_model(wild)
