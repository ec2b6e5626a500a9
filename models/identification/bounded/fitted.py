"""A bounded network with its parameters: the form that was chosen, solved on all samples, and written as a network."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.timeseries import FloatArray
from models.identification.bounded.knots import hats
from models.identification.bounded.layout import REFERENCE_DEGC, Layout, soc_over
from models.identification.bounded.monotone import rising
from models.identification.bounded.problem import Sums, regressors, rest_weights
from models.identification.bounded.strengths import START, HeldOut
from models.identification.bounded.variants import Trials, Variant
from models.network.partition import Partition, hat_partition
from models.network.regression import VOLTAGE, Scaling, SignalBank
from models.network.structure import InputChannel, PartitionAxis, Structure

# Samples in the sums of the final fit; more of them tell nothing new.
_SAMPLES = 400_000
# A gain that never makes more than this, at the largest signal of the runs, is none.
_NEGLIGIBLE_V = 1e-9


@dataclass(frozen=True)
class BoundedFit:
    """A bounded network's coefficients.

    Attributes
    ----------
    bank : signals of the runs
    variant : form
    held : sums, and the fits that leave a fold out
    log_strengths : of the penalties
    coefficients : (P,) the curve by its values, all in V
    """

    bank: SignalBank
    variant: Variant
    held: HeldOut
    log_strengths: tuple[float, ...]
    coefficients: FloatArray

    @property
    def layout(self) -> Layout:
        """Where each coefficient stands."""
        return self.held.sums.layout

    @property
    def held_out_rmse_V(self) -> float:
        """Error on held-out samples."""
        return float(np.sqrt(self.held.mean_mse(self.log_strengths)))


def fit_variant(trials: Trials, variant: Variant) -> BoundedFit:
    """Fit a form to all samples with the strengths that served it best; terms that come out as nothing are left out.

    Forms are compared, and all is judged, by errors on all samples alike, since how far off one is where nothing flows
    for hours counts, too. What is fitted counts a rest for less than its samples.
    """
    trials.error(variant)
    alike, logs = trials.known[variant]
    weight = rest_weights(trials.bank)
    held = trials.held_out(variant, trials.keep_every, weight) if weight.min() < 1.0 else alike
    logs = held.even(logs, START)
    n_samples = sum(len(run) for run in trials.bank.runs)
    keep_every = max(1, n_samples // _SAMPLES)
    if keep_every < trials.keep_every:
        held = trials.held_out(variant, keep_every, weight)
    solved = held.whole(logs).x
    layout = held.sums.layout
    kept = [b for b in range(len(layout.basis.terms)) if np.abs(solved[_part(layout, b)]).max() > _NEGLIGIBLE_V]
    held = HeldOut(_restricted(held.sums, kept), _restricted(alike.sums, kept))
    return solved_fit(trials.bank, variant, held, logs)


def solved_fit(bank: SignalBank, variant: Variant, held: HeldOut, logs: tuple[float, ...]) -> BoundedFit:
    """Solve a form's sums, with a curve that rises at every temperature of the runs."""
    degC = np.concatenate([run.temperature_degC for run in bank.runs])
    span = (REFERENCE_DEGC, REFERENCE_DEGC) if np.isnan(degC).any() else (float(degC.min()), float(degC.max()))
    return BoundedFit(bank, variant, held, logs, curve_by_values(held.sums.layout, rising(held, logs, span)))


def curve_by_values(layout: Layout, x: FloatArray) -> FloatArray:
    """(P,) coefficients with the curve's values in place of its increments."""
    out = x.copy()
    out[: layout.n_curve] = np.cumsum(x[: layout.n_curve])
    return out


def held_out_error(fit: BoundedFit, fold: np.ndarray) -> FloatArray:
    """(N,) measured minus simulated in V of each sample of all runs by a fit that did not see its fold."""
    layout, logs = fit.layout, fit.log_strengths
    voltage = np.concatenate([run.voltage_V for run in fit.bank.runs])
    rows = regressors(fit.bank, layout.basis, layout.scale)
    soc = np.concatenate(soc_over(fit.bank, layout.basis.axis))
    error = np.full(len(voltage), np.nan)
    for number in range(len(fit.held.sums.count)):
        held = np.flatnonzero(fold == number)
        if len(held):
            x = curve_by_values(layout, fit.held.without(logs, number).x)
            error[held] = voltage[held] - simulated(layout, x, rows[held], soc[held])
    return error


def simulated(layout: Layout, coefficients: FloatArray, rows: FloatArray, soc: FloatArray) -> FloatArray:
    """(m,) voltage of samples inside the trained range of SoC."""
    knots = layout.knots
    out = np.interp(soc, knots.soc, coefficients[: layout.n_curve])
    for b in range(len(layout.basis.terms)):
        out += rows[:, b] * np.interp(soc, knots.soc[layout.places(b)], coefficients[_part(layout, b)])
    return out


def network_parts(fit: BoundedFit, name: str) -> tuple[Structure, Partition, FloatArray, Scaling]:
    """Structure, partition, (M, p) parameters and scaling of the same as a local model network.

    Each knot of the curve is a local model; one more on each side continues the curve's slope and holds the gains.
    """
    layout = fit.layout
    run, voltage = fit.bank.runs[0], fit.bank.bounds(VOLTAGE)
    structure = Structure(
        output_order=0,
        inputs=tuple(InputChannel(term.signal) for term in layout.basis.terms),
        axes=(PartitionAxis(layout.basis.axis),),
        dt_s=run.dt_s,
        kernel="hat",
        name=name,
    )
    scaling: Scaling = {layout.basis.axis: (0.0, 1.0), VOLTAGE: voltage}
    for term, scale in zip(layout.basis.terms, layout.scale.tolist(), strict=True):
        offset = 0.0 if term.bounded else REFERENCE_DEGC
        scaling[term.signal] = (offset, offset + scale)
    return structure, hat_partition(layout.knots.outer), theta_of(layout, fit.coefficients, voltage), scaling


def theta_of(layout: Layout, coefficients: FloatArray, voltage: tuple[float, float]) -> FloatArray:
    """(M, p) parameters of the network from (P,) coefficients, the curve by its values, in units of a voltage range."""
    outer, inner, curve = layout.knots.outer, layout.knots.soc, coefficients[: layout.n_curve]
    low = curve[0] - (curve[1] - curve[0]) / (inner[1] - inner[0]) * (inner[0] - outer[0])
    high = curve[-1] + (curve[-1] - curve[-2]) / (inner[-1] - inner[-2]) * (outer[-1] - inner[-1])
    gains = [
        hats(inner[layout.places(b)], outer) @ coefficients[_part(layout, b)] for b in range(len(layout.basis.terms))
    ]
    theta = np.column_stack([*gains, np.concatenate([[low], curve, [high]]) - voltage[0]]) / (voltage[1] - voltage[0])
    return np.ascontiguousarray(theta)


def _part(layout: Layout, term: int) -> slice:
    return slice(int(layout.first[term]), int(layout.first[term + 1]))


def _restricted(sums: Sums, kept: list[int]) -> Sums:
    """The same sums of some of the terms."""
    layout = sums.layout
    places = np.concatenate([np.arange(layout.n_curve), *(np.arange(layout.size)[_part(layout, b)] for b in kept)])
    sizes = [layout.first[b + 1] - layout.first[b] for b in kept]
    smaller = replace(
        layout,
        basis=replace(layout.basis, terms=tuple(layout.basis.terms[b] for b in kept)),
        scale=layout.scale[kept],
        first=np.concatenate([[layout.n_curve], layout.n_curve + np.cumsum(sizes, dtype=np.int64)]).astype(np.int64),
    )
    grid = np.ix_(places, places)
    xx = np.array([matrix[grid] for matrix in sums.xx])
    penalties = np.array([matrix[grid] for matrix in sums.penalties])
    return Sums(smaller, xx, sums.xy[:, places], sums.yy, sums.count, penalties)
