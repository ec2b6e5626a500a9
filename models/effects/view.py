"""What an effect sees of one run: measured inputs, signals made from them, and the model's own voltage."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, Protocol

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.effects.spline import SplineBasis
from models.network.signals import KELVIN, REFERENCE_K, direction, filters

# Terms of the model that effects are judged against, beside its open-circuit curve and its quick currents.
ReferenceTerm = Literal["slow_current", "charge_transfer", "hysteresis", "entropy", "warm_current"]

_SMALL_SOC = 1e-3


@dataclass(frozen=True)
class ModelInputs:
    """Signals of current and temperature at chosen samples, before the state of charge comes in.

    Attributes
    ----------
    surface : (m,) state of charge at the particles' surface less the mean one
    signals : (b, m) signals that the model's gains multiply
    of_surface : numbers of those that are the surface's lead over the mean
    """

    surface: FloatArray
    signals: FloatArray
    of_surface: tuple[int, ...] = ()

    def ahead(self, factor: float) -> ModelInputs:
        """Return the same with a surface that is so many times as far ahead."""
        signals = self.signals.copy()
        signals[list(self.of_surface)] *= factor
        return replace(self, surface=factor * self.surface, signals=signals)


class OwnModel(Protocol):
    """The model that effects are judged against."""

    @property
    def capacity_Ah(self) -> float:
        """Capacity that the model assumes."""
        ...

    @property
    def dt_s(self) -> float:
        """Step of the model's grid."""
        ...

    @property
    def usual_A(self) -> float:
        """Current of the runs that the model was made from, as it usually is."""
        ...

    @property
    def soc_range(self) -> tuple[float, float]:
        """Range of SoC that the model was made from."""
        ...

    @property
    def activation_K(self) -> float:
        """Activation temperature by which the model scales the current."""
        ...

    @property
    def typical_Ohm(self) -> float:
        """Overvoltage over current, as it usually is."""
        ...

    @property
    def trained_degC(self) -> float:
        """Middle of the temperatures that the model was made from."""
        ...

    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        """Ranges of SoC, current and temperature that the model was made from."""
        ...

    def inputs(
        self, run: GridRun, index: np.ndarray, current_A: FloatArray, temperature_degC: FloatArray, soc: FloatArray
    ) -> ModelInputs:
        """What the model makes of current and temperature at `index`; the (n,) SoC says how fast it diffuses there."""
        ...

    @property
    def diffusion_s(self) -> float | None:
        """Time constant of the diffusion by which the surface of the particles runs ahead; None: it does not."""
        ...

    def slower_inputs(self, run: GridRun, index: np.ndarray, soc: FloatArray, times: float) -> ModelInputs:
        """What the model makes of the run's current and temperature where that diffusion takes so many times as long.

        Settled differences and times to them grow alike.
        """
        ...

    def voltage_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) simulated voltage for a state of charge at the same samples."""
        ...

    def slow_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) part of it that relaxes in minutes and more, without the lead of the surface."""
        ...

    def open_circuit_V(self, soc: FloatArray) -> FloatArray:
        """(n,) open-circuit voltage at 25 degC."""
        ...

    def loop_V(self, soc: FloatArray) -> FloatArray:
        """(n,) half the width of the model's hysteresis loop."""
        ...

    def overvoltage_V(self, run: GridRun, soc: FloatArray, index: np.ndarray, drive_A: FloatArray) -> FloatArray:
        """(m,) voltage across the model's resistances, linearised, for a scaled current through them."""
        ...


@dataclass(frozen=True)
class View:
    """One run with the model's voltage at chosen samples.

    Attributes
    ----------
    model : the model that the effect is judged against
    run : measurement on the model's grid
    initial_soc : fraction 0..1
    index : (m,) samples that are looked at
    passed_Ah : charge that had passed, either way, before the run, since the cell was as the model has it
    """

    model: OwnModel
    run: GridRun
    initial_soc: float
    index: np.ndarray
    passed_Ah: float = 0.0

    @property
    def capacity_Ah(self) -> float:
        """Capacity that the model assumes."""
        return self.model.capacity_Ah

    @cached_property
    def soc(self) -> FloatArray:
        """(n,) counted state of charge."""
        return self.initial_soc + self.run.charge_Ah / self.capacity_Ah

    @cached_property
    def inputs(self) -> ModelInputs:
        """The model's signals for the measured current and temperature."""
        return self.model.inputs(self.run, self.index, self.run.current_A, self.run.temperature_degC, self.soc)

    @cached_property
    def voltage_V(self) -> FloatArray:
        """(m,) the model's voltage."""
        return self.model.voltage_V(self.inputs, self.soc[self.index])

    @cached_property
    def residual_V(self) -> FloatArray:
        """(m,) measured minus simulated voltage."""
        return self.run.voltage_V[self.index] - self.voltage_V

    @cached_property
    def inverse_temperature(self) -> FloatArray:
        """(n,) 1/T - 1/298.15 K; zeros where no temperature is known."""
        temperature = self.run.temperature_degC
        if np.isnan(temperature).any():
            return np.zeros(len(temperature))
        return 1.0 / (temperature + KELVIN) - 1.0 / REFERENCE_K

    @cached_property
    def drive_A(self) -> FloatArray:
        """(n,) current scaled as the model scales its resistances by temperature."""
        return self.run.current_A * np.exp(self.model.activation_K * self.inverse_temperature)

    @cached_property
    def throughput_Ah(self) -> FloatArray:
        """(n,) charge that has passed, either way, since the start."""
        return np.cumsum(np.abs(self.run.current_A)) * self.run.dt_s / 3600.0

    @property
    def aged_Ah(self) -> FloatArray:
        """(n,) the same since the cell was as the model has it."""
        return self.passed_Ah + self.throughput_Ah

    @cached_property
    def loss_W(self) -> FloatArray:
        """(n,) heat that the model's resistances give off."""
        whole = replace(self, index=np.arange(len(self.run)))
        return self.run.current_A * whole.overvoltage(self.drive_A)

    @cached_property
    def slope_V(self) -> FloatArray:
        """(m,) change of the model's voltage by a change of SoC of 1."""
        return self.moved(soc=self.soc + _SMALL_SOC) / _SMALL_SOC

    def low_pass(self, values: FloatArray, time_constant_s: float) -> FloatArray:
        """(m,) first-order low-pass of a signal over the whole run."""
        return filters.low_pass(values, time_constant_s, self.run.dt_s)[self.index]

    def hysteresis(self, rate: float) -> FloatArray:
        """(m,) one-state hysteresis."""
        return direction.hysteresis_state(self.run.current_A, rate, self.run.dt_s, self.capacity_Ah)[self.index]

    def bumps(self, size: int) -> FloatArray:
        """(m, size) smooth bumps over the model's range of SoC that add up to 1."""
        return SplineBasis(*self.model.soc_range, size).matrix(self.soc[self.index])

    def overvoltage(self, drive_A: FloatArray) -> FloatArray:
        """(m,) voltage across the model's resistances for another scaled current."""
        return self.model.overvoltage_V(self.run, self.soc, self.index, drive_A)

    def late_V(self, samples: int) -> FloatArray:
        """(m,) change of the model's voltage where the current comes whole samples later; before, where negative."""
        if samples not in self._late:
            current_A = self.run.current_A
            later_A = current_A[np.clip(np.arange(len(current_A)) - samples, 0, len(current_A) - 1)]
            self._late[samples] = self.moved(current_A=later_A)
        return self._late[samples]

    @cached_property
    def _late(self) -> dict[int, FloatArray]:
        # A search for a delay asks for the same few over and over.
        return {0: np.zeros(len(self.index))}

    def slowed_V(self, times: float) -> FloatArray:
        """(m,) change of the model's voltage where diffusion to its surface takes so many times as long."""
        inputs = self.model.slower_inputs(self.run, self.index, self.soc, times)
        return self.model.voltage_V(inputs, self.soc[self.index]) - self.voltage_V

    def moved(
        self,
        soc: FloatArray | None = None,
        current_A: FloatArray | None = None,
        temperature_degC: FloatArray | None = None,
    ) -> FloatArray:
        """(m,) change of the model's voltage when its inputs are others."""
        inputs = self.inputs
        if current_A is not None or temperature_degC is not None:
            current = self.run.current_A if current_A is None else current_A
            temperature = self.run.temperature_degC if temperature_degC is None else temperature_degC
            inputs = self.model.inputs(self.run, self.index, current, temperature, self.soc)
        own = self.soc if soc is None else soc
        return self.model.voltage_V(inputs, own[self.index]) - self.voltage_V
