"""The live observer gets each sample as its model reads it."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bench_service.bench.observer_link import NO_ESTIMATE, ObserverError, ObserverLink, ObserverRow
from bench_service.bench.run_setup import build_observer
from tests.unit.models import hand_network

OFFSET_A, LATE = 0.3, 2
N = 40


def link(*effects: dict[str, Any], settings: dict[str, Any] | None = None) -> ObserverLink:
    network = hand_network.everything(1)
    network = replace(network, record=replace(network.record, effects=effects))
    order = {"model": network.to_json(), "settings": settings}
    request: Any = SimpleNamespace(observer=order, dt_s=hand_network.DT_S, initial_soc=0.5)
    built = build_observer(request)
    assert built is not None
    return built


def correction(effect: str, **values: float) -> dict[str, Any]:
    return {"effect": effect, "correction": True, "parameters": {name: {"value": v} for name, v in values.items()}}


def rows(observer: ObserverLink, current_A: np.ndarray, voltage_V: np.ndarray) -> list[ObserverRow]:
    return [observer.step(i, v, 20.0, 20.0) for i, v in zip(current_A, voltage_V, strict=True)]


def test_a_wrong_current_and_a_late_voltage_are_put_right() -> None:
    rng = np.random.default_rng(3)
    current, voltage = rng.normal(0.0, 1.0, N), 3.6 + 0.01 * rng.normal(size=N)
    expected = rows(link(), current, voltage)
    late_V = np.concatenate([np.full(LATE, voltage[0]), voltage])[:N]
    corrected = link(
        correction("current_offset", offset_A=OFFSET_A), correction("dead_time", delay_s=LATE * hand_network.DT_S)
    )
    found = rows(corrected, current + OFFSET_A, late_V)
    assert found[:LATE] == [NO_ESTIMATE] * LATE and all(math.isnan(value) for value in NO_ESTIMATE)
    np.testing.assert_allclose(found[LATE:], expected[:-LATE], rtol=1e-9, atol=1e-12)


def test_a_model_with_a_damaged_correction_has_no_observer() -> None:
    with pytest.raises(ObserverError, match="cannot start"):
        link(correction("current_offset", offset_A=math.inf))


def test_the_gain_is_what_the_order_says() -> None:
    rng = np.random.default_rng(4)
    current, voltage = rng.normal(0.0, 1.0, N), 3.6 + 0.01 * rng.normal(size=N)
    # Sure of its start, so that the steady-state gains hold from the first sample on.
    sure = {"initial_soc": 0.5, "initial_soc_std": 1e-4}
    found = {gain: rows(link(settings=sure | {"gain": gain}), current, voltage) for gain in ("kalman", "steady")}
    assert rows(link(settings=sure), current, voltage) == found["kalman"]
    assert found["steady"] != found["kalman"]
    with pytest.raises(ObserverError, match="gain is 'best'"):
        link(settings={"gain": "best"})
