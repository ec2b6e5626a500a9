"""Model documents that something has happened to: refused, or harmless."""

import copy
import json
import math
import random
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from bench_service.jobs.screening import checked_model
from models.comparison.figures import compare
from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.seal import sealed
from models.network.local_model_network import LocalModelNetwork
from models.observer import FuzzyObserver
from models.pipeline.fit import fit_network
from models.readouts.tables import read_out, summary
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
    for made in mutants(sealed(document), 30):
        if "sha256" in made:
            with pytest.raises(ModelError):
                checked_model(made)
    digit = copy.deepcopy(sealed(document))
    digit["theta"][0][0] += 1e-9
    with pytest.raises(ModelError, match="damaged or changed after it was written"):
        checked_model(digit)


def use(made: dict[str, Any]) -> None:
    """Compare, read out and observe with a model that was accepted, with a run of its cell."""
    network, run = LocalModelNetwork.from_json(made), series("judged")
    figures = compare(network, [run], [SOC])
    assert math.isfinite(figures["overall"]["rmse_mV"])
    tables = read_out(network)
    assert np.min(np.array(tables["resistance"]["resistance_Ohm"], float)) > 0.0
    ocv_V = np.array(tables["ocv"]["voltage_V"], float)
    assert 3.0 < ocv_V.min() < ocv_V.max() < 4.5
    json.dumps([figures, tables, summary(network)], allow_nan=False)
    observer, grid = FuzzyObserver(network), to_grid(run, network.dt_s)
    _, rows = observer.replay(observer.initial(SOC, 0.1), grid.current_A, grid.voltage_V, grid.temperature_degC)
    assert np.isfinite(rows[:, :3]).all() and (np.abs(rows[:, 0] - 0.5) < 1.0).all()


@pytest.mark.filterwarnings("ignore")
def test_a_changed_document_without_a_seal_is_refused_with_one_line_or_harmless(document: dict[str, Any]) -> None:
    refused = harmless = 0
    for made in mutants(document, 36):
        try:
            checked_model(made)
        except ModelError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            use(made)
            harmless += 1
    assert refused > harmless > 0


@pytest.mark.parametrize(
    ("path", "factor", "told"),
    [
        (("theta", 3, 2), -1.0, "its parameters give"),
        (("scaling", "voltage", 1), 10.0, "open-circuit|parameters give|scaling|voltage"),
        (("cell", "capacity_Ah"), 10.0, "capacity_Ah is 2.5, the model's is 25"),
        (("structure", "dt_s"), 10.0, "dt_s is 1, the model's is 10"),
        (("record", "domain", "soc", 1), 40.0, "soc"),
        (("record", "tables", "resistance", "resistance_Ohm", 0, 0, 0), -1.0, "its parameters give"),
        (("record", "uncertainty", "covariance_factor", 0), 1e3, "std"),
        (("record", "noise_floor_mV"), 1e4, "noise_floor_mV"),
        (("record", "thermal", "model", "heat_capacity_J_per_K"), 1e9, "must lie within"),
    ],
)
def test_what_contradicts_the_rest_is_named(
    document: dict[str, Any], path: tuple[Any, ...], factor: float, told: str
) -> None:
    made = copy.deepcopy(document)
    at: Any = made
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] *= factor
    with pytest.raises(ModelError, match=told):
        checked_model(made)


@pytest.mark.filterwarnings("ignore")
def test_a_cell_whose_resistance_is_negative_is_refused_without_its_tables_too(document: dict[str, Any]) -> None:
    made = copy.deepcopy(document)
    del made["record"]["tables"]
    for local in made["theta"]:
        local[2:-1] = [-each for each in local[2:-1]]
    with pytest.raises(ModelError, match="static resistance|voltage"):
        checked_model(made)


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
