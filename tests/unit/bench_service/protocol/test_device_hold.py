"""A voltage held by the device: the engine tells it what to hold, and sees when it does."""

from __future__ import annotations

import numpy as np
import pytest

from bench_service.protocol.device_hold import DeviceHold
from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.cycler import Cycler, CyclerSettings
from simulators.sensors import SensorParameters, Sensors
from tests.unit.bench_service.protocol.protocol_rig import program_of

TOP = {"nmc": 4.18, "lfp": 3.63, "nimh": 1.5}


@pytest.mark.parametrize(("cell", "dt_s"), [("nmc", 1.0), ("nmc", 10.0), ("lfp", 10.0), ("nimh", 10.0)])
def test_a_device_that_holds_is_told_what_and_how_much(cell: str, dt_s: float) -> None:
    steps = [
        {"step": "cc_cv", "rate_C": 1, "voltage_V": TOP[cell], "until": {"rate_C": 0.05}},
        {"step": "constant_current", "rate_C": -0.5, "until": {"time_s": 60}},
    ]
    engine = Engine(program_of(steps, cell), dt_s, device_holds=True)
    sensors = Sensors(SensorParameters(), np.random.default_rng(1))
    device = Cycler(CyclerSettings(), Cell(CELLS[cell].parameters, 0.9), sensors, watchdog_enabled=False)
    device.set_remote(True)
    device.set_output(True)
    interval_s, seen_V, told_V = 0.0, [], set()
    while True:
        seen = device.measurement
        told_A = engine.advance(Seen(seen.voltage_V, seen.current_A, 25.0, None, interval_s))
        if told_A is None:
            break
        seen_V.append(device._truth.voltage_V)
        device.hold_V, interval_s = engine.hold_V, dt_s
        told_V.add(engine.hold_V)
        device.set_current(told_A)
        device.advance(dt_s)
    assert told_V == {TOP[cell], None} and engine.hold_V is None
    assert max(seen_V) < TOP[cell] + 0.001
    assert [end.ended_by.name for end in engine.ended] == ["CURRENT", "TIME"] and engine.stopped is None
    assert engine.ended[0].last.current_A < 0.051 * CELLS[cell].parameters.capacity_Ah
    assert engine.ended[0].last.voltage_V == pytest.approx(TOP[cell], abs=0.005)


def test_a_hold_of_both_directions_is_turned_round_once_nothing_flows_any_more() -> None:
    hold = DeviceHold(3.7, (-1.0, 2.0))
    assert [hold.follow(3.69, 2.0), hold.follow(3.7, 1.0)] == [2.0, 2.0]
    assert not hold.settled
    assert [hold.follow(3.701, 0.0), hold.follow(3.704, 0.0), hold.follow(3.704, 0.0)] == [2.0, 2.0, 2.0]
    assert hold.settled and hold.follow(3.704, 0.0) == -1.0
    one_way = DeviceHold(3.7, (0.0, 2.0))
    assert {one_way.follow(3.8, 0.0) for _ in range(9)} == {2.0}
