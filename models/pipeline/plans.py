"""What is fitted: a searched network or a bounded one, as choices that can be built again from other starts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from models.data.timeseries import FloatArray
from models.effects.bounded_parts import effects_of, parts_of, resolved_parts
from models.identification.bounded.fitted import BoundedFit, fit_variant, network_parts, theta_of
from models.identification.bounded.open_starts import with_open_starts
from models.identification.bounded.strengths import HeldOut
from models.identification.bounded.variants import Trials, Variant, mean_V, outer_held_out
from models.identification.output_error import normal_equations
from models.identification.progress import Progress, silent
from models.identification.refinement import Refined, refined_theta
from models.identification.search.candidate import Choice
from models.identification.search.fitted import Fitted, span_V
from models.identification.search.search import Search
from models.identification.stored_sums import StoredSums
from models.network.folds import N_FOLDS, WHOLE_RUNS, outer_folds
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Json, ModelRecord
from models.network.regression import VOLTAGE, SignalBank
from models.pipeline.training import Training
from models.uncertainty.bounded import bounded_uncertainty
from models.uncertainty.held_out import fit_uncertainty, held_out_error
from models.uncertainty.model_uncertainty import Uncertainty

# Parts that a fitted model's document names even where they say nothing.
_STATED = frozenset({"reservations", "thermal", "validation", "noise_floor_mV"})


# Samples in the sums of the outer folds.
_OUTER_SAMPLES = 60_000


@dataclass(frozen=True)
class HeldOutError:
    """What fits leave of runs that they did not see.

    Attributes
    ----------
    mse : (folds,) mean squared error in V^2; count : (folds,) samples
    """

    mse: FloatArray
    count: FloatArray

    @property
    def rmse_V(self) -> float:
        """Over all samples."""
        return float(np.sqrt(self.mse @ self.count / self.count.sum()))

    @property
    def mean_V(self) -> float:
        """Mean of the folds' RMS errors over all samples."""
        return mean_V(self.mse, self.count)


def expected_V(built: Built, held_out: HeldOutError, n_runs: int) -> float:
    """Error to be expected on runs like the trained ones.

    It is the mean of the folds' RMS errors: a fold that has a knee of the curve to itself says how far off a fit is
    that was never there, and the fit to all runs was. Where there are fewer runs than folds, the two ways to hold out
    bound it. A whole run of three or four is often the only charge or the only cold one: the fit to all of them is
    better. Blocks in time share state of charge, load and temperature with those beside them: a further run is worse.
    So it is their geometric mean.

    Parameters
    ----------
    built, held_out : a network with its error on outer folds
    n_runs : it was made from
    """
    if not WHOLE_RUNS <= n_runs < N_FOLDS:
        return held_out.mean_V
    return float(np.sqrt(held_out.mean_V * built.held_out_blocks().mean_V))


def error_of(error_V: FloatArray, fold: np.ndarray) -> HeldOutError:
    """Mean squares by fold; NaN does not count."""
    known = ~np.isnan(error_V)
    count = np.bincount(fold[known], minlength=int(fold.max()) + 1).astype(np.float64)
    squared = np.bincount(fold[known], error_V[known] ** 2, len(count))
    return HeldOutError(squared / np.maximum(count, 1.0), count)


class Built(Protocol):
    """A network of a plan, as yet without what it says of itself."""

    @property
    def network(self) -> LocalModelNetwork:
        """With a record of its data and choices."""
        ...

    def with_open_starts(self) -> LocalModelNetwork:
        """The network as the same runs have it whatever flowed before them, where its kind can tell."""
        ...

    def held_out(self) -> HeldOutError:
        """Errors on outer folds by fits that did not see them."""
        ...

    def held_out_blocks(self) -> HeldOutError:
        """Errors on the folds that choices are made on: blocks in time where there are fewer runs than folds."""
        ...

    def uncertainty(self) -> Uncertainty:
        """What it does not know."""
        ...

    def sums(self) -> StoredSums | None:
        """What the runs say of the parameters, for a later fit to new runs alone; None where that is not kept."""
        ...


class Plan(Protocol):
    """A set of choices."""

    @property
    def table(self) -> list[Json]:
        """Documents of what was tried, each with its held-out error."""
        ...

    def build(self, data: Training, report: Progress) -> Built:
        """Fit the choices to training data."""
        ...


@dataclass(frozen=True)
class SearchedPlan:
    """A choice that a search has made."""

    search: Search
    choice: Choice

    @property
    def table(self) -> list[Json]:
        """Documents of what was tried, each with its held-out error."""
        return self.search.table

    def build(self, data: Training, report: Progress) -> Built:
        """Fit the choice to training data."""
        own = self.search.runs is data.fit_grid
        search = self.search if own else Search(data.fit_grid, data.fit_soc, data.cell, silent)
        report(0.0, f"building {self.choice.n_models} local models")
        fitted = search.fitted(self.choice)
        refined = refined_theta(fitted, report)
        choices = self.choice.to_json() | {"log_strengths": list(fitted.fit.log_strengths)}
        record = _record(data, choices, self.table, dict(refined.record))
        network = LocalModelNetwork(
            fitted.structure, fitted.partition, refined.theta, fitted.scaling, data.cell, record
        )
        return SearchedNetwork(network, fitted, refined)


@dataclass(frozen=True)
class SearchedNetwork:
    """A network of a search."""

    network: LocalModelNetwork
    fitted: Fitted
    refined: Refined

    def with_open_starts(self) -> LocalModelNetwork:
        """The network itself: its search takes each run from where it is said to begin."""
        return self.network

    def held_out(self) -> HeldOutError:
        """Errors on outer folds by shared-pole fits that did not see them."""
        data = self.fitted.data
        return self._held_out(outer_folds(data.run_index, data.groups()))

    def held_out_blocks(self) -> HeldOutError:
        """The same of the folds that choices are made on."""
        return self._held_out(self.fitted.data.groups() % N_FOLDS)

    def _held_out(self, fold: np.ndarray) -> HeldOutError:
        error = held_out_error(self.fitted, self.fitted.partition.validity(self.fitted.data.z), fold)
        return error_of(span_V(self.fitted.scaling) * error, fold)

    def uncertainty(self) -> Uncertainty:
        """What it does not know."""
        return fit_uncertainty(self.fitted, self.refined.theta, self.refined.penalties, self.refined.held_out)

    def sums(self) -> StoredSums:
        """What the training runs say of the parameters, for a later fit to new runs alone."""
        fitted, theta = self.fitted, self.network.theta
        if fitted.structure.output_order == 0:
            xx, xy, yy = fitted.sums.xx.sum(axis=0), fitted.sums.xy.sum(axis=0), float(fitted.sums.yy.sum())
            b = theta.ravel()
            return StoredSums(xx, float(fitted.sums.count.sum()), max(float(yy - 2.0 * b @ xy + b @ xx @ b), 0.0))
        equations = normal_equations(theta, fitted.structure.output_order, fitted.partition, fitted.data)
        return StoredSums(equations.information, equations.weight, equations.squared_error)


@dataclass(frozen=True)
class BoundedPlan:
    """A form of the bounded network.

    Attributes
    ----------
    variant : form
    without : effects that are left out
    table : documents of what was tried
    trials : forms that were tried on the data that it was chosen from; None: nothing is kept
    finer : effects with more resolution than usual
    """

    variant: Variant
    without: tuple[str, ...] = ()
    table: list[Json] = field(default_factory=list)
    trials: Trials | None = None
    name: str = "bounded"
    finer: tuple[str, ...] = ()

    def build(self, data: Training, report: Progress) -> Built:
        """Fit the form to training data."""
        report(0.0, "solving for the bounded network")
        trials, bank = self.trials, SignalBank(data.fit_grid, data.fit_soc, data.cell)
        if trials is None:
            trials = Trials(bank, parts_of(self.without), finer=resolved_parts(self.finer))
        elif trials.bank.runs is not data.fit_grid:
            trials = trials.elsewhere(bank, self.variant)
        fit = fit_variant(trials, self.variant)
        structure, partition, theta, scaling = network_parts(fit, self.name)
        record = _record(data, self._choices(fit), self.table, None)
        return BoundedNetwork(LocalModelNetwork(structure, partition, theta, scaling, data.cell, record), fit)

    def _choices(self, fit: BoundedFit) -> Json:
        """What was chosen, with each term and the effects that it stands for."""
        layout = fit.layout
        terms = [
            {"signal": term.signal, "effects": list(effects_of(term.parts)), "largest_V": float(np.abs(part).max())}
            for term, part in zip(
                layout.basis.terms, np.split(fit.coefficients, layout.first.tolist())[1:-1], strict=True
            )
        ]
        return {
            "family": "bounded",
            **fit.variant.to_json(),
            "without": list(self.without),
            "finer": list(self.finer),
            "log_strengths": list(fit.log_strengths),
            "held_out_rmse_mV": 1e3 * fit.held_out_rmse_V,
            "terms": terms,
        }


@dataclass(frozen=True)
class BoundedNetwork:
    """A bounded network."""

    network: LocalModelNetwork
    fit: BoundedFit

    def with_open_starts(self) -> LocalModelNetwork:
        """The network as the same runs have it whatever flowed before them."""
        fit = with_open_starts(self.fit)
        theta = theta_of(fit.layout, fit.coefficients, fit.bank.bounds(VOLTAGE))
        return replace(self.network, theta=theta)

    def held_out(self) -> HeldOutError:
        """Errors on outer folds by fits that did not see them."""
        bank = self.fit.bank
        held = outer_held_out(bank, self.fit.layout, max(1, sum(map(len, bank.runs)) // _OUTER_SAMPLES))
        return self._error(held or self.fit.held)

    def held_out_blocks(self) -> HeldOutError:
        """The same of the folds that choices are made on."""
        return self._error(self.fit.held)

    def _error(self, held: HeldOut) -> HeldOutError:
        return HeldOutError(held.mse(self.fit.log_strengths), held.count)

    def uncertainty(self) -> Uncertainty:
        """What it does not know."""
        return bounded_uncertainty(self.fit)

    def sums(self) -> None:
        """Nothing is kept: bounds need the runs themselves."""
        return


def _record(data: Training, choices: Json, table: list[Json], refinement: Json | None) -> ModelRecord:
    return ModelRecord(
        domain=data.domain,
        train_runs=tuple(run.name for run in data.runs),
        choices=choices,
        candidates=tuple(table),
        reservations=tuple(data.reservations),
        refinement=refinement,
        noise_floor_mV=data.noise_floor_mV,
        stated=_STATED,
    )
