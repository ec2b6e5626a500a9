"""State-space form of each local model and its steady-state Kalman gain.

The printed method contradicts itself in places; what is used here, and why:

- The state holds y(k), not y(k-1) as in eq. 2.34, or the output equation 2.40 would be one sample late.
- Eq. 2.36 multiplies SoC(k-1), so the network is trained with that delay (see `structure.full_structure`).
- Eq. 2.45 is the gain of the one-step predictor, A P C' (C P C' + R)^-1; the update 2.42 is that of the filter, whose
  gain is P C' (C P C' + R)^-1. The filter's is used.
- The validity functions are taken at SoC(k-1) and the direction and temperature of k, in training and here alike.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from models.errors import ModelError
from models.local_model_network import LocalModelNetwork
from models.timeseries import FloatArray


def state_matrices(network: LocalModelNetwork) -> FloatArray:
    """(M, n + 1, n + 1) state matrices A_i of eq. 2.36 for the state [y(k) ... y(k-n+1), SoC(k)].

    The output is in normalised units, the state of charge a fraction (remark after eq. 2.38).

    Raises
    ------
    ModelError
        The network has no state of charge among its inputs, so that an observer cannot see it.
    """
    n = max(network.structure.output_order, 1)
    taps = network.structure.soc_regressors()
    if not taps:
        raise ModelError("the observer needs SoC(k-1) among the model's inputs; this model has none")
    order = network.structure.output_order
    signals = [network.structure.taps()[tap - order][0] for tap in taps]
    spans = [network.scaling[signal][1] - network.scaling[signal][0] for signal in signals]
    matrices = np.zeros((network.n_models, n + 1, n + 1))
    for i, theta in enumerate(network.theta):
        matrices[i, 0, : network.structure.output_order] = theta[: network.structure.output_order]
        matrices[i, 0, n] = sum(theta[tap] / span for tap, span in zip(taps, spans, strict=True))
        for row in range(1, n):
            matrices[i, row, row - 1] = 1.0
        matrices[i, n, n] = 1.0
    return matrices


def steady_state_gains(
    matrices: FloatArray, output_variance: float, soc_variance: float, measurement_variance: float
) -> FloatArray:
    """Filter gains K_i = P C' (C P C' + R)^-1 from the discrete Riccati equation (eq. 2.46).

    Parameters
    ----------
    matrices : (M, s, s) state matrices
    output_variance, soc_variance : process noise per sample of the output (normalised units) and of the SoC
    measurement_variance : R, normalised units

    Returns
    -------
    (M, s + 1): the gain, and last the variance of the SoC after the update. A local model whose SoC cannot be seen in
    its output (no solution) gets a gain of zero for the SoC and an infinite variance.
    """
    size = matrices.shape[1]
    process = np.zeros((size, size))
    process[0, 0], process[-1, -1] = output_variance, soc_variance
    measure = np.array([[measurement_variance]])
    output = np.zeros((size, 1))
    output[0, 0] = 1.0
    gains = np.zeros((len(matrices), size + 1))
    for i, matrix in enumerate(matrices):
        try:
            covariance = solve_discrete_are(matrix.T, output, process, measure)
            gain = covariance[:, 0] / (covariance[0, 0] + measurement_variance)
            gains[i, :size] = gain
            gains[i, size] = covariance[-1, -1] - gain[-1] * covariance[0, -1]
        except (np.linalg.LinAlgError, ValueError):
            gains[i, 0] = output_variance / (output_variance + measurement_variance)
            gains[i, size] = np.inf
    return gains
