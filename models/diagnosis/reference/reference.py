"""A model for the diagnosis alone: linear in its parameters, without output feedback, rich, and sure of its limits.

A network with output feedback hides effects: its slow poles imitate hysteresis and relaxation. Here the voltage is a
sum of signals of the inputs, each times a spline over the state of charge at the particles' surface: open-circuit
curve, low-passed currents, charge transfer, hysteresis, temperature. Penalties keep neighbouring spline coefficients
alike; their strengths make the training runs most likely, and the few shape parameters are chosen on held-out
blocks of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.reference.layout import EXCHANGE_C_RATES, OCV_BUMPS, TRANSFER_S, Block, Layout, Shape
from models.diagnosis.reference.penalised import PenalisedFit, penalised_fit
from models.effects.view import ModelInputs
from models.network.signals.filters import low_pass

_SURFACES = tuple((depth, tau_s) for depth in (0.01, 0.025, 0.05, 0.1) for tau_s in (100.0, 400.0, 1500.0))
_ACTIVATIONS_K = (0.0, 1000.0, 2000.0, 3000.0, 4500.0)
# Samples that the search for shape parameters looks at, and those of the final fit.
_SEARCH_SAMPLES, _FIT_SAMPLES = 6_000, 25_000
_WORTH = 0.998
# Temperatures that differ by less cannot show what temperature does.
_TEMPERATURE_RANGE_K = 3.0
# Fewer samples, or a smaller movement of the state of charge, leave everything to the penalties.
_FEWEST_SAMPLES, _LEAST_SOC = 100, 0.002


@dataclass(frozen=True)
class Reference:
    """A fitted reference model.

    Attributes
    ----------
    layout : its signals
    coefficients : (p,)
    penalty : (p, p) that was added to the information
    domain : ranges of SoC, current and temperature of the training runs
    own_rms_V : error on the training runs
    held_out_rms_V : error on held-out blocks of them
    """

    layout: Layout
    coefficients: FloatArray
    penalty: FloatArray
    domain: dict[str, tuple[float, float]]
    own_rms_V: float
    held_out_rms_V: float

    @property
    def capacity_Ah(self) -> float:
        """Capacity that the model assumes."""
        return self.layout.capacity_Ah

    @property
    def dt_s(self) -> float:
        """Step of the grid."""
        return self.layout.dt_s

    @property
    def soc_range(self) -> tuple[float, float]:
        """Range of SoC that the model was made from."""
        return self.layout.soc_range

    @property
    def activation_K(self) -> float:
        """Activation temperature by which the current is scaled."""
        return self.layout.shape.activation_K

    @property
    def typical_Ohm(self) -> float:
        """Overvoltage over current, as it usually is."""
        return float(np.mean(self.coefficients[self.layout.blocks[1].part]))

    @property
    def usual_A(self) -> float:
        """Current of the training runs, as it usually is: half of the largest."""
        return 0.5 * max(abs(each) for each in self.domain["current_A"])

    @property
    def trained_degC(self) -> float:
        """Middle of the temperatures that the model was made from."""
        low, high = self.domain.get("temperature_degC", (25.0, 25.0))
        return 0.5 * (low + high)

    def inputs(
        self, run: GridRun, index: np.ndarray, current_A: FloatArray, temperature_degC: FloatArray, soc: FloatArray
    ) -> ModelInputs:
        """Signals of current and temperature at `index`, whatever the state of charge."""
        if run.dt_s != self.layout.dt_s:
            raise ModelError(f"{run.name}: on a grid of {run.dt_s:g} s; the model's is {self.layout.dt_s:g} s")
        return self.layout.inputs(current_A, temperature_degC, index)

    @property
    def diffusion_s(self) -> float | None:
        """The surface is the mean."""
        return None

    def slower_inputs(self, run: GridRun, index: np.ndarray, soc: FloatArray, times: float) -> ModelInputs:
        """The same inputs, since no surface runs ahead."""
        return self.inputs(run, index, run.current_A, run.temperature_degC, soc)

    def voltage_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) simulated voltage for a state of charge at the same samples."""
        splines = self.layout.splines(soc + inputs.surface)
        first, *others = self.layout.blocks
        out = splines[first.size] @ self.coefficients[first.part]
        return out + self._through(splines, others, inputs.signals)

    def slow_V(self, inputs: ModelInputs, soc: FloatArray) -> FloatArray:
        """(m,) part of it that relaxes in minutes and more."""
        places = [i for i, block in enumerate(self.layout.blocks[1:]) if block.term == "slow_current"]
        blocks = [self.layout.blocks[1 + i] for i in places]
        return self._through(self.layout.splines(soc + inputs.surface), blocks, inputs.signals[places])

    def overvoltage_V(self, run: GridRun, soc: FloatArray, index: np.ndarray, drive_A: FloatArray) -> FloatArray:
        """(m,) voltage across the resistances for another scaled current, to first order around the run's own."""
        layout = self.layout
        own_A = layout.drive_A(run.current_A, run.temperature_degC)
        splines = layout.splines(soc[index] + layout.inputs(run.current_A, run.temperature_degC, index).surface)
        currents = layout.currents(drive_A)
        for rate in EXCHANGE_C_RATES:
            linear = drive_A / np.hypot(rate * self.capacity_Ah, own_A)
            currents += [linear, low_pass(linear, TRANSFER_S, layout.dt_s)]
        chosen = layout.blocks[1 : 1 + len(currents)]
        return self._through(splines, chosen, np.array([signal[index] for signal in currents]))

    def _through(self, splines: dict[int, FloatArray], blocks: Sequence[Block], signals: FloatArray) -> FloatArray:
        """Sum of signals times their gains over SoC; blocks of one size are taken together."""
        out = np.zeros(signals.shape[1])
        for size, spline in splines.items():
            own = [i for i, block in enumerate(blocks) if block.size == size]
            if own:
                gains = spline @ np.array([self.coefficients[blocks[i].part] for i in own]).T
                out += np.einsum("mb,bm->m", gains, signals[own])
        return out

    def loop_V(self, soc: FloatArray) -> FloatArray:
        """(n,) half the width of the hysteresis loop."""
        blocks = [block for block in self.layout.blocks if block.term == "hysteresis"]
        return self._through(self.layout.splines(soc), blocks, np.ones((len(blocks), len(soc))))

    def open_circuit_V(self, soc: FloatArray) -> FloatArray:
        """(n,) open-circuit voltage at 25 degC."""
        return self.layout.bases[OCV_BUMPS].matrix(soc) @ self.coefficients[self.layout.blocks[0].part]


def fit_reference(
    runs: list[GridRun],
    initial_soc: list[float],
    capacity_Ah: float,
    shape: Shape | None = None,
) -> Reference:
    """Fit the reference model to runs.

    Parameters
    ----------
    runs : on one grid
    initial_soc : of each run
    capacity_Ah : of the cell
    shape : of the model; None: chosen on held-out blocks

    Raises
    ------
    NotIdentifiableError
        Too few samples, or a state of charge that hardly moves.
    """
    soc = [s + run.charge_Ah / capacity_Ah for run, s in zip(runs, initial_soc, strict=True)]
    _check(runs, soc)
    temperature = np.concatenate([run.temperature_degC for run in runs])
    known = not bool(np.isnan(temperature).any())
    soc_range = (float(min(s.min() for s in soc)), float(max(s.max() for s in soc)))

    def fitted(shape: Shape, samples: int, strengths: tuple[float, ...] | None = None) -> tuple[Layout, PenalisedFit]:
        layout = Layout(capacity_Ah, runs[0].dt_s, soc_range, shape, known)
        stride = max(1, sum(len(run) for run in runs) // samples)
        parts = []
        for run, s in zip(runs, soc, strict=True):
            index = np.flatnonzero(run.measured)[::stride]
            inputs = layout.inputs(run.current_A, run.temperature_degC, index)
            parts.append((layout.regressors(inputs, s[index]), run.voltage_V[index]))
        return layout, penalised_fit([x for x, _ in parts], [y for _, y in parts], layout.penalties(), strengths)

    warm = known and float(np.ptp(temperature)) >= _TEMPERATURE_RANGE_K
    if shape is None:
        # Shapes are compared at the strengths that suit the first of them.
        start = Shape(2000.0 if warm else 0.0, 0.05, 100.0)
        strengths = fitted(start, _SEARCH_SAMPLES)[1].strengths
        shape = _best_shape(lambda each: fitted(each, _SEARCH_SAMPLES, strengths)[1].held_out_mse, start, warm)
    layout, fit = fitted(shape, _FIT_SAMPLES)
    domain = {"soc": soc_range, "current_A": _span([run.current_A for run in runs])}
    if known:
        domain["temperature_degC"] = _span([run.temperature_degC for run in runs])
    rms = (float(np.sqrt(fit.own_mse)), float(np.sqrt(fit.held_out_mse)))
    return Reference(layout, fit.coefficients, fit.penalty / fit.n_samples, domain, *rms)


def _check(runs: list[GridRun], soc: list[FloatArray]) -> None:
    """Refuse runs that cannot carry a model of any shape."""
    samples = sum(int(run.measured.sum()) for run in runs)
    moved = max(float(s.max()) for s in soc) - min(float(s.min()) for s in soc)
    if samples < _FEWEST_SAMPLES or not moved >= _LEAST_SOC:
        raise NotIdentifiableError(
            f"diagnosis: {samples} samples with a voltage, over {100 * moved:.2g} % of the state of charge, are too "
            f"little to hold a cell against; at least {_FEWEST_SAMPLES} over {100 * _LEAST_SOC:g} % are needed: name "
            "longer runs"
        )


def _best_shape(error: Callable[[Shape], float], start: Shape, warm: bool) -> Shape:
    """Choose one shape parameter after the other."""
    known: dict[Shape, float] = {}

    def judged(shape: Shape) -> float:
        if shape not in known:
            known[shape] = error(shape)
        return known[shape]

    best = start
    flat = [Shape(best.activation_K)]
    for stage in (0, 1, 0):
        if stage == 0:
            tried = flat + [Shape(best.activation_K, depth, tau_s) for depth, tau_s in _SURFACES]
        else:
            tried = [Shape(k, best.depth, best.time_constant_s) for k in (_ACTIVATIONS_K if warm else (0.0,))]
        found = min(tried, key=judged)
        if judged(found) < _WORTH * judged(best):
            best = found
    return best


def _span(parts: list[FloatArray]) -> tuple[float, float]:
    return float(min(p.min() for p in parts)), float(max(p.max() for p in parts))
