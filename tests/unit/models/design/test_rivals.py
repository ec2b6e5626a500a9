"""Rivals by the names of effects: put into a model, refitted, and told apart."""

from collections.abc import Callable

import numpy as np
import pytest

from models.data.timeseries import TimeSeries
from models.design.answer import Material, answer
from models.design.request import RequestError, read_request
from models.design.rivals import is_effect, rival_models
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.models.design.networks import resistive
from tests.unit.models.simulated_cells import AMBIENT_DEGC, pulses_A, record

PARAMETERS = CELLS["nmc"].parameters


@pytest.fixture(scope="module")
def run() -> TimeSeries:
    return record(Cell(PARAMETERS, 0.6, AMBIENT_DEGC), pulses_A(4000, PARAMETERS.capacity_Ah, 1), 1)


@pytest.fixture(scope="module")
def parent(run: TimeSeries) -> LocalModelNetwork:
    """Current and SoC alone: it lacks relaxation and hysteresis."""
    inputs = (InputChannel("soc", delay=1), InputChannel("current"))
    structure = Structure(1, inputs, (PartitionAxis("soc", initial=2, splittable=False),), 1.0)
    return fit_network([run], capacity_Ah=PARAMETERS.capacity_Ah, structure=structure, dt_s=1.0).network


def test_two_effects_are_told_apart(parent: LocalModelNetwork, run: TimeSeries) -> None:
    request = read_request(
        {
            "criterion": "discriminate",
            "capacity_Ah": PARAMETERS.capacity_Ah,
            "initial_soc": 0.6,
            "duration_s": 300,
            "limits": {"current_A": [-5, 2.5], "soc": [0.3, 0.8]},
            "rivals": ["relaxation", "hysteresis"],
        }
    )
    told: list[float] = []
    found = answer(
        request,
        Material(network=parent, runs=(run,), rivals=request.rivals),
        lambda share, text: told.append(share),
    )
    # In standard deviations of the noise, whichever of the two is refitted.
    assert min(found.figures["separation"]) > 3.0
    assert found.profile.current_A.min() >= -5.0 and found.profile.current_A.max() <= 2.5
    assert told == sorted(told) and told[-1] == pytest.approx(1.0)


def test_a_model_may_be_set_against_itself_with_an_effect(parent: LocalModelNetwork, run: TimeSeries) -> None:
    first, second = rival_models([parent, "relaxation"], parent, [run], [])
    assert first is parent and len(second.structure.signals) > len(parent.structure.signals)


@pytest.mark.parametrize(
    ("rivals", "says"),
    [
        (lambda: [], "rivals names 0"),
        (lambda: [resistive(), resistive(), resistive()], "rivals names 3"),
        (lambda: ["hysteresis", "hysteresis"], "twice"),
        (lambda: ["hysteresis", resistive()], "model is missing"),
    ],
)
def test_what_cannot_be_told_apart_is_refused(rivals: Callable[[], list], says: str) -> None:
    with pytest.raises(RequestError, match=says):
        rival_models(rivals(), None, [], [])


def test_an_effect_needs_runs() -> None:
    with pytest.raises(RequestError, match="runs is missing"):
        rival_models(["hysteresis", "relaxation"], resistive(), [], [])


def test_names_of_effects_are_known() -> None:
    assert is_effect("hysteresis") and not is_effect("model.json")
    assert not np.any([is_effect(name) for name in ("", "0123abcd")])
