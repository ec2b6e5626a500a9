"""One sample of the observer as a compiled function of plain arrays; live and replay both call it.

The state of one hypothesis is [y(k) ... y(k-n+1), SoC(k), quick error, slow error, current offset, capacity error,
voltage offset, resistance error, place in the hysteresis loop at the start] (`places`), the last where there is a
loop. A sample goes through it as signals (`running_inputs`), prediction
(`prediction`), correction (`correction`), and what all hypotheses say together (`hypotheses`).
While the state of charge is not known well, several hypotheses run side by side (a Gaussian sum, Alspach and Sorenson,
IEEE Trans. Autom. Control 17, 1972): an open-circuit curve is no straight line over half of its range. Those that the
measurements contradict die out, those that meet are merged, and one remains.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.network.compiled_network import FlatNetwork
from models.observer.filter import hypotheses
from models.observer.filter.blending import Prepared
from models.observer.filter.correction import correct
from models.observer.filter.places import (
    AT_OFFSET,
    BAND,
    BLENDED_ROW,
    CAPACITY_AH,
    CAPACITY_OUT,
    CAPACITY_STD_OUT,
    COMPILED,
    COUNTED,
    DOUBLING_K,
    EXPECTED_ROW,
    HELD_CURRENT,
    HELD_DIRECTION,
    HELD_OFFSET,
    HELD_OFFSET_STD,
    HELD_TEMPERATURE,
    INNOVATION_OUT,
    INNOVATION_ROW,
    INNOVATION_STD_OUT,
    LIKELIHOOD_ROW,
    LOST,
    LOST_LEFT,
    MORE_A,
    NET,
    NET_SHARE,
    OFFSET_OUT,
    OFFSET_STD_OUT,
    OUTPUT_ROW,
    Q_SOC,
    R_JUDGED_MORE,
    RESISTANCE_STD,
    SEEN,
    SERIES_STD,
    SLOW_CHARGE,
    SLOW_RATE,
    SOC_STD_OUT,
    TRAINED_HIGH,
    TRAINED_LOW,
    UNKNOWN_CURRENT,
    VOLTAGE_OUT,
)
from models.observer.filter.prediction import predict
from models.observer.filter.running_inputs import move_on

# Standard deviations of the current sensor's offset up to which a current is as good as none.
_TOLD_SIGMA = 2.0
# Share of what a missing current did to the voltage that counts as nothing.
_GONE = 0.01


# Arguments one by one: from Python a named tuple of seven arrays costs 0.5 to 0.8 us more at each live sample.
@njit(**COMPILED)
def step(
    net: FlatNetwork,
    prepared: Prepared,
    errors: np.ndarray,
    gains: np.ndarray,
    constants: np.ndarray,
    # memory, updated in place
    x: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray,
    filters: np.ndarray,
    history: np.ndarray,
    held: np.ndarray,
    scratch: np.ndarray,
    # the sample
    current_A: float,
    voltage_V: float,
    temperature_degC: float,
    out: np.ndarray,
) -> None:
    """Advance by one sample.

    Parameters
    ----------
    net : the network
    prepared : what of it is worked out beforehand
    errors : (N_ERRORS, M) standard deviations of the model's errors near each local model, normalised
    gains : (M, s + 1) steady-state gains K_i and, last, the variance of the SoC that they lead to
    constants : (N_CONSTANTS,)
    x, covariance, weight : (J, s), (J, s, s), (J,) hypotheses; the first whose weight is 0 ends them
    filters : (2, signals, 3); history : (2, lags, signals) normalised signals, newest first; those of the state of
        charge without the hypothesis' own starting point. The second of each is what the signals would be with a
        little more current, which tells what an offset of the current sensor does to the output
    held : (N_HELD,)
    scratch : (rows, columns) room for intermediate results
    current_A, voltage_V, temperature_degC : NaN = missing
    out : (N_OUT,) written
    """
    voltage = (voltage_V - net.voltage_low) / net.voltage_span
    missing_current, first = np.isnan(current_A), held[SEEN] == 0.0
    if np.isnan(temperature_degC):
        temperature_degC = held[HELD_TEMPERATURE]
    if missing_current:
        current_A = held[HELD_CURRENT]
    counted, moved = held[COUNTED], 0.0
    if not first:
        moved = (net.efficiency if current_A > 0.0 else 1.0) * current_A * net.soc_per_A
    # What may be nothing but the sensor's offset is rest, and moves neither direction nor hysteresis.
    flowing_A = current_A - held[HELD_OFFSET]
    if abs(flowing_A) <= _TOLD_SIGMA * held[HELD_OFFSET_STD]:
        flowing_A = 0.0
    if abs(flowing_A) > net.rest_A:
        held[HELD_DIRECTION] = np.sign(flowing_A)
    change_A = 0.0 if first else current_A - held[HELD_CURRENT]
    alive, n = hypotheses.count(weight), max(net.order, 1)
    likely_soc = moved
    for j in range(alive):
        likely_soc += weight[j] * x[j, n]
    move_on(
        net, prepared.per_span, constants[MORE_A], filters, history, current_A, flowing_A, change_A, counted + moved,
        likely_soc, held[HELD_DIRECTION], temperature_degC, first,
    )  # fmt: skip
    held[NET] += constants[NET_SHARE] * (moved - held[NET])
    keep_slow = np.exp(-constants[SLOW_RATE] - constants[SLOW_CHARGE] * abs(held[NET]))
    q_soc = 0.0 if first else constants[Q_SOC]
    unknown = _unknown(constants, held, missing_current, first)
    if held[LOST] > 0.0:
        # As if it were 1C either way for as long as it is missing: the error of the charge grows with the samples.
        q_soc += (2.0 * held[LOST] - 1.0) * (net.soc_per_A * net.rest_A * UNKNOWN_CURRENT) ** 2
    # Colder or warmer than any run that the model was made from, it is off by more.
    times = 1.0
    if temperature_degC < constants[TRAINED_LOW]:
        times += (constants[TRAINED_LOW] - temperature_degC) / constants[DOUBLING_K]
    elif temperature_degC > constants[TRAINED_HIGH]:
        times += (temperature_degC - constants[TRAINED_HIGH]) / constants[DOUBLING_K]
    for j in range(alive):
        base = x[j, n] - counted
        quick, slow, overpotential = predict(
            net, prepared, errors, gains, constants, x[j], covariance[j], filters, history, scratch, base, moved,
            keep_slow, q_soc, first, voltage,
        )  # fmt: skip
        quick, slow = times * quick, times * slow
        more = times * constants[RESISTANCE_STD] * overpotential + constants[SERIES_STD] * current_A
        blind = unknown * unknown * _blind(net, constants, scratch, n) if unknown > 0.0 else 0.0
        correct(
            n, constants, x[j], covariance[j], scratch, quick, slow, more, times, voltage, first and net.order > 0,
            blind, out,
        )  # fmt: skip
        scratch[EXPECTED_ROW, j], scratch[INNOVATION_ROW, j] = out[VOLTAGE_OUT], out[INNOVATION_OUT]
        scratch[LIKELIHOOD_ROW, j] = out[INNOVATION_STD_OUT]
    alive = hypotheses.weigh(n, x, covariance, weight, scratch, alive, np.nan if unknown > 0.0 else voltage, out)
    hypotheses.sum_up(n, x, covariance, weight, alive, out)
    _to_physical(net, constants, out)
    held[HELD_OFFSET], held[HELD_OFFSET_STD] = out[OFFSET_OUT], out[OFFSET_STD_OUT]
    held[HELD_CURRENT] = current_A
    held[HELD_TEMPERATURE] = temperature_degC
    held[SEEN] += 1.0
    held[COUNTED] = counted + moved


@njit(**COMPILED)
def _unknown(constants: np.ndarray, held: np.ndarray, missing_current: bool, first: bool) -> float:
    """Count a sample without a current; return how much of an unknown current is in the voltage, 0 to 1."""
    if missing_current:
        held[LOST] += 0.0 if first else 1.0
        # A sample here and there leaves nothing.
        if held[LOST] > 1.0:
            held[LOST_LEFT] += constants[NET_SHARE] * (1.0 - held[LOST_LEFT])
        return 1.0
    held[LOST] = 0.0
    held[LOST_LEFT] *= 1.0 - constants[NET_SHARE]
    if held[LOST_LEFT] < _GONE:
        held[LOST_LEFT] = 0.0
    return held[LOST_LEFT]


@njit(**COMPILED)
def _blind(net: FlatNetwork, constants: np.ndarray, scratch: np.ndarray, n: int) -> float:
    """Variance of the output (normalised) by 1C that flows or does not, for as long as the model remembers it."""
    if constants[MORE_A] == 0.0:
        # What a current does was not worked out: as far as the voltage ever goes.
        return 1.0
    kept = 0.0
    for p in range(net.order):
        kept += scratch[BLENDED_ROW, p]
    return (net.rest_A * UNKNOWN_CURRENT * scratch[OUTPUT_ROW, n + AT_OFFSET] / (1.0 - kept)) ** 2


@njit(**COMPILED)
def _to_physical(net: FlatNetwork, constants: np.ndarray, out: np.ndarray) -> None:
    """Make volts of normalised ones, standard deviations of variances, and a capacity of its error."""
    out[INNOVATION_STD_OUT] += constants[R_JUDGED_MORE]
    for column in (SOC_STD_OUT, INNOVATION_STD_OUT, OFFSET_STD_OUT, CAPACITY_STD_OUT):
        out[column] = np.sqrt(max(out[column], 0.0))
    out[SOC_STD_OUT] *= constants[BAND]
    out[VOLTAGE_OUT] = net.voltage_low + net.voltage_span * out[VOLTAGE_OUT]
    out[INNOVATION_OUT] *= net.voltage_span
    out[INNOVATION_STD_OUT] *= net.voltage_span
    # The state of charge moves by (1 + e) times what the nominal capacity says.
    out[CAPACITY_OUT] = constants[CAPACITY_AH] / (1.0 + out[CAPACITY_OUT])
    out[CAPACITY_STD_OUT] *= constants[CAPACITY_AH]
