"""Simulated cells for the observer's benchmarks: training runs over 0..40 degC, and random runs to observe.

The chamber steps between temperatures, the sensors are noisy, the cell starts rested, when observed at any place in its
hysteresis loop; what the cell does is known to the last digit, so that the error of an estimate is too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.data.timeseries import FloatArray, TimeSeries
from models.design import StepProfileRequest, step_profile
from simulators.catalogue import cell_type
from simulators.cell import Cell, CellParameters
from simulators.sensors import SensorParameters, Sensors

DT_S = 1.0
TRAINED_SOC = (0.04, 0.97)
TRAINED_DEGC = (0.0, 20.0, 40.0)
OBSERVED_SOC = (0.08, 0.93)
_TRAINED_C = (-2.0, 1.2)
_TRAINING_S = 14000.0


@dataclass(frozen=True)
class Case:
    """One run to observe: what the sensors read, with the true state of charge as reference."""

    series: TimeSeries
    initial_soc: float


def training_runs(cell: str, seed: int = 0) -> list[TimeSeries]:
    """Steps, pulses and rests over the SoC range: one run at each temperature, one with a chamber that steps.

    Two more have a load like those that are observed: a model is only known to be as good as it was under such load.
    """
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    runs = []
    for number, degC in enumerate([*TRAINED_DEGC, None]):
        rng = np.random.default_rng([seed, number])
        profile = step_profile(
            StepProfileRequest(
                capacity_Ah=capacity_Ah,
                current_A=(_TRAINED_C[0] * capacity_Ah, _TRAINED_C[1] * capacity_Ah),
                soc=TRAINED_SOC,
                initial_soc=0.5,
                duration_s=_TRAINING_S,
                dt_s=DT_S,
            ),
            rng,
        )
        grid_s = np.arange(round(profile.duration_s / DT_S) + 1) * DT_S
        held = np.searchsorted(profile.time_s, grid_s[:-1] + 0.5 * DT_S, side="right") - 1
        current = np.concatenate([[0.0], profile.current_A[held]])
        ambient = np.full(len(current), degC) if degC is not None else chamber_degC(len(current), rng)
        parameters = cell_type(cell).parameters
        runs.append(play(parameters, current, ambient, 0.5, rng, f"{cell} training {number}"))
    loads = (random_case(cell, 10_000 * (seed + 1) + number, _TRAINING_S, anywhere=False).series for number in range(2))
    return [*runs, *loads]


def random_case(
    cell: str, seed: int, duration_s: float = 7200.0, anywhere: bool = True, changed: CellParameters | None = None
) -> Case:
    """Random load with rests and a chamber that steps between 0 and 40 degC; the same seed gives the same case.

    The cell starts at any place in its hysteresis loop, or in the middle. `changed` takes the cell's place.
    """
    rng = np.random.default_rng([7919, seed])
    capacity_Ah = cell_type(cell).parameters.capacity_Ah
    initial_soc = float(rng.uniform(0.2, 0.9))
    n = round(duration_s / DT_S) + 1
    current = load_A(n, capacity_Ah, initial_soc, rng)
    loop = float(np.random.default_rng([7919, seed, 1]).uniform(-1.0, 1.0)) if anywhere else 0.0
    parameters = changed or cell_type(cell).parameters
    series = play(parameters, current, chamber_degC(n, rng), initial_soc, rng, f"{cell} {seed}", loop)
    return Case(series, initial_soc)


def load_A(n: int, capacity_Ah: float, initial_soc: float, rng: np.random.Generator) -> FloatArray:
    """Blocks of quick random steps around a mean that charges or discharges, and rests; SoC stays in OBSERVED_SOC."""
    current, soc, k = np.zeros(n), initial_soc, 1
    per_A = DT_S / (3600.0 * capacity_Ah)
    while k < n:
        length = int(rng.integers(120, 1500))
        kind = rng.random()
        mean = 0.0 if kind < 0.15 else float(rng.uniform(-1.0, 0.6)) * capacity_Ah
        spread = 0.0 if kind < 0.3 else 0.7 * capacity_Ah
        for _ in range(length):
            if k >= n:
                break
            hold = int(rng.integers(3, 30))
            value = float(np.clip(mean + spread * rng.standard_normal(), -1.9 * capacity_Ah, 1.1 * capacity_Ah))
            end = soc + value * per_A * hold
            if not OBSERVED_SOC[0] < end < OBSERVED_SOC[1]:
                mean = value = -0.5 * value
            stop = min(k + hold, n)
            current[k:stop] = value
            soc += value * per_A * (stop - k)
            length -= hold
            k = stop
            if length <= 0:
                break
    return current


def chamber_degC(n: int, rng: np.random.Generator) -> FloatArray:
    """Temperature of the chamber: steps between 0 and 40 degC, held for 10 to 60 minutes."""
    ambient, k = np.empty(n), 0
    while k < n:
        length = int(rng.integers(600, 3600))
        ambient[k : k + length] = rng.uniform(TRAINED_DEGC[0], TRAINED_DEGC[-1])
        k += length
    return ambient


def play(
    parameters: CellParameters,
    current_A: FloatArray,
    ambient_degC: FloatArray,
    initial_soc: float,
    rng: np.random.Generator,
    name: str,
    loop: float = 0.0,
) -> TimeSeries:
    """Play a current through a rested cell and read its sensors; `soc_ref` is the truth, `loop` where it starts."""
    simulated = Cell(parameters, initial_soc, float(ambient_degC[0]))
    simulated.state = simulated.state._replace(hysteresis=loop)
    measuring = Sensors(SensorParameters(), rng)
    rows, soc = [], np.empty(len(current_A))
    for k, (current, ambient) in enumerate(zip(current_A.tolist(), ambient_degC.tolist(), strict=True)):
        simulated.ambient_degC = ambient
        truth = simulated.step(current, DT_S if k else 0.0)
        rows.append(measuring.measure(truth, current, ambient))
        soc[k] = truth.soc
    voltage, measured, temperature, ambient = (np.array(column) for column in zip(*rows, strict=True))
    return TimeSeries(np.arange(len(soc)) * DT_S, measured, voltage, temperature, ambient, soc, name)
