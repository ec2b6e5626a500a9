"""From training runs to a known cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from models.data.errors import NotIdentifiableError
from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import SURFACE, KnownCell
from models.diagnosis.known.left import Left, covariance_of, left_of, noise_of
from models.diagnosis.known.thresholds import KNOWN
from models.diagnosis.known.training_starts import Fitted, TrainingStarts, training_starts
from models.effects.view import View
from models.identification.bounded.best_variant import best_variant
from models.identification.bounded.fitted import curve_by_values
from models.identification.bounded.knots import make_knots
from models.identification.bounded.layout import Layout, make_layout, soc_over
from models.identification.bounded.monotone import rising
from models.identification.bounded.problem import fold_of, groups_of, make_sums, run_index
from models.identification.bounded.strengths import START, HeldOut, penalty
from models.identification.bounded.variants import CURVE, GAINS, SLOPES, Trials, Variant
from models.network.folds import outer_folds
from models.network.regression import CellContext, SignalBank

# Curve and gains have knots over all of this, whatever was trained: what was not is open and not exact.
_WHOLE_SOC = (0.02, 1.0)
# Samples in the sums: more tell nothing new.
_SAMPLES = 25_000
# Least range of the state of charge in which a curve can be seen.
_LEAST_SOC = 1e-6


def fit_known(
    runs: list[GridRun],
    soc: list[float],
    capacity_Ah: float,
    variant: Variant | None = None,
    *,
    starts_known: bool = False,
) -> tuple[KnownCell, Left]:
    """Fit the bounded network of a diagnosis.

    Parameters
    ----------
    runs, soc : training runs on one grid, with their SoC at the start
    capacity_Ah : of the cell
    variant : form of the network; None: chosen by held-out error
    starts_known : the runs were simulated, at rest, from just where they are said to begin

    Raises
    ------
    NotIdentifiableError
        No charge goes in or out.
    """
    bank = SignalBank(runs, soc, CellContext(capacity_Ah))
    low, high = _span(bank, "soc")
    if high - low < _LEAST_SOC:
        raise NotIdentifiableError(
            f"diagnosis: the training runs stand still at a state of charge of {low:.2f}, and say nothing of the cell: "
            "name others, through which a current flows, or none"
        )
    found, fold = None if starts_known else _found(bank, variant), fold_of(bank)
    if found is None:
        # Whole runs are held out wherever there are three, for what differs between them.
        fold = outer_folds(run_index(bank), groups_of(bank))
        held, logs = _chosen(bank, variant, fold)
        # Where they are not moved starts are open none the less.
        where = None if starts_known else training_starts(_fitted(bank, bank, held, logs), bank.runs, bank.initial_soc)
        found = bank, held, logs, where
    placed, held, logs, starts = found
    cell = _cell(placed, held, logs)
    left = left_of(cell, placed, held, logs, starts, fold)
    if starts is not None:
        cell = replace(cell, covariance=cell.covariance + starts.of_coefficients_V2)
    return cell, left


def _found(
    bank: SignalBank, variant: Variant | None
) -> tuple[SignalBank, HeldOut, tuple[float, ...], TrainingStarts] | None:
    """Runs without what their starts make of the voltage, form and strengths for them; None where this is not worth it.

    Which form is best shows once the runs begin where they did. A fifth of each run is held out and not a whole one,
    which would take its part of the window along: what differs from run to run is what is found.
    """
    fifths = fold_of(bank)
    rough = _held(bank, variant or Variant(), fifths)
    placed = _roughly_placed(bank, rough, KNOWN.start_soc)
    if not _worth(_summed(placed, rough.sums.layout, fifths), START, rough, START, KNOWN.start_promise):
        return None
    held, logs = _chosen(placed, variant, fifths)
    starts = training_starts(_fitted(bank, placed, held, logs), bank.runs, bank.initial_soc)
    placed, said = _placed(bank, starts), _summed(bank, held.sums.layout, fifths)
    held = _summed(placed, held.sums.layout, fifths)
    worth = _worth(held, logs, said, said.even(START, logs), KNOWN.start_worth)
    return (placed, held, logs, starts) if worth else None


def likely_soc(bank: SignalBank, soc_std: float) -> tuple[FloatArray, FloatArray]:
    """By how much each training run's state of charge is likely to lie above the stated one, whatever went before it.

    Parameters
    ----------
    bank : training runs with their stated states of charge
    soc_std : how far off those may be, at most a point or two, over which curves are straight

    Returns
    -------
    shift, std : (R,)
    """
    fifths = fold_of(bank)
    placed = _roughly_placed(bank, _held(bank, Variant(), fifths), soc_std)
    held, logs = _chosen(placed, None, fifths)
    return training_starts(_fitted(bank, placed, held, logs), bank.runs, bank.initial_soc, soc_std).soc_shifts


def _roughly_placed(bank: SignalBank, rough: HeldOut, soc_std: float) -> SignalBank:
    """Runs as if each had begun where a plain cell says."""
    return _placed(bank, training_starts(_fitted(bank, bank, rough, START), bank.runs, bank.initial_soc, soc_std))


def _worth(found: HeldOut, logs: tuple[float, ...], said: HeldOut, said_logs: tuple[float, ...], share: float) -> bool:
    """Whether runs with found starts leave no more than a share of the error on unseen samples."""
    return found.typical_V(logs) <= share * said.typical_V(said_logs)


def _chosen(bank: SignalBank, variant: Variant | None, fold: np.ndarray) -> tuple[HeldOut, tuple[float, ...]]:
    """Sums of a form, the best where none is given, and the strengths that serve it best."""
    trials = Trials(bank)
    variant = best_variant(trials) if variant is None else variant
    held = _held(bank, variant, fold)
    starts = [trials.known[variant][1]] if variant in trials.known else []
    return held, held.even(START, *starts)


def _placed(bank: SignalBank, starts: TrainingStarts) -> SignalBank:
    """Runs as if each had begun where it is said to."""
    runs = [replace(run, voltage_V=run.voltage_V - volts) for run, volts in zip(bank.runs, starts.volts, strict=True)]
    return replace(bank, runs=runs)


def _cell(bank: SignalBank, held: HeldOut, logs: tuple[float, ...]) -> KnownCell:
    degC = np.concatenate([run.temperature_degC for run in bank.runs])
    span = (25.0, 25.0) if np.isnan(degC).any() else (float(degC.min()), float(degC.max()))
    layout = held.sums.layout
    whole = curve_by_values(layout, rising(held, logs, span))
    covariance = covariance_of(held, logs, noise_of(held, logs), None)
    dt_s, usual = bank.runs[0].dt_s, _usual(bank, layout)
    # What it typically resists needs the cell to look at the runs.
    bare = KnownCell(
        layout, whole, covariance, bank.cell.capacity_Ah, dt_s, _domain(bank, layout.basis.axis), 0.0, usual
    )
    return replace(bare, typical_Ohm=_typical_Ohm(bare, bank.runs, bank.initial_soc))


def _fitted(bank: SignalBank, placed: SignalBank, held: HeldOut, logs: tuple[float, ...]) -> Fitted:
    """A cell with what its training runs say of their starts.

    Parameters
    ----------
    bank, placed : runs as measured, and less what was taken off them before
    held, logs : form and strengths, of the latter
    """
    count = float(held.sums.count.sum())
    information = held.sums.xx.sum(axis=0) / count + penalty(held.sums, logs)
    number, sample = run_index(bank), np.concatenate([np.arange(len(run)) for run in bank.runs])
    measured = np.concatenate([run.measured for run in bank.runs])
    chosen = np.flatnonzero(measured & (np.arange(len(measured)) % _keep_every(bank) == 0))
    kept = [sample[chosen[number[chosen] == r]] for r in range(len(bank.runs))]
    taken_V: list[FloatArray] = [was.voltage_V - now.voltage_V for was, now in zip(bank.runs, placed.runs, strict=True)]
    free = held.whole(logs).free
    return Fitted(_cell(placed, held, logs), free, information, kept, taken_V, noise_of(held, logs) / count)


def _held(bank: SignalBank, variant: Variant, fold: np.ndarray) -> HeldOut:
    soc = np.concatenate(soc_over(bank, variant.axis))
    low, high = min(float(soc.min()), _WHOLE_SOC[0]), max(float(soc.max()), _WHOLE_SOC[1])
    layout = make_layout(bank, Trials(bank).basis(variant), make_knots(low, high, CURVE, GAINS, SLOPES))
    return _summed(bank, layout, fold)


def _summed(bank: SignalBank, layout: Layout, fold: np.ndarray) -> HeldOut:
    return HeldOut(make_sums(bank, layout, _keep_every(bank), fold).by_increments())


def _keep_every(bank: SignalBank) -> int:
    return max(1, sum(len(run) for run in bank.runs) // _SAMPLES)


def _typical_Ohm(cell: KnownCell, runs: list[GridRun], soc: list[float]) -> float:
    over, current = 0.0, 0.0
    for run, start in zip(runs, soc, strict=True):
        index = np.arange(0, len(run), max(1, len(run) // 2000))
        view = View(cell, run, start, index)
        part = cell.through(view.inputs.signals, view.soc[index], cell.resistive)
        over += float(np.sum(part**2))
        current += float(np.sum(run.current_A[index] ** 2))
    return float(np.sqrt(over / max(current, 1e-12)))


def _usual(bank: SignalBank, layout: Layout) -> FloatArray:
    """(B,) root mean square of each term's signal over its largest value."""
    terms = zip(layout.basis.terms, layout.scale.tolist(), strict=True)
    squares = [np.mean(np.concatenate(bank.values(term.signal)) ** 2) / scale**2 for term, scale in terms]
    return np.sqrt(np.array(squares))


def _span(bank: SignalBank, signal: str) -> tuple[float, float]:
    values = np.concatenate(bank.values(signal))
    return float(values.min()), float(values.max())


def _domain(bank: SignalBank, axis: str) -> dict[str, tuple[float, float]]:
    current = np.concatenate([run.current_A for run in bank.runs])
    out = {
        "soc": _span(bank, "soc"),
        SURFACE: _span(bank, axis),
        "current_A": (float(current.min()), float(current.max())),
    }
    degC = np.concatenate([run.temperature_degC for run in bank.runs])
    if not np.isnan(degC).any():
        out["temperature_degC"] = (float(degC.min()), float(degC.max()))
    return out
