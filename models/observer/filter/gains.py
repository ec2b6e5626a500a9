"""State-space form of each local model and its steady-state Kalman gain.

The printed method contradicts itself in places; what is used here, and why:

- The state holds y(k), not y(k-1) as in eq. 2.34, or the output equation 2.40 would be one sample late.
- Eq. 2.36 multiplies SoC(k-1), so the network is trained with that delay (see `structure.full_structure`).
- Eq. 2.45 is the gain of the one-step predictor, A P C' (C P C' + R)^-1; the update 2.42 is that of the filter, whose
  gain is P C' (C P C' + R)^-1. The filter's is used.
- The validity functions are taken at SoC(k-1) and the direction and temperature of k, in training and here alike.
- State matrix and gain are blended one by one, so the error goes through (I - K_j C) A_i of *pairs* of local models,
  not of each with itself; see `stability`.
- Of hats the validity functions are straight lines over the state of charge, and the open-circuit curve is in the
  offsets at the knots: what SoC(k-1) does to the output is the slope between the knots, with or without an input.

The model's error is no white noise, so the state carries it too (see `settings`); the printed state is the part without
it. The bottom rows are the integrator scaled to the state of charge as a fraction (remark after eq. 2.38).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import is_soc
from models.observer.filter.settings import ObserverSettings
from models.readouts.steady_state import OperatingPoints, settled_regressors

# Current in multiples of 1C at which the slow error's fading is taken for the steady state.
_TYPICAL_C = 0.5
# Where slopes at rest are taken.
_USUAL_DEGC = 25.0


def state_matrices(network: LocalModelNetwork) -> FloatArray:
    """(M, n + 1, n + 1) state matrices A_i of eq. 2.36 for the state [y(k) ... y(k-n+1), SoC(k)].

    The output is in normalised units, the state of charge a fraction. Networks without past outputs (n = 0) have y(k)
    in the state all the same.

    Raises
    ------
    ModelError
        The network has no state of charge among its inputs, so that an observer cannot see it, or one without delay.

    Notes
    -----
    Of hats, at each knot the mean slope of both sides at rest is added.
    """
    structure = network.structure
    order, n = structure.output_order, max(structure.output_order, 1)
    hats = structure.kernel == "hat"
    on_soc = [(i, signal, lag) for i, (signal, lag) in enumerate(structure.taps()) if is_soc(signal)]
    if not on_soc and not hats:
        raise ModelError("the observer needs SoC(k-1) among the model's inputs; this model has none")
    if any(lag < 1 for _, _, lag in on_soc):
        raise ModelError("the observer needs the model's SoC with a delay of one sample; this model has SoC(k)")
    matrices = np.zeros((network.n_models, n + 1, n + 1))
    for i, theta in enumerate(network.theta):
        matrices[i, 0, :order] = theta[:order]
        for tap, signal, _ in on_soc:
            low, high = network.scaling[signal]
            matrices[i, 0, n] += theta[order + tap] / (high - low)
        for row in range(1, n):
            matrices[i, row, row - 1] = 1.0
        matrices[i, n, n] = 1.0
    if hats:
        matrices[:, 0, n] += knot_slopes(network)
    return matrices


def knot_slopes(network: LocalModelNetwork) -> FloatArray:
    """(M,) mean of the slopes on both sides of each knot; see `hat_slopes`."""
    slopes = hat_slopes(network)
    return 0.5 * (np.append(slopes[:1], slopes) + np.append(slopes, slopes[-1:]))


def hat_slopes(network: LocalModelNetwork) -> FloatArray:
    """(M - 1,) slope between each two knots of a network by hats at rest, normalised output per unit of SoC.

    What a state of charge among the inputs does by itself is not in it.
    """
    structure, knots = network.structure, network.partition.centres[:, 0]
    low, high = network.scaling[structure.axes[0].signal]
    soc = low + (high - low) * 0.5 * (knots[1:] + knots[:-1])
    rest = np.zeros(len(soc))
    u, _ = settled_regressors(network, OperatingPoints(soc, rest, rest, np.full(len(soc), _USUAL_DEGC)))
    step = np.diff(network.theta, axis=0)[:, structure.output_order :]
    return np.einsum("kp,kp->k", step, u) / ((high - low) * np.diff(knots))


def observer_matrices(network: LocalModelNetwork, settings: ObserverSettings) -> tuple[FloatArray, FloatArray]:
    """State matrices with the model's error beside the printed state.

    Returns
    -------
    (M, s, s) matrices for the state [y(k) ... y(k-n+1), SoC(k), quick error, slow error], the errors in multiples of
    their standard deviation, and (s, s) covariance of the process noise, normalised.
    """
    printed = state_matrices(network)
    count, n, _ = printed.shape
    quick, slow = error_keep(network, settings, _TYPICAL_C)
    matrices = np.zeros((count, n + 2, n + 2))
    matrices[:, :n, :n] = printed
    matrices[:, n, n], matrices[:, n + 1, n + 1] = quick, slow
    process = np.zeros(n + 2)
    process[0] = (settings.output_std_V / network.voltage_span_V) ** 2
    process[n - 1] = settings.soc_std_per_sqrt_s**2 * network.dt_s
    process[n:] = 1.0 - quick**2, 1.0 - slow**2
    return matrices, np.diag(process)


def output_rows(
    network: LocalModelNetwork, settings: ObserverSettings, level: FloatArray, more_slow_V: FloatArray | float = 0.0
) -> FloatArray:
    """(M, s) output rows C_i: y(k) plus the model's error, whose size depends on the local model.

    Parameters
    ----------
    network : the model
    settings : sizes of quick and slow error
    level : (M,) how large they are near each local model, relative to all
    more_slow_V : (M,) standard deviation of what makes the slow error larger there and has nothing to do with the rest
    """
    n = max(network.structure.output_order, 1)
    rows = np.zeros((network.n_models, n + 3))
    rows[:, 0] = 1.0
    rows[:, n + 1] = level * settings.quick_error_std_V / network.voltage_span_V
    rows[:, n + 2] = np.hypot(level * settings.slow_error_std_V, more_slow_V) / network.voltage_span_V
    return rows


def error_keep(network: LocalModelNetwork, settings: ObserverSettings, c_rate: float) -> tuple[float, float]:
    """Share of quick and slow error that is left after a sample at a current."""
    dt_s = network.dt_s
    faded = dt_s / settings.slow_error_time_s + dt_s * abs(c_rate) / 3600.0 / settings.slow_error_soc
    return float(np.exp(-dt_s / settings.quick_error_time_s)), float(np.exp(-faded))


def steady_state_gains(
    matrices: FloatArray, rows: FloatArray, process: FloatArray, measurement_variance: float
) -> FloatArray:
    """Filter gains K_i = P C' (C P C' + R)^-1 from the discrete Riccati equation (eq. 2.46).

    Parameters
    ----------
    matrices, rows : (M, s, s) state matrices and (M, s) output rows
    process : (s, s) covariance of the process noise
    measurement_variance : R, normalised units

    Returns
    -------
    (M, s + 1): the gain, and last the variance of the SoC after the update. A local model whose SoC cannot be seen in
    its output has no steady state: it gets a gain and a variance of zero, which no covariance comes down to, so that
    the gain of the moment goes on being used there.
    """
    size = matrices.shape[1]
    at_soc = size - 3
    measure = np.array([[measurement_variance]])
    gains = np.zeros((len(matrices), size + 1))
    for i, (matrix, row) in enumerate(zip(matrices, rows, strict=True)):
        try:
            covariance = solve_discrete_are(matrix.T, row[:, None], process, measure)
            seen = covariance @ row
            gain = seen / (row @ seen + measurement_variance)
            gains[i, :size] = gain
            gains[i, size] = covariance[at_soc, at_soc] - gain[at_soc] * seen[at_soc]
        except (np.linalg.LinAlgError, ValueError):
            gains[i] = 0.0
    return gains
