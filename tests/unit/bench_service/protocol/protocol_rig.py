"""Protocols played on the simulators' cells in one process: no device, no clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.engine import Engine
from bench_service.protocol.laws import Seen
from bench_service.protocol.program import Program, Window
from bench_service.protocol.state import Standing, StepEnd
from simulators.catalogue import CELLS
from simulators.cell import Cell
from simulators.sensors import SensorParameters, Sensors

NOISELESS = SensorParameters(voltage_noise_V=0.0, current_noise_A=0.0, temperature_noise_K=0.0)


@dataclass
class Played:
    """What a protocol has done: true and measured voltage, current, step and cycle of each sample, and steps."""

    time_s: np.ndarray
    true_V: np.ndarray
    voltage_V: np.ndarray
    current_A: np.ndarray
    step: np.ndarray
    cycle: np.ndarray
    engine: Engine

    @property
    def ended(self) -> list[StepEnd]:
        return self.engine.ended

    def of(self, step: int) -> np.ndarray:
        return self.step == step


def document(*steps: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    return {"schema": "bench-protocol-1", "name": "test", "steps": list(steps), **more}


def window_of(cell: str = "nmc", **more: Any) -> Window:
    limits = CELLS[cell].limits
    return Window(limits.voltage_V, limits.current_A, **more)


def program_of(steps: Sequence[Mapping[str, Any]], cell: str = "nmc", **window: Any) -> Program:
    return compile_protocol(
        read_protocol(document(*steps)), CELLS[cell].parameters.capacity_Ah, window_of(cell, **window)
    )


def play(
    program: Program,
    cell: str = "nmc",
    *,
    dt_s: float = 10.0,
    soc: float = 0.5,
    sensors: SensorParameters | None = None,
    seed: int = 1,
    standing: Standing | None = None,
    most: int = 100_000,
    true_cell: Cell | None = None,
) -> Played:
    """Play until the protocol has ended, or for `most` samples."""
    truth = true_cell or Cell(CELLS[cell].parameters, soc)
    measuring = Sensors(sensors or SensorParameters(), np.random.default_rng(seed))
    engine, current_A, interval_s, rows = Engine(program, dt_s, standing), 0.0, 0.0, []
    for k in range(most):
        out = truth.step(current_A, interval_s)
        seen = measuring.measure(out, current_A, 25.0)
        soc += seen.current_A * interval_s / 3600.0 / program.capacity_Ah
        wanted_A = engine.advance(Seen(seen.voltage_V, seen.current_A, seen.temperature_degC, soc, interval_s))
        rows.append((k * dt_s, out.voltage_V, seen.voltage_V, seen.current_A, engine.step_count, engine.cycle_count))
        if wanted_A is None:
            break
        current_A, interval_s = wanted_A, dt_s
    return Played(*np.array(rows).T, engine=engine)
