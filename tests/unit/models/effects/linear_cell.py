"""A cell that is linear, and runs of it, for effects to be looked at alone."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.thermal_view import ThermalView
from models.effects.view import ModelInputs, View

SLOPE_V, RESISTANCE_OHM, CAPACITY_AH = 0.8, 0.03, 2.0
PER_K = 1.0 / 30.0


@dataclass(frozen=True)
class LinearCell:
    """V = 3 + 0.8 SoC + 30 mOhm I; 1 mOhm less for each kelvin by which it is warmer than was measured."""

    capacity_Ah: float = CAPACITY_AH
    soc_range: tuple[float, float] = (0.1, 0.9)
    activation_K: float = 0.0
    typical_Ohm: float = RESISTANCE_OHM
    dt_s: float = 1.0
    usual_A: float = 1.0
    trained_degC: float = 25.0
    diffusion_s: float | None = None

    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        return {"soc": self.soc_range, "current_A": (-2.0, 2.0)}

    def inputs(self, run, index, current_A, temperature_degC, _soc):
        warmer_K = temperature_degC - run.temperature_degC
        return ModelInputs(np.zeros(len(index)), (current_A * (1.0 - warmer_K * PER_K))[index][None, :])

    def slower_inputs(self, run, index, soc, _times):
        return self.inputs(run, index, run.current_A, run.temperature_degC, soc)

    def open_circuit_V(self, soc):
        return 3.0 + SLOPE_V * soc

    def loop_V(self, soc):
        return np.zeros(len(soc))

    def voltage_V(self, inputs, soc):
        return 3.0 + SLOPE_V * soc + RESISTANCE_OHM * inputs.signals[0]

    def slow_V(self, _inputs, soc):
        return np.zeros(len(soc))

    def overvoltage_V(self, run, soc, index, drive_A):
        return RESISTANCE_OHM * drive_A[index]


@dataclass(frozen=True)
class CurvedCell(LinearCell):
    """The same with an open-circuit curve of its own."""

    curve: Callable[[FloatArray], FloatArray] = lambda soc: 3.0 + soc
    soc_range: tuple[float, float] = (0.05, 0.97)

    def open_circuit_V(self, soc: FloatArray) -> FloatArray:
        return self.curve(soc)

    def voltage_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        return self.curve(soc) + RESISTANCE_OHM * inputs.signals[0]


def run(n: int = 2000) -> GridRun:
    rng = np.random.default_rng(1)
    current = np.repeat(rng.uniform(-2.0, 2.0, n // 50), 50)
    temperature = 25.0 + 10.0 * np.sin(np.arange(n) / 300.0)
    series = TimeSeries(np.arange(n) * 1.0, current, np.full(n, 3.5), temperature, np.full(n, 25.0))
    return to_grid(series, 1.0)


def linear_view(model: LinearCell | None = None, n: int = 2000) -> View:
    return View(model or LinearCell(), run(n), 0.5, np.arange(0, n, 3))


def thermal_view(heat_W: float = 2.0, n: int = 6000) -> ThermalView:
    still = np.full(n, 20.0)
    return ThermalView(np.full(n, heat_W), np.full(n, -3.0), still, still.copy(), 1.0, 5.0, 400.0)
