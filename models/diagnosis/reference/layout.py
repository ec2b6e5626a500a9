"""Signals of the reference model and where their coefficients are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.spline import SplineBasis
from models.effects.view import ModelInputs, ReferenceTerm
from models.network.signals import KELVIN, REFERENCE_K, RunSignals, arrhenius
from models.network.signals.filters import low_pass

TIME_CONSTANTS_S = (3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
OCV_BUMPS = 40
EXCHANGE_C_RATES = (0.2, 1.0)
TRANSFER_S = 20.0
_GAIN_BUMPS, _COARSE_BUMPS = 8, 4
_HYSTERESIS_RATES = (10.0, 40.0, 150.0)
# A low-pass from this time constant on is a slow current, which diffusion shows in.
_SLOW_S = 100.0
_REFERENCE_DEGC = 25.0
# Scales that bring the signals to the size of the current over the capacity.
_PER_10_K, _ACTIVATION_UNIT_K = 0.1, 3000.0
_SOC_MARGIN = 0.03
# Size, scale and term of a block.
_Kind = tuple[int, float, ReferenceTerm | None]


@dataclass(frozen=True)
class Shape:
    """Parameters that the reference model is not linear in.

    Attributes
    ----------
    activation_K : scaling of the current by temperature
    depth, time_constant_s : of the surface's state of charge
    """

    activation_K: float = 0.0
    depth: float = 0.0
    time_constant_s: float = 100.0


@dataclass(frozen=True)
class Block:
    """Coefficients of one signal's spline: where they are, the size that a gain of the signal has, and its term."""

    start: int
    size: int
    scale: float
    term: ReferenceTerm | None

    @property
    def part(self) -> slice:
        """Place in the vector of coefficients."""
        return slice(self.start, self.start + self.size)


@dataclass(frozen=True)
class Layout:
    """Signals of the reference model for a cell and a shape.

    Attributes
    ----------
    capacity_Ah, dt_s : of the cell and the grid
    soc_range : of the training runs
    shape : non-linear parameters
    with_temperature : whether temperature was measured
    """

    capacity_Ah: float
    dt_s: float
    soc_range: tuple[float, float]
    shape: Shape
    with_temperature: bool

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """Open-circuit curve, currents, charge transfer, hysteresis, temperature."""
        kinds = _alike(OCV_BUMPS, 1.0, None) + _alike(_GAIN_BUMPS, self.capacity_Ah, None)
        for tau_s in TIME_CONSTANTS_S:
            kinds += _alike(_GAIN_BUMPS, self.capacity_Ah, "slow_current" if tau_s >= _SLOW_S else None)
        kinds += _alike(_COARSE_BUMPS, 1.0, "charge_transfer", 2 * len(EXCHANGE_C_RATES))
        kinds += _alike(_COARSE_BUMPS, 1.0, "hysteresis", len(_HYSTERESIS_RATES))
        if self.with_temperature:
            kinds += _alike(_COARSE_BUMPS, 1.0, "entropy")
            kinds += _alike(_COARSE_BUMPS, self.capacity_Ah, "warm_current", 2)
        blocks, start = [], 0
        for size, scale, term in kinds:
            blocks.append(Block(start, size, scale, term))
            start += size
        return tuple(blocks)

    def places_of(self, terms: tuple[ReferenceTerm, ...]) -> np.ndarray:
        """(size,) whether a coefficient belongs to one of some terms."""
        out = np.zeros(self.size, dtype=bool)
        for block in self.blocks:
            out[block.part] = block.term in terms
        return out

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.blocks[-1].part.stop

    @cached_property
    def bases(self) -> dict[int, SplineBasis]:
        """Splines by their number of bumps."""
        low, high = self.soc_range
        sizes = (OCV_BUMPS, _GAIN_BUMPS, _COARSE_BUMPS)
        return {size: SplineBasis(low - _SOC_MARGIN, high + _SOC_MARGIN, size) for size in sizes}

    def drive_A(self, current_A: FloatArray, temperature_degC: FloatArray) -> FloatArray:
        """Current scaled by temperature."""
        if not self.shape.activation_K:
            return current_A
        return current_A * arrhenius(temperature_degC, self.shape.activation_K)

    def currents(self, drive_A: FloatArray) -> list[FloatArray]:
        """The scaled current and its low-passes."""
        return [drive_A, *(low_pass(drive_A, tau_s, self.dt_s) for tau_s in TIME_CONSTANTS_S)]

    def signals(self, current_A: FloatArray, drive_A: FloatArray, temperature_degC: FloatArray) -> list[FloatArray]:
        """(n,) signal of each block but the first."""
        out = self.currents(drive_A)
        for rate in EXCHANGE_C_RATES:
            transfer = np.arcsinh(drive_A / (rate * self.capacity_Ah))
            out += [transfer, low_pass(transfer, TRANSFER_S, self.dt_s)]
        source = RunSignals(current_A, temperature_degC, current_A, self.dt_s, self.capacity_Ah)
        out += [source.values(f"hysteresis_state:{rate:g}") for rate in _HYSTERESIS_RATES]
        if self.with_temperature:
            warm = current_A * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K) * _ACTIVATION_UNIT_K
            out += [_PER_10_K * (temperature_degC - _REFERENCE_DEGC), warm, low_pass(warm, 100.0, self.dt_s)]
        return out

    def inputs(self, current_A: FloatArray, temperature_degC: FloatArray, index: np.ndarray) -> ModelInputs:
        """Signals at `index`."""
        drive_A = self.drive_A(current_A, temperature_degC)
        signals = np.array([signal[index] for signal in self.signals(current_A, drive_A, temperature_degC)])
        return ModelInputs(self._surface(drive_A)[index], signals)

    def _surface(self, drive_A: FloatArray) -> FloatArray:
        """(n,) state of charge at the particles' surface less the mean one."""
        if not self.shape.depth:
            return np.zeros(len(drive_A))
        return self.shape.depth * low_pass(drive_A, self.shape.time_constant_s, self.dt_s) / self.capacity_Ah

    def splines(self, soc: FloatArray) -> dict[int, FloatArray]:
        """(m, size) bumps by their number."""
        return {size: basis.matrix(soc) for size, basis in self.bases.items()}

    def regressors(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m, size) regressors for signals and the state of charge at the same samples."""
        splines = self.splines(soc + inputs.surface)
        out = np.empty((len(soc), self.size))
        out[:, self.blocks[0].part] = splines[OCV_BUMPS]
        for block, signal in zip(self.blocks[1:], inputs.signals, strict=True):
            np.multiply(splines[block.size], signal[:, None], out=out[:, block.part])
        return out

    def penalties(self) -> list[FloatArray]:
        """Quadratic forms: roughness of the open-circuit curve, of the gains, and size of the gains."""
        forms: list[FloatArray] = [np.zeros((self.size, self.size)) for _ in range(3)]
        first = self.blocks[0]
        finer = (first.size / 10.0) ** 5
        forms[0][first.part, first.part] = finer * SplineBasis(0.0, 1.0, first.size).roughness(3)
        for block in self.blocks[1:]:
            forms[1][block.part, block.part] = block.scale**2 * SplineBasis(0.0, 1.0, block.size).roughness(2)
            forms[2][block.part, block.part] = block.scale**2 * np.eye(block.size)
        return forms


def _alike(size: int, scale: float, term: ReferenceTerm | None, count: int = 1) -> list[_Kind]:
    return [(size, scale, term)] * count
