"""A model's parameters from new runs, with what is known from old ones as stored sums of products.

The structure, the partition and the scaling stay. What the old runs said is kept as the information matrix of the free
run at the old parameters: near them, the old runs' squared error is a quadratic form in the change of the parameters,
so the runs themselves need not be there any more. For a network without past outputs that is exact.

A cell ages: how much the old runs still count, and how much alike the change of neighbouring local models is, are
chosen on held-out blocks of the new runs. What ages a cell at one state of charge usually does so at the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from models.comparison.simulated_runs import free_run_metrics
from models.data.errors import ModelError
from models.data.resampling import GridRun, to_grid
from models.data.start_soc import start_soc
from models.data.timeseries import FloatArray, TimeSeries
from models.effects.input_correction import as_read
from models.identification.excitation import check_series
from models.identification.output_error import normal_equations, on_inputs, stabilised
from models.identification.shared_poles import penalties
from models.identification.stored_sums import StoredSums
from models.network.lineage import document_sha256, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import free_run, initial_samples
from models.network.regression import Dataset
from models.network.signals import soc_by_counting

# How much a sample of an old run counts beside one of a new one; tried from full trust to nearly none.
_OLD_WEIGHTS = (1.0, 0.3, 0.1, 0.03, 0.01, 0.001)
# Pull of neighbouring local models' changes towards each other, over the number of new samples; the first is used while
# the weight of the old runs is chosen.
_ALIKE = (1e-2, 1e-4, 1e-3, 1e-1, 1.0)
_ITERATIONS = 12
_TRIALS = 10
# Parts of the record that speak of other parameters than the new ones.
_STALE = ("uncertainty", "tables", "residuals", "refinement", "candidates", "validation", "update")


@dataclass(frozen=True)
class Refit:
    """A network with new parameters, and the sums to store with it."""

    network: LocalModelNetwork
    sums: StoredSums


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
    if not runs:
        raise ModelError("refit: no new run was given")
    if old_weight is not None and not 0.0 <= old_weight <= 1.0:
        raise ModelError(f"refit: old_weight is {old_weight:g}; it must lie in 0..1")
    if old is not None and old.information.shape != (network.theta.size,) * 2:
        raise ModelError(
            f"refit: the stored sums are of {len(old.information)} parameters; the network has {network.theta.size}"
        )
    reservations = check_series(runs, network.dt_s, network.cell.capacity_Ah)
    data, soc = _data(network, runs, initial_soc)
    with threadpool_limits(1, user_api="blas"):
        problem = _Problem(network, data, old)
        tried = {w: problem.held_out(w, _ALIKE[0]) for w in (_OLD_WEIGHTS if old_weight is None else (old_weight,))}
        weight = min(tried, key=tried.__getitem__)
        tried_alike = {_ALIKE[0]: tried[weight]} | {a: problem.held_out(weight, a) for a in _ALIKE[1:]}
        alike = min(tried_alike, key=tried_alike.__getitem__)
        theta = problem.solve(weight, alike, np.ones(len(data)))
    kept = {key: value for key, value in network.record.items() if key not in _STALE}
    new = replace(network, theta=theta, record=kept | {"domain": _wider_domain(network, runs, soc)})
    errors = {"train": free_run_metrics(new, runs, soc), "parent": free_run_metrics(network, runs, soc)}
    sums = stored_sums(new, runs, soc)
    if old is not None:
        sums = StoredSums(
            weight * old.information + sums.information,
            weight * old.n_samples + sums.n_samples,
            weight * old.squared_error + sums.squared_error,
        )
    span_mV = 1e3 * network.voltage_span_V
    settings = {
        "old_weight": weight,
        "old_samples": 0.0 if old is None else old.n_samples,
        "alike": alike,
        "held_out_rmse_mV": {
            "old_weight": {f"{key:g}": span_mV * value for key, value in tried.items()},
            "alike": {f"{key:g}": span_mV * value for key, value in tried_alike.items()},
        },
    }
    stored = sums.to_json()
    record = {"train": errors["train"], "reservations": reservations, "sums": stored}
    new = replace(new, record=new.record | record)
    new = with_version(
        new,
        "refit",
        runs,
        parent=network,
        settings=settings,
        errors=errors,
        code_version=code_version,
        sums_sha256=document_sha256(stored),
    )
    return Refit(new, sums)


class _Problem:
    """Squared error of the new runs, and the quadratic forms that hold the parameters near the old ones."""

    def __init__(self, network: LocalModelNetwork, data: Dataset, old: StoredSums | None) -> None:
        self._network, self._data = network, data
        self._order = network.structure.output_order
        self._validity = network.partition.validity(data.z)
        self._is_start = initial_samples(len(data), data.starts, self._order) > 0
        self._centre = stabilised(network.theta, self._order)
        size = network.theta.size
        self._old = np.zeros((size, size)) if old is None else old.information
        forms = penalties(network.structure, network.partition, data, network.theta[:, : self._order].mean(axis=0))
        self._alike = on_inputs(np.sum(forms, axis=0), network.theta.shape, self._order) * len(data)

    def held_out(self, weight: float, alike: float) -> float:
        """RMSE in normalised units on blocks of the new runs that the trial did not see."""
        group = self._data.groups()
        total, count = 0.0, 0
        for parity in (0, 1):
            held = group % 2 == parity
            theta = self.solve(weight, alike, (~held).astype(np.float64))
            error = (free_run(theta, self._order, self._validity, self._data) - self._data.y)[held]
            known = error[~np.isnan(error)]
            total += float(known @ known)
            count += len(known)
        return float(np.sqrt(total / max(count, 1)))

    def solve(self, weight: float, alike: float, weights: FloatArray) -> FloatArray:
        """Gauss-Newton with damping from the old parameters; (M, p)."""
        shape, centre = self._centre.shape, self._centre.ravel()
        share = float(weights.mean())
        network, order = self._network, self._order
        first = normal_equations(centre.reshape(shape), order, network.partition, self._data, weights)
        # Directions that neither new nor old runs excite stay where they are.
        floor = 1e-6 * np.trace(first.information) / len(centre) * np.eye(len(centre))
        hold = weight * self._old + alike * share * self._alike + floor

        def cost(x: FloatArray) -> float:
            away = x - centre
            return self._squared_error(x.reshape(shape), weights) + float(away @ hold @ away)

        x, value, damping = centre, cost(centre), 1e-6
        for _ in range(_ITERATIONS):
            equations = normal_equations(x.reshape(shape), order, network.partition, self._data, weights)
            hessian = equations.information + hold
            gradient = equations.gradient - hold @ (x - centre)
            for _ in range(_TRIALS):
                step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian)), gradient)
                trial = stabilised((x + step).reshape(shape), self._order).ravel()
                trial_value = cost(trial)
                if np.isfinite(trial_value) and trial_value < value:
                    break
                damping = max(10.0 * damping, 1e-6)
            else:
                break
            small = value - trial_value < 1e-5 * value
            x, value, damping = trial, trial_value, 0.1 * damping
            if small:
                break
        return x.reshape(shape)

    def _squared_error(self, theta: FloatArray, weights: FloatArray) -> float:
        error = self._data.y - free_run(theta, self._order, self._validity, self._data)
        return float(weights @ np.where(np.isnan(error) | self._is_start, 0.0, error) ** 2)


def _data(
    network: LocalModelNetwork, runs: list[TimeSeries], initial_soc: list[float] | None
) -> tuple[Dataset, list[float]]:
    soc = initial_soc or [start_soc(run) for run in runs]
    return network.dataset([to_grid(as_read(network.record, run), network.dt_s) for run in runs], soc), soc


def _wider_domain(network: LocalModelNetwork, runs: list[TimeSeries], soc: list[float]) -> dict[str, list[float]]:
    """Trained ranges with those of the new runs."""
    domain = {name: list(bounds) for name, bounds in network.record.get("domain", {}).items()}
    for run, start in zip(runs, soc, strict=True):
        for name, values in _ranged(network, to_grid(as_read(network.record, run), network.dt_s), start).items():
            if name in domain and not np.isnan(values).any():
                low, high = domain[name]
                domain[name] = [min(low, float(values.min())), max(high, float(values.max()))]
    return domain


def _ranged(network: LocalModelNetwork, run: GridRun, start_soc: float) -> dict[str, FloatArray]:
    counted = soc_by_counting(run.charge_Ah, start_soc, network.cell.capacity_Ah, network.cell.efficiency)
    return {"soc": counted, "current_A": run.current_A, "temperature_degC": run.temperature_degC}
