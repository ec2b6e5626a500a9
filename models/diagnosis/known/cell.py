"""A bounded network with the covariance of its coefficients, as a diagnosis asks for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from models.data.errors import ModelError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.effects.view import ModelInputs
from models.identification.bounded.knots import hats
from models.identification.bounded.layout import REFERENCE_DEGC, Layout
from models.identification.bounded.terms import BEHIND, SLOW
from models.network.regression import delayed
from models.network.signals import RunSignals, parse_signal, slower

# Range of the state of charge at the particles' surface, where a cell has one.
SURFACE = "surface_soc"
# Step of the derivative to the current, relative.
_SMALL = 1e-3


@dataclass(frozen=True)
class KnownCell:
    """A fitted bounded network.

    Attributes
    ----------
    layout : its terms and knots
    coefficients : (P,) in V, the curve by its values
    covariance : (P, P) of them in V^2
    capacity_Ah, dt_s : of the cell and the grid
    domain : ranges of SoC, also at the surface, current and temperature of the training runs
    typical_Ohm : overvoltage over current in the training runs
    usual : (B,) root mean square of each term's signal over its largest value
    """

    layout: Layout
    coefficients: FloatArray
    covariance: FloatArray
    capacity_Ah: float
    dt_s: float
    domain: dict[str, tuple[float, float]]
    typical_Ohm: float
    usual: FloatArray

    @property
    def soc_range(self) -> tuple[float, float]:
        """Range of SoC of the training runs."""
        return self.domain["soc"]

    @property
    def surface_range(self) -> tuple[float, float]:
        """Range of the SoC at the particles' surface."""
        return self.domain.get(SURFACE, self.soc_range)

    @property
    def trained_degC(self) -> float:
        """Middle of the temperatures of the training runs."""
        low, high = self.domain.get("temperature_degC", (25.0, 25.0))
        return 0.5 * (low + high)

    @property
    def activation_K(self) -> float:
        """The current is not scaled as a whole: each term has an activation of its own."""
        return 0.0

    def inputs(
        self, run: GridRun, index: np.ndarray, current_A: FloatArray, temperature_degC: FloatArray, soc: FloatArray
    ) -> ModelInputs:
        """Signals of current and temperature at `index`; the SoC of a sample is that of the one before.

        The (n,) state of charge says how fast it diffuses there, where that is slower towards empty.
        """
        if run.dt_s != self.dt_s:
            raise ModelError(f"{run.name}: on a grid of {run.dt_s:g} s; the model's is {self.dt_s:g} s")
        source = RunSignals(current_A, temperature_degC, soc, run.dt_s, self.capacity_Ah)
        shift = delayed(source.values(self.layout.basis.axis) - soc, 1)
        late = (delayed(run.charge_Ah, 1) - run.charge_Ah) / self.capacity_Ah
        of_surface = tuple(self.terms_of(BEHIND).tolist())
        return ModelInputs((shift + late)[index], self.signals(source, index), of_surface)

    @property
    def diffusion_s(self) -> float | None:
        """Slowest time constant at 25 degC by which the surface runs ahead; None: there is none."""
        return parse_signal(self.layout.basis.axis).parameters.get("time_constant_s")

    def slower_inputs(self, run: GridRun, index: np.ndarray, soc: FloatArray, times: float) -> ModelInputs:
        """Signals of the run where diffusion to the surface takes so many times as long."""
        return self._slower(times).inputs(run, index, run.current_A, run.temperature_degC, soc)

    def _slower(self, times: float) -> KnownCell:
        basis = self.layout.basis
        terms = [replace(term, signal=slower(term.signal, times)) for term in basis.terms]
        basis = replace(basis, axis=slower(basis.axis, times), terms=tuple(terms))
        return replace(self, layout=replace(self.layout, basis=basis))

    def signals(self, source: RunSignals, index: np.ndarray) -> FloatArray:
        """(B, m) signals of the terms over their largest values."""
        rows = np.empty((len(self.layout.basis.terms), len(index)))
        for b, (term, scale) in enumerate(zip(self.layout.basis.terms, self.layout.scale.tolist(), strict=True)):
            rows[b] = (source.values(term.signal)[index] - (0.0 if term.bounded else REFERENCE_DEGC)) / scale
        return rows

    def voltage_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) simulated voltage for a state of charge at the same samples."""
        surface = soc + inputs.surface
        return self.open_circuit_V(surface) + self.through(inputs.signals, surface, self._every)

    def slow_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) part of the voltage that relaxes in minutes and more, without the lead of the surface."""
        slow = [b for b, term in enumerate(self.layout.basis.terms) if SLOW in term.parts]
        chosen = np.setdiff1d(slow, self.terms_of(BEHIND))
        return self.through(inputs.signals, soc + inputs.surface, chosen)

    def through(self, signals: FloatArray, soc: FloatArray, chosen: np.ndarray) -> FloatArray:
        """(m,) voltage of some of the terms, given by their numbers."""
        out, among = np.zeros(len(soc)), np.zeros(len(self.layout.basis.terms), dtype=bool)
        among[chosen] = True
        for places, gains, numbers in self._groups:
            own = np.flatnonzero(among[numbers])
            if len(own):
                knots = self.layout.knots.soc[places]
                left = np.clip(np.searchsorted(knots, soc, side="right") - 1, 0, max(len(knots) - 2, 0))
                right = np.minimum(left + 1, len(knots) - 1)
                share = np.clip((soc - knots[left]) / np.maximum(knots[right] - knots[left], 1e-300), 0.0, 1.0)
                here = (1.0 - share) * gains[left][:, own].T + share * gains[right][:, own].T
                out += np.einsum("bm,bm->m", here, signals[numbers[own]])
        return out

    def loss_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) voltage that becomes heat: of the resistances, and of the charge that has not spread yet.

        Bernardi, Pawlikowski and Newman, J. Electrochem. Soc. 132, 1985: V - U by the mean state of charge.
        """
        surface = soc + inputs.surface
        unspread_V = self.open_circuit_V(surface) - self.open_circuit_V(soc)
        lossy = np.concatenate([self.resistive, self.terms_of(BEHIND)])
        return self.through(inputs.signals, surface, lossy) + unspread_V

    def loop_V(self, soc: FloatArray) -> FloatArray:
        """(n,) half the width of the hysteresis loop."""
        loops = self.terms_of("hysteresis_state")
        ends = np.zeros((len(self.layout.basis.terms), len(soc)))
        ends[loops] = 1.0 / self.layout.scale[loops, None]
        return self.through(ends, soc, loops)

    def overvoltage_V(self, run: GridRun, soc: FloatArray, index: np.ndarray, drive_A: FloatArray) -> FloatArray:
        """(m,) voltage across the resistances for another current, to first order around the run's own."""
        largest = max(float(np.abs(drive_A).max()), 1e-9)
        step = _SMALL * max(float(np.abs(run.current_A).max()), 1e-3 * self.capacity_Ah) / largest
        own, moved = (
            self.signals(
                RunSignals(current_A, run.temperature_degC, np.zeros(len(run)), run.dt_s, self.capacity_Ah), index
            )
            for current_A in (run.current_A, run.current_A + step * drive_A)
        )
        return self.through((moved - own) / step, soc[index], self.resistive)

    def open_circuit_V(self, soc: FloatArray) -> FloatArray:
        """(n,) open-circuit voltage at 25 degC, its slope continued beyond the knots."""
        knots, curve = self.layout.knots.soc, self.coefficients[: self.layout.n_curve]
        first = (curve[1] - curve[0]) / (knots[1] - knots[0])
        last = (curve[-1] - curve[-2]) / (knots[-1] - knots[-2])
        beyond = first * np.minimum(soc - knots[0], 0.0) + last * np.maximum(soc - knots[-1], 0.0)
        return np.interp(soc, knots, curve) + beyond

    def regressors(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m, P) derivatives of the voltage to the coefficients."""
        surface, layout = soc + inputs.surface, self.layout
        out = np.empty((len(soc), layout.size))
        out[:, : layout.n_curve] = hats(layout.knots.soc, surface)
        for b in range(len(layout.basis.terms)):
            part = slice(int(layout.first[b]), int(layout.first[b + 1]))
            out[:, part] = hats(layout.knots.soc[layout.places(b)], surface) * inputs.signals[b][:, None]
        return out

    @property
    def usual_A(self) -> float:
        """Root mean square of the current in the training runs."""
        kinds = [parse_signal(term.signal).kind for term in self.layout.basis.terms]
        place = next(b for b, kind in enumerate(kinds) if kind in ("current", "scaled_current"))
        return float(self.usual[place] * self.layout.scale[place])

    def terms_of(self, kind: str) -> np.ndarray:
        """Numbers of the terms whose signal is of a kind."""
        return np.array(
            [b for b, t in enumerate(self.layout.basis.terms) if parse_signal(t.signal).kind == kind], np.int64
        )

    @cached_property
    def resistive(self) -> np.ndarray:
        """Numbers of the terms that the current runs through, without what belongs to the curve."""
        others = np.concatenate([self.terms_of(kind) for kind in ("hysteresis_state", "temperature", BEHIND)])
        return np.setdiff1d(self._every, others)

    @cached_property
    def _every(self) -> np.ndarray:
        return np.arange(len(self.layout.basis.terms))

    @cached_property
    def _groups(self) -> list[tuple[np.ndarray, FloatArray, np.ndarray]]:
        """Terms that share their knots: places of these, (g, b) gains, numbers of the terms."""
        out = []
        for kind in sorted({(t.bounded, t.flat) for t in self.layout.basis.terms}):
            own = [b for b, t in enumerate(self.layout.basis.terms) if (t.bounded, t.flat) == kind]
            first = self.layout.first
            gains = [self.coefficients[int(first[b]) : int(first[b + 1])] for b in own]
            out.append((self.layout.places(own[0]), np.column_stack(gains), np.array(own, np.int64)))
        return out
