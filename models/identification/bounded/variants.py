"""Forms that a bounded network may have, and the error of each on held-out folds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.identification.bounded.knots import make_knots
from models.identification.bounded.layout import Layout, make_layout, soc_over
from models.identification.bounded.problem import groups_of, make_sums, rest_weights, run_index
from models.identification.bounded.strengths import START, HeldOut
from models.identification.bounded.terms import GAINS_OVER_SOC, SLOPE, Basis, make_basis
from models.network.folds import N_FOLDS, WHOLE_RUNS, outer_folds
from models.network.regression import SignalBank
from models.network.signals.temperature_scale import MOVING_K

# Knots of the curve, of gains and of the slope with temperature, over SoC 0..1.
CURVE, GAINS, FINE_GAINS, SLOPES, FINE_SLOPES = 48, 9, 17, 6, 24
# Samples in the sums while forms are compared.
_SEARCH_SAMPLES = 45_000
# Passes over the strengths of a form that begins with those of one like it.
_NEAR_PASSES = 2


@dataclass(frozen=True)
class Variant:
    """One form.

    Attributes
    ----------
    surface : depth in h, time constant in s, activation in K, and by how much slower it diffuses at empty, where it
        does; None: the mean state of charge
    squared : whether overvoltages that grow faster than the current are offered
    fine_slope : whether the curve's slope with temperature has knots as dense as a moved curve asks for
    fine_gains : whether gains have twice as many knots
    behind : whether a part of the curve may stand at the mean state of charge beside a surface
    """

    surface: tuple[float, ...] | None = None
    squared: bool = False
    fine_slope: bool = False
    fine_gains: bool = False
    behind: bool = False

    @property
    def axis(self) -> str:
        """State of charge that curve and gains stand over."""
        return "soc" if self.surface is None else "surface_soc:" + "/".join(f"{value:.4g}" for value in self.surface)

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types."""
        return {
            "axis": self.axis,
            "squared": self.squared,
            "fine_slope": self.fine_slope,
            "fine_gains": self.fine_gains,
            "behind": self.behind,
        }


def variant_of(document: dict[str, Any]) -> Variant:
    """Read what `Variant.to_json` wrote, as a network's choices have it."""
    _, _, depth = str(document["axis"]).partition(":")
    surface = tuple(float(value) for value in depth.split("/")) if depth else None
    if surface is not None and len(surface) not in (3, 4):
        raise ModelError(
            f"axis {document['axis']!r} of a bounded network is neither soc nor surface_soc:a/b/c or a/b/c/d"
        )
    later = {name: bool(document.get(name, False)) for name in ("fine_gains", "behind")}  # not in former documents
    return Variant(surface, bool(document["squared"]), bool(document["fine_slope"]), **later)


@dataclass
class Trials:
    """Forms that were tried on the runs of a bank.

    Attributes
    ----------
    bank : signals of the runs
    without : parts that are left out
    progress : called with each form's document
    finer : parts with more resolution than usual
    """

    bank: SignalBank
    without: tuple[str, ...] = ()
    progress: Callable[[Variant], None] = lambda _variant: None
    finer: tuple[str, ...] = ()
    known: dict[Variant, tuple[HeldOut, tuple[float, ...]]] = field(default_factory=dict)

    def error(self, variant: Variant, start: tuple[float, ...] | None = None) -> FloatArray:
        """(folds,) mean squared error of a form on each held-out fold, with the strengths that serve it best.

        Where strengths are given to begin with, which served a form like it, fewer passes have to do.
        """
        if variant not in self.known:
            self.progress(variant)
            held = self.held_out(variant, self.keep_every)
            self.known[variant] = held, held.best() if start is None else held.best(start, _NEAR_PASSES)
        held, logs = self.known[variant]
        return held.mse(logs)

    def elsewhere(self, bank: SignalBank, variant: Variant) -> Trials:
        """Trials on another bank that take a form as tried: with the strengths that serve it best here."""
        other = Trials(bank, self.without, finer=self.finer)
        other.known[variant] = other.held_out(variant, other.keep_every), self.known[variant][1]
        return other

    def typical_V(self, variant: Variant) -> float:
        """Error on a typical fold of a form that was tried, with the strengths that serve that best."""
        held, logs = self.known[variant]
        return held.typical_V(held.even(logs, START))

    def outer_error(self, variant: Variant) -> tuple[FloatArray, FloatArray]:
        """(folds,) mean squared error of a form on the folds that kinds of models are compared on, and their samples.

        Strengths are those that serve it best on the folds of `error`.
        """
        self.error(variant)
        held, logs = self.known[variant]
        outer = outer_held_out(self.bank, held.sums.layout, self.keep_every) or held
        return outer.mse(logs), outer.count

    def held_out(self, variant: Variant, keep_every: int, weight: FloatArray | None = None) -> HeldOut:
        """Sums of a form on every n-th sample, all alike or by what they weigh."""
        soc = np.concatenate(soc_over(self.bank, variant.axis))
        gains = FINE_GAINS if variant.fine_gains or GAINS_OVER_SOC in self.finer else GAINS
        slopes = FINE_SLOPES if variant.fine_slope or SLOPE in self.finer else SLOPES
        knots = make_knots(float(soc.min()), float(soc.max()), CURVE, gains, slopes)
        layout = make_layout(self.bank, self.basis(variant), knots)
        return HeldOut(make_sums(self.bank, layout, keep_every, weight=weight).by_increments())

    def basis(self, variant: Variant) -> Basis:
        """Terms of a form."""
        run, cell = self.bank.runs[0], self.bank.cell
        made = make_basis(
            run.dt_s,
            cell.capacity_Ah,
            temperature_in(self.bank),
            axis=variant.axis,
            squared=variant.squared,
            behind=variant.behind,
            range_degC=self.bank.range_degC,
            finer=self.finer,
        )
        return made.without(self.without) if self.without else made

    @property
    def keep_every(self) -> int:
        """Every n-th sample is counted while forms are compared."""
        return max(1, round(sum(len(run) for run in self.bank.runs) / _SEARCH_SAMPLES))

    @property
    def counts(self) -> FloatArray:
        """(folds,) samples of each fold."""
        held, _ = next(iter(self.known.values()))
        return held.count

    def mean(self, errors: FloatArray) -> float:
        """Root mean squared errors of the folds, their mean over all samples."""
        return mean_V(errors, self.counts)


def outer_held_out(bank: SignalBank, layout: Layout, keep_every: int) -> HeldOut | None:
    """Sums on every n-th sample by whole runs, on which kinds of models are compared; None: blocks serve for that, too.

    Parameters
    ----------
    bank : signals of the runs
    layout : of the coefficients
    keep_every : every n-th sample is counted
    """
    if not WHOLE_RUNS <= len(bank.runs) < N_FOLDS:
        return None
    fold = outer_folds(run_index(bank), groups_of(bank))
    alike, weighed = (make_sums(bank, layout, keep_every, fold, weight) for weight in (None, rest_weights(bank)))
    return HeldOut(weighed.by_increments(), alike.by_increments())


def mean_V(errors: FloatArray, counts: FloatArray) -> float:
    """Mean of the folds' root mean squared errors in V over all samples."""
    return float(np.sqrt(errors) @ counts / counts.sum())


def clearly_better(trial: FloatArray, present: FloatArray, counts: FloatArray, errors: float = 1.0) -> bool:
    """Whether an error is lower by more than so many standard errors of its difference over the folds.

    Breiman et al., "Classification and Regression Trees", 1984, ch. 3.4.3, for the rule.
    """
    share = counts / counts.sum()
    used = share > 0.0
    difference = (np.sqrt(present) - np.sqrt(trial))[used]
    mean = float(share[used] @ difference)
    if used.sum() < 2:
        return mean > 0.0
    spread = float(np.sqrt(share[used] @ (difference - mean) ** 2 / (used.sum() - 1)))
    return mean > errors * spread


def temperature_in(bank: SignalBank) -> str:
    """What the runs say of the temperature, as `make_basis` asks for it."""
    if any(np.isnan(run.temperature_degC).any() for run in bank.runs):
        return "missing"
    return "moves" if bank.span_K >= MOVING_K else "one"
