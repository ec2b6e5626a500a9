"""What the temperature tells: a balance by all that is lost, and effects that it alone asks for."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from models.data.resampling import to_grid
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.record import from_json, to_json
from models.diagnosis.likelihood.analysis import Analysis
from models.diagnosis.likelihood.background import Background, Weighed
from models.diagnosis.likelihood.learning import know
from models.diagnosis.likelihood.shapes import Linear
from models.diagnosis.likelihood.sight import look
from models.diagnosis.likelihood.tried import Tried, try_shapes
from models.diagnosis.likelihood.verdict import Verdict, judge
from models.effects import effect
from models.identification.bounded.variants import Variant
from simulators.catalogue import CELLS
from tests.unit.models.diagnosis.cells import SOC, measured

CELL = CELLS["nmc"].parameters
SURFACE = Variant(surface=(0.1, 200.0, 3500.0))
NOTHING: Any = None


@pytest.fixture(scope="module")
def memory() -> KnownRuns:
    return know([to_grid(measured(CELL, 1), 1.0)], [SOC], CELL.capacity_Ah, [], SURFACE)


def test_charge_that_has_not_spread_is_lost_as_heat(memory: KnownRuns) -> None:
    (run,) = look(memory, [to_grid(measured(CELL, 2), 1.0)], [SOC]).runs
    cell, inputs, soc = memory.cell, run.every.inputs, run.every.soc[run.every.index]
    others = np.concatenate([cell.terms_of("hysteresis_state"), cell.terms_of("temperature")])
    rest_V = cell.open_circuit_V(soc) + cell.through(inputs.signals, soc + inputs.surface, others)
    np.testing.assert_allclose(cell.loss_V(inputs, soc), cell.voltage_V(inputs, soc) - rest_V, atol=1e-12)
    assert run.warm is not None
    np.testing.assert_array_equal(run.warm.heat_W, run.warm.current_A * cell.loss_V(inputs, soc))
    # The surface is ahead by percents of the charge.
    spread_V = cell.through(inputs.signals, soc + inputs.surface, cell.resistive)
    assert np.abs(cell.loss_V(inputs, soc) - spread_V).max() > 2e-3


def test_a_document_with_a_balance_of_other_heat_is_read_without_it(memory: KnownRuns) -> None:
    document = to_json(memory)
    assert from_json(document).balance == memory.balance
    assert memory.balance is not None
    assert from_json(document | {"schema_version": 5}).balance is None


@pytest.mark.parametrize(("name", "possible"), [("self_discharge", True), ("series_resistance", False)])
def test_a_leak_whose_heat_is_there_is_not_ruled_out_by_an_error_of_the_voltage(name: str, possible: bool) -> None:
    n, time = 60, np.linspace(0.0, 1.0, 60)
    warm_K, drift_V = 1.0 - np.exp(-6.0 * time), -0.01 * time
    # What the model is off by goes the other way, so that with the leak the voltage's error is larger.
    back = Background(
        np.concatenate([0.004 * time, warm_K]),
        np.diag(np.concatenate([np.full(n, 1e-6), np.full(n, 1e-2)])),
        np.outer(*2 * [np.concatenate([0.02 * time, np.zeros(n)])]),
    )
    one = try_shapes(back, effect(name), (Linear(np.concatenate([drift_V, warm_K])[:, None], (), (), 0),))
    ((chance, _),) = judge(back, [one], n).single
    assert (chance > 0.0) == possible


@pytest.mark.parametrize(
    ("leak", "rivals"), [(95.0, ["temperature_sensor", "self_discharge"]), (70.0, ["temperature_sensor"])]
)
def test_what_warms_a_cell_alike_is_a_rival(leak: float, rivals: list[str]) -> None:
    cooling, sensor, inner = (
        _tried("heat_transfer", 100.0),
        _tried("temperature_sensor", 90.0),
        _tried("self_discharge", leak),
    )
    verdict = Verdict(0.0, 0.0, ((0.97, cooling), (0.01, sensor), (0.0, inner)), ())
    sight: Any = SimpleNamespace(n_voltage=4)
    back = Background(np.zeros(4), np.eye(4), np.eye(4))
    analysis = Analysis(sight, back, (cooling, sensor, inner), verdict)
    assert [each.effect.name for each in analysis.rivals] == rivals


def _tried(name: str, log_likelihood: float) -> Tried:
    return Tried(effect(name), NOTHING, np.zeros((4, 1)), None, Weighed(log_likelihood, np.ones(1), np.eye(1)))
