"""How likely innovations are: a small Kalman filter over a free run's errors, with the noise that the observer has."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.compiled_network import flat_network
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import Dataset
from models.network.signals import soc_by_counting
from models.network.signals.filters import smoothed
from models.network.signals.loop_form import is_overpotential
from models.observer.filter.places import NET_S
from models.observer.filter.settings import error_levels
from models.observer.tuning.unseen import Judged

# SoC is moved by this much to see how the output follows.
_STEP_SOC = 0.002
# So many samples are looked at, the same number from the beginning of each run.
_LONGEST = 100_000


class TuningData(NamedTuple):
    """Free-run errors of all runs, one after the other.

    Attributes
    ----------
    error_V : (N,) measured minus simulated, NaN where not measured
    slope_V : (N,) change of the output per unit of SoC
    level : (N,) size of the model's error there, relative to all
    moved : (N,) size of the SoC's net change in each sample, averaged as the observer does
    overpotential_V : (N,) what the current does to the output
    starts : first index of each run
    """

    error_V: FloatArray
    slope_V: FloatArray
    level: FloatArray
    moved: FloatArray
    overpotential_V: FloatArray
    starts: np.ndarray
    dt_s: float


def tuning_data(judged: list[Judged]) -> TuningData:
    """Free-run errors with what the filter needs to know of each sample.

    Raises
    ------
    ModelError
        Nothing was measured.
    """
    if not any(each.run.measured.any() for each in judged):
        raise ModelError("the observer cannot be tuned: no run with a measured voltage was given")
    parts: list[list[FloatArray]] = [[], [], [], [], []]
    starts, total = [], 0
    dt_s, levels = judged[0].network.dt_s, error_levels(judged[0].network)
    for each in judged:
        network, run, soc = each.network, each.run, each.initial_soc
        kept = slice(0, max(_LONGEST // len(judged), 1))
        simulated = free_run_V(network, run, soc)
        moved_up, moved_down = (free_run_V(network, run, soc + sign * _STEP_SOC) for sign in (1.0, -1.0))
        counted = soc_by_counting(run.charge_Ah, soc, network.cell.capacity_Ah, network.cell.efficiency)
        parts[0].append((run.voltage_V - simulated)[kept])
        parts[1].append(((moved_up - moved_down) / (2.0 * _STEP_SOC))[kept])
        data = network.dataset([run], [soc])
        validity = network.partition.validity(data.z)
        parts[2].append((validity @ levels)[kept])
        share = min(dt_s / NET_S, 1.0)
        net = smoothed(np.diff(counted, prepend=counted[:1]), 1.0 - share)
        parts[3].append(np.abs(net)[kept])
        parts[4].append(_overpotential_V(network, validity @ network.theta, data)[kept])
        starts.append(total)
        total += len(parts[0][-1])
    return TuningData(*(np.concatenate(part) for part in parts), starts=np.array(starts), dt_s=dt_s)


def _overpotential_V(network: LocalModelNetwork, blended: FloatArray, data: Dataset) -> FloatArray:
    """(N,) what the current does to the output once it has settled; the observer has the same."""
    order, out = network.structure.output_order, np.zeros(len(data))
    net = flat_network(network)
    forms = net.form[net.tap_signal].tolist()
    for tap, (signal, _) in enumerate(network.structure.taps()):
        if is_overpotential(forms[tap]):
            low, high = network.scaling[signal]
            out += blended[:, order + tap] * (data.u[:, tap] + low / (high - low))
    return network.voltage_span_V * out / (1.0 - blended[:, :order].sum(axis=1))


def log_likelihood(data: TuningData, values: FloatArray) -> float:
    """Log-likelihood of the innovations for the tuned values, in the order of the settings that are tuned."""
    return float(_log_likelihood(data, values))


@njit(cache=True)
def _log_likelihood(data: TuningData, values: np.ndarray) -> float:
    """Kalman filter over SoC, quick error, slow error and resistance, each scaled to 1 but the first.

    It runs some hundred times over all samples: states, covariance (its upper half) and gains are scalars, which stay
    in registers.
    """
    # Taken out of the tuple once: each access counts a reference.
    error_V, slope_V, level, moved = data.error_V, data.slope_V, data.level, data.moved
    overpotential_V, starts, dt_s = data.overpotential_V, data.starts, data.dt_s
    voltage_std_V, quick_std_V, quick_s, slow_std_V = values[0], values[1], values[2], values[3]
    slow_s, slow_soc, soc_std, resistance_std = values[4], values[5], values[6], values[7]
    keep_1, drift_0, noise_V2 = np.exp(-dt_s / quick_s), soc_std**2 * dt_s, voltage_std_V**2
    x_0 = x_1 = x_2 = x_3 = 0.0
    p_00 = p_01 = p_02 = p_03 = p_11 = p_12 = p_13 = p_22 = p_23 = p_33 = 0.0
    total, part = 0.0, 0
    for k in range(error_V.shape[0]):
        if part < starts.shape[0] and k == starts[part]:
            x_0 = x_1 = x_2 = x_3 = 0.0
            p_00 = p_01 = p_02 = p_03 = p_12 = p_13 = p_23 = 0.0
            p_11 = p_22 = p_33 = 1.0
            part += 1
        else:
            keep = np.exp(-dt_s / slow_s - moved[k] / slow_soc)
            x_1, x_2, x_3 = keep_1 * x_1, keep * x_2, keep * x_3
            p_00, p_01, p_02, p_03 = p_00 + drift_0, keep_1 * p_01, keep * p_02, keep * p_03
            p_11, p_12, p_13 = keep_1**2 * (p_11 - 1.0) + 1.0, keep_1 * keep * p_12, keep_1 * keep * p_13
            p_22, p_23, p_33 = keep**2 * (p_22 - 1.0) + 1.0, keep**2 * p_23, keep**2 * (p_33 - 1.0) + 1.0
        if np.isnan(error_V[k]):
            continue
        h_0, h_1, h_2 = slope_V[k], quick_std_V * level[k], slow_std_V * level[k]
        h_3 = resistance_std * overpotential_V[k]
        seen_0 = p_00 * h_0 + p_01 * h_1 + p_02 * h_2 + p_03 * h_3
        seen_1 = p_01 * h_0 + p_11 * h_1 + p_12 * h_2 + p_13 * h_3
        seen_2 = p_02 * h_0 + p_12 * h_1 + p_22 * h_2 + p_23 * h_3
        seen_3 = p_03 * h_0 + p_13 * h_1 + p_23 * h_2 + p_33 * h_3
        variance = noise_V2 + h_0 * seen_0 + h_1 * seen_1 + h_2 * seen_2 + h_3 * seen_3
        innovation = error_V[k] - h_0 * x_0 - h_1 * x_1 - h_2 * x_2 - h_3 * x_3
        total -= 0.5 * (innovation * innovation / variance + np.log(variance))
        gain_0, gain_1, gain_2, gain_3 = seen_0 / variance, seen_1 / variance, seen_2 / variance, seen_3 / variance
        x_0, x_1 = x_0 + gain_0 * innovation, x_1 + gain_1 * innovation
        x_2, x_3 = x_2 + gain_2 * innovation, x_3 + gain_3 * innovation
        p_00, p_01 = p_00 - gain_0 * seen_0, p_01 - gain_0 * seen_1
        p_02, p_03 = p_02 - gain_0 * seen_2, p_03 - gain_0 * seen_3
        p_11, p_12, p_13 = p_11 - gain_1 * seen_1, p_12 - gain_1 * seen_2, p_13 - gain_1 * seen_3
        p_22, p_23, p_33 = p_22 - gain_2 * seen_2, p_23 - gain_2 * seen_3, p_33 - gain_3 * seen_3
    return total
