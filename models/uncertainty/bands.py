"""95 % bands of the free run: parameter covariance, held-out error near each local model, distance from the data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.recursion import blend, free_run, initial_samples, run_recursion, sensitivity_block
from models.network.regression import Dataset
from models.network.signals import soc_by_counting
from models.network.signals.filters import slow_current_A
from models.uncertainty.covariance import ParameterCovariance
from models.uncertainty.model_uncertainty import Uncertainty
from models.uncertainty.spread import LocalFactor, blended_variance

# Beyond the trained range the residual level grows by itself for each tenth of the range: nothing was seen there.
_DOUBLING_SHARE = 0.1
# A range of temperature counts as this at the least. That of runs at one temperature is zero, and any other temperature
# would be infinitely many of it away; bands of runs that warm by a few kelvin would grow faster than errors do.
_LEAST_RANGE_K = 20.0
# Nobody knows how the open-circuit curve goes on: its slope there may be off by this share of the trained mean one.
_SLOPE_SHARE = 0.15
NORMAL_95 = 1.959963984540054
_BLOCK = 4096


@dataclass(frozen=True)
class PredictionBand:
    """A free run with what it may be wrong by.

    Attributes
    ----------
    voltage_V : (n,) free run
    parameter_std_V : (n,) from the covariance of the parameters alone
    std_V : (n,) of a measured voltage about the free run; 95 % of them are to lie within 1.96 of it
    usual_V : (n,) error to be expected: by the parameters and the held-out error near the place, without what widens
        a band so that it holds
    """

    voltage_V: FloatArray
    parameter_std_V: FloatArray
    std_V: FloatArray
    usual_V: FloatArray

    @property
    def lower_V(self) -> FloatArray:
        """(n,) lower end of the 95 % band."""
        return self.voltage_V - NORMAL_95 * self.std_V

    @property
    def upper_V(self) -> FloatArray:
        """(n,) upper end of the 95 % band."""
        return self.voltage_V + NORMAL_95 * self.std_V

    def coverage_95(self, measured_V: FloatArray) -> float:
        """Share of the measured voltages that lie within the 95 % band; NaN where none was measured."""
        known = ~np.isnan(measured_V)
        inside = (measured_V >= self.lower_V) & (measured_V <= self.upper_V)
        return float(inside[known].mean()) if known.any() else float("nan")


def prediction_band(
    network: LocalModelNetwork,
    run: GridRun,
    initial_soc: float,
    uncertainty: Uncertainty,
    local: LocalFactor | None = None,
) -> PredictionBand:
    """Simulate a run with its 95 % band.

    Parameters
    ----------
    network : the model
    run : on a grid of the network's sampling time
    initial_soc : fraction 0..1
    uncertainty : of this network, see `uncertainty_of`
    local : factor of its parameters' covariance, for many calls

    Notes
    -----
    The variance is that of the parameters, by the free run's sensitivities, plus that of the held-out error near each
    local model. Outside the trained ranges the latter grows with the distance: structure, too, is unknown there.
    """
    data = network.dataset([run], [initial_soc])
    order, span = network.structure.output_order, network.voltage_span_V
    validity = network.partition.validity(data.z)
    simulated = network.to_volts(free_run(network.theta, order, validity, data))
    variance = span**2 * parameter_variance(uncertainty.parameters, network.theta, order, validity, data, local)
    soc = soc_by_counting(run.charge_Ah, initial_soc, network.cell.capacity_Ah, network.cell.efficiency)
    beyond = _distances(network, run, soc)
    farthest = np.max([np.zeros(len(run)), *beyond.values()], axis=0)
    near2 = validity @ uncertainty.level_V**2
    level2 = near2 * (1.0 + farthest / _DOUBLING_SHARE) ** 2
    level2 = level2 + (_SLOPE_SHARE * span * beyond.get("soc", np.zeros(len(run)))) ** 2
    std_V = uncertainty.band_factor * np.sqrt(variance + level2)
    return PredictionBand(simulated, np.sqrt(variance), std_V, np.sqrt(variance + near2))


def _distances(network: LocalModelNetwork, run: GridRun, soc: FloatArray) -> dict[str, FloatArray]:
    """(n,) distance from the trained domain in units of its range, for each dimension."""
    values = {
        "soc": soc,
        "current_A": run.current_A,
        "slow_current_A": slow_current_A(run.current_A, run.dt_s),
        "temperature_degC": run.temperature_degC,
    }
    beyond = {}
    for name, (low, high) in network.record.domain.items():
        away = np.nan_to_num(np.maximum(low - values[name], values[name] - high))
        least = _LEAST_RANGE_K if name == "temperature_degC" else 1e-9
        beyond[name] = np.maximum(away, 0.0) / max(high - low, least)
    return beyond


def parameter_variance(
    parameters: ParameterCovariance,
    theta: FloatArray,
    order: int,
    validity: FloatArray,
    data: Dataset,
    local: LocalFactor | None = None,
) -> FloatArray:
    """(N,) variance of the free run by the parameters' covariance, normalised units; in blocks."""
    if order == 0:
        return blended_variance(local or LocalFactor(parameters.theta_factor), validity, data.u)
    factor, out = parameters.theta_factor, np.empty(len(data))
    with threadpool_limits(1, user_api="blas"):
        for part, rows in sensitivities(theta, order, validity, data):
            out[part] = np.sum((rows @ factor) ** 2, axis=1)
    return out


def sensitivities(
    theta: FloatArray, order: int, validity: FloatArray, data: Dataset
) -> Iterator[tuple[slice, FloatArray]]:
    """Sensitivities of the free run to all parameters, block by block; each block's memory is used again."""
    a, f = blend(theta, order, validity, data)
    y_sim = run_recursion(a, f, data.y, data.starts)
    is_start = initial_samples(len(data), data.starts, order)
    carry, rows = np.zeros((max(order, 1), theta.size)), np.empty((_BLOCK, theta.size))
    for first in range(0, len(data), _BLOCK):
        block = rows[: min(_BLOCK, len(data) - first)]
        sensitivity_block(first, validity, data.u, y_sim, a, is_start, carry, block)
        yield slice(first, first + len(block)), block
