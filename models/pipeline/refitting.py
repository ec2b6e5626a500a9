"""A model's parameters from new runs, with what is known from old ones as stored sums of products.

The structure, the partition and the scaling stay. What the old runs said is kept as the information matrix of the free
run at the old parameters: near them, the old runs' squared error is a quadratic form in the change of the parameters,
so the runs themselves need not be there any more. For a network without past outputs that is exact.

A cell ages: how much the old runs still count, and how much alike the change of neighbouring local models is, are
chosen on held-out blocks of the new runs. What ages a cell at one state of charge usually does so at the next.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from models.comparison.placed_runs import free_run_metrics
from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.input_correction import as_read
from models.identification.excitation import check_series
from models.identification.output_error import normal_equations
from models.identification.stored_sums import StoredSums
from models.network.lineage import document_sha256, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import Domain, Json, ModelRecord
from models.network.regression import Dataset
from models.network.signals import soc_by_counting
from models.network.signals.filters import slow_current_A
from models.pipeline.bounded_refit import remembers, solved_bounded
from models.pipeline.refit_problem import Solution, solved

# Parts of the record that speak of other parameters than the new ones.
_STALE = ("uncertainty", "tables", "residuals", "refinement", "candidates", "validation", "update")
# Parts that a refitted model's document names even where they say nothing.
_STATED = frozenset({"domain", "reservations"})


@dataclass(frozen=True)
class Refit:
    """A network with new parameters, and the sums to store with it; a bounded one has a covariance in their place."""

    network: LocalModelNetwork
    sums: StoredSums | None


def stored_sums(
    network: LocalModelNetwork, runs: list[TimeSeries], initial_soc: list[float] | None = None
) -> StoredSums:
    """Sums of products of a network over the runs that it was fitted to."""
    data, _ = _data(network, runs, initial_soc)
    theta, order = network.theta, network.structure.output_order
    equations = normal_equations(theta, order, network.partition, data)
    return StoredSums(equations.information, equations.weight, equations.squared_error)


def refit(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    *,
    initial_soc: list[float] | None = None,
    old: StoredSums | None = None,
    old_weight: float | None = None,
    code_version: str = "unknown",
) -> Refit:
    """Fit a network's parameters again with new runs; its structure, partition and scaling stay.

    Parameters
    ----------
    network : the model so far
    runs : new runs
    initial_soc : fraction at the start of each; by default its first `soc_ref`
    old : what the model's earlier runs said; None: only that the parameters were what they are
    old_weight : how much an old sample counts beside a new one; chosen on held-out blocks of the new runs by default
    code_version : for the record

    Returns
    -------
    Refit
        The record's "version" names the parent. Tables, covariance and figures of the old parameters are left out; the
        sums are those of all runs so far.

    Raises
    ------
    ModelError
        No run, a weight out of range, or sums of another network.
    """
    _check(network, runs, old, old_weight)
    reservations = check_series(runs, network.dt_s, network.cell.capacity_Ah)
    soc = initial_soc or [start_soc(run) for run in runs]
    found, new, sums = (_with_bounds if remembers(network) else _by_sums)(network, runs, soc, old, old_weight)
    errors = {"train": free_run_metrics(new, runs, soc), "parent": free_run_metrics(network, runs, soc)}
    stored = None if sums is None else sums.to_json()
    record = replace(new.record, train=errors["train"], reservations=tuple(reservations), sums=stored)
    new = with_version(
        replace(new, record=record),
        "refit",
        runs,
        parent=network,
        settings=_settings(found, old, 1e3 * network.voltage_span_V),
        errors=errors,
        code_version=code_version,
        sums_sha256=None if stored is None else document_sha256(stored),
    )
    return Refit(new, sums)


def _by_sums(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    soc: list[float],
    old: StoredSums | None,
    old_weight: float | None,
) -> tuple[Solution, LocalModelNetwork, StoredSums | None]:
    """Held to what sums of the old runs say; with the sums of all runs."""
    data, _ = _data(network, runs, soc)
    found = solved(network, data, old, old_weight)
    new = replace(network, theta=found.theta, record=kept_record(network, runs, soc))
    return found, new, _with_old(stored_sums(new, runs, soc), old, found.old_weight)


def _with_bounds(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    soc: list[float],
    _old: StoredSums | None,
    old_weight: float | None,
    freed: Collection[str] = (),
) -> tuple[Solution, LocalModelNetwork, StoredSums | None]:
    """A bounded network, held to its old coefficients by their covariance; it stays one over its own knots."""
    grid = [to_grid(as_read(network.record, run), network.dt_s) for run in runs]
    bounded = solved_bounded(network, grid, soc, old_weight, freed)
    record = kept_record(network, runs, soc)
    domain = {**record.domain, "soc": network.record.domain["soc"]}
    record = replace(record, domain=domain, uncertainty=bounded.uncertainty.to_json())
    return bounded.solution, replace(network, theta=bounded.solution.theta, record=record), None


def refit_part(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    initial_soc: list[float],
    freed: Collection[str],
    old_weight: float | None = 1.0,
) -> LocalModelNetwork:
    """Estimate a part of a bounded network again; the rest is held to what is known of it.

    Parameters
    ----------
    network : of which `bounded_refit.remembers` holds
    runs, initial_soc : new runs and where they start
    freed : signals of which the old runs are to say nothing; with `CURVE` also not of the curve
    old_weight : how much what is known of the rest counts; None: chosen on held-out parts of the new runs

    Raises
    ------
    ModelError
        No sample of the new runs lies between the network's knots.
    """
    solution, made, _ = _with_bounds(network, runs, initial_soc, None, old_weight, freed)
    held_out_mV = 1e3 * network.voltage_span_V * min(solution.alikes.values())
    choices = {**(network.record.choices or {}), "held_out_rmse_mV": held_out_mV}
    record = replace(made.record, choices=choices, train=free_run_metrics(made, runs, initial_soc))
    return replace(made, record=record)


def _check(
    network: LocalModelNetwork, runs: list[TimeSeries], old: StoredSums | None, old_weight: float | None
) -> None:
    if network.structure.kernel == "hat" and not remembers(network):
        raise ModelError(
            f"refit: {network.name} has hats, whose gains keep their bounds only in a fit of their own: fit the "
            "structure anew to old and new runs together, or follow the cell with a recursive update"
        )
    if not runs:
        raise ModelError("refit: no new run was given")
    if old_weight is not None and not 0.0 <= old_weight <= 1.0:
        raise ModelError(f"refit: old_weight is {old_weight:g}; it must lie in 0..1")
    if old is not None and old.information.shape != (network.theta.size,) * 2:
        raise ModelError(
            f"refit: the stored sums are of {len(old.information)} parameters; the network has {network.theta.size}"
        )


def kept_record(
    network: LocalModelNetwork, runs: list[TimeSeries], soc: list[float], stale: Collection[str] = _STALE
) -> ModelRecord:
    """What of a record still holds with other parameters, over the wider domain of further runs."""
    kept = network.record.without(*stale)
    return replace(kept, domain=_wider_domain(network, runs, soc), stated=kept.stated | _STATED)


def _with_old(new: StoredSums, old: StoredSums | None, weight: float) -> StoredSums:
    if old is None:
        return new
    return StoredSums(
        weight * old.information + new.information,
        weight * old.n_samples + new.n_samples,
        weight * old.squared_error + new.squared_error,
    )


def _settings(found: Solution, old: StoredSums | None, span_mV: float) -> Json:
    """What was asked for and chosen, as the version keeps it."""
    return {
        "old_weight": found.old_weight,
        "old_samples": 0.0 if old is None else old.n_samples,
        "alike": found.alike,
        "held_out_rmse_mV": {
            "old_weight": {f"{key:g}": span_mV * value for key, value in found.old_weights.items()},
            "alike": {f"{key:g}": span_mV * value for key, value in found.alikes.items()},
        },
    }


def _data(
    network: LocalModelNetwork, runs: list[TimeSeries], initial_soc: list[float] | None
) -> tuple[Dataset, list[float]]:
    soc = initial_soc or [start_soc(run) for run in runs]
    return network.dataset([to_grid(as_read(network.record, run), network.dt_s) for run in runs], soc), soc


def _wider_domain(network: LocalModelNetwork, runs: list[TimeSeries], soc: list[float]) -> Domain:
    """Trained ranges with those of the new runs."""
    domain = dict(network.record.domain)
    for run, start in zip(runs, soc, strict=True):
        for name, values in _ranged(network, to_grid(as_read(network.record, run), network.dt_s), start).items():
            if name in domain and not np.isnan(values).any():
                low, high = domain[name]
                domain[name] = (min(low, float(values.min())), max(high, float(values.max())))
    return domain


def _ranged(network: LocalModelNetwork, run: GridRun, start_soc: float) -> dict[str, FloatArray]:
    counted = soc_by_counting(run.charge_Ah, start_soc, network.cell.capacity_Ah, network.cell.efficiency)
    slow_A = slow_current_A(run.current_A, run.dt_s)
    return {
        "soc": counted,
        "current_A": run.current_A,
        "slow_current_A": slow_A,
        "temperature_degC": run.temperature_degC,
    }
