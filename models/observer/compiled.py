"""One sample of the observer as a compiled function of plain arrays; live and replay both call it.

The state of one hypothesis is [y(k) ... y(k-n+1), SoC(k), quick error, slow error, current offset, capacity error,
voltage offset, resistance error].
While the state of charge is not known well, several hypotheses run side by side (a Gaussian sum, Alspach and Sorenson,
IEEE Trans. Autom. Control 17, 1972): an open-circuit curve is no straight line over half of its range. Those that the
measurements contradict die out, those that meet are merged, and one remains.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from models.electrothermal_loop import FILTERED, HYSTERESIS, RELAXATION, SOC, SQUARED, FlatNetwork, step_signals

# Places in the state after the n past outputs.
AT_SOC, AT_QUICK, AT_SLOW, AT_OFFSET, AT_CAPACITY, AT_VOLTAGE, AT_RESISTANCE, N_EXTRA = range(8)
# Constants: noise variances per sample (normalised output, SoC, measurement); how much of the quick error is kept from
# sample to sample; how fast the slow error fades with time (per sample) and with charge (per unit of SoC); their
# standard deviations (normalised); whether the steady-state gains are used; weight of a sample in the net movement;
# the little more current (0: no offset is estimated); nominal capacity; by how much the SoC's band is widened;
# relative standard deviation of the resistances.
Q_OUTPUT, Q_SOC, R_VOLTAGE, QUICK_KEEP, SLOW_RATE, SLOW_CHARGE, QUICK_STD, SLOW_STD, STEADY, NET_SHARE, MORE_A = range(
    11
)
CAPACITY_AH, BAND, RESISTANCE_STD = 11, 12, 13
N_CONSTANTS = 14
# Memory besides the filters: last current, direction, last temperature, samples seen, charge counted since the start,
# and how the state of charge moves on average over `NET_S`.
HELD_CURRENT, HELD_DIRECTION, HELD_TEMPERATURE, SEEN, COUNTED, NET = range(6)
N_HELD = 6
# A load that only swings does not leave the place on the open-circuit curve at which the model is wrong.
NET_S = 600.0
# Columns of the output row, in physical units.
SOC_OUT, SOC_STD_OUT, VOLTAGE_OUT, INNOVATION_OUT, INNOVATION_STD_OUT = range(5)
OFFSET_OUT, OFFSET_STD_OUT, CAPACITY_OUT, CAPACITY_STD_OUT, HYPOTHESES_OUT = range(5, 10)
ERROR_OUT = 10
N_OUT = 11
# How far the estimate may leave 0..1.
SOC_SLACK = 0.05
# The steady-state gains take over once the SoC's variance is within this factor of theirs.
START_UP_RATIO = 1.5
# A hypothesis less likely than this is dropped; two are merged where they are closer than this share of the smaller
# variance, as long as the result is narrower than this standard deviation.
_LEAST_WEIGHT = 1e-5
# The model's error is never quite as assumed; a likelihood raised to this power keeps hypotheses for longer.
_TRUST = 0.5
_MERGE_SHARE = 0.6
_WIDEST_STD = 0.02


@njit(cache=True)
def step(
    net: FlatNetwork,
    level: np.ndarray,
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
    level : (M,) size of the model's error near each local model, relative to all
    gains : (M, s + 1) steady-state gains K_i and, last, the variance of the SoC that they lead to
    constants : (N_CONSTANTS,)
    x, covariance, weight : (J, s), (J, s, s), (J,) hypotheses; weight 0 marks one that is not there
    filters : (2, signals, 3); history : (2, lags, signals) normalised signals, newest first; those of the state of
        charge without the hypothesis' own starting point. The second of each is what the signals would be with a
        little more current, which tells what an offset of the current sensor does to the output
    held : (N_HELD,)
    scratch : (rows, columns) room for intermediate results
    current_A, voltage_V, temperature_degC : NaN = missing
    out : (N_OUT,) written
    """
    voltage = (voltage_V - net.voltage_low) / net.voltage_span
    missing_current = np.isnan(current_A)
    if np.isnan(temperature_degC):
        temperature_degC = held[HELD_TEMPERATURE]
    if missing_current:
        current_A = held[HELD_CURRENT]
    first = held[SEEN] == 0.0
    if first:
        held[HELD_CURRENT] = current_A
    if current_A > net.rest_A:
        held[HELD_DIRECTION] = 1.0
    elif current_A < -net.rest_A:
        held[HELD_DIRECTION] = -1.0
    moved = 0.0
    if not first:
        moved = (net.efficiency if current_A > 0.0 else 1.0) * current_A * net.soc_per_A
        for lag in range(history.shape[1] - 1, 0, -1):
            history[:, lag] = history[:, lag - 1]
    counted = held[COUNTED]
    change_A = current_A - held[HELD_CURRENT]
    step_signals(
        net, filters[0], history[0, 0], current_A, change_A, counted + moved, held[HELD_DIRECTION], temperature_degC
    )
    if constants[MORE_A] > 0.0:
        # A direction is a direction: an offset is not said to turn it.
        more_A = current_A + constants[MORE_A]
        step_signals(
            net, filters[1], history[1, 0], more_A, change_A, counted + moved, held[HELD_DIRECTION], temperature_degC
        )
        for s in range(net.kind.shape[0]):
            if net.kind[s] == HYSTERESIS:
                filters[1, s] = filters[0, s]
                history[1, 0, s] = history[0, 0, s]
    if first:
        for lag in range(1, history.shape[1]):
            history[:, lag] = history[:, 0]
    held[NET] += constants[NET_SHARE] * (moved - held[NET])
    keep_slow = np.exp(-constants[SLOW_RATE] - constants[SLOW_CHARGE] * abs(held[NET]))
    q_soc = 0.0 if first else constants[Q_SOC]
    if missing_current:
        # Nothing is known of the charge that flows: as if it were 1C either way, in each sample anew.
        q_soc += (net.soc_per_A * net.rest_A * 200.0) ** 2
    likelihood = scratch[0]
    for j in range(weight.shape[0]):
        if weight[j] > 0.0:
            base = x[j, max(net.order, 1)] - counted
            error_level, overpotential = _predict(
                net, level, gains, constants, x[j], covariance[j], history, scratch, base, moved, keep_slow, q_soc,
                first, voltage,
            )  # fmt: skip
            _correct(
                constants, x[j], covariance[j], scratch, error_level, overpotential, voltage,
                first and net.order > 0, out,
            )  # fmt: skip
            likelihood[j] = out[INNOVATION_STD_OUT]
            scratch[1, j], scratch[2, j] = out[VOLTAGE_OUT], out[INNOVATION_OUT]
    _settle(x, covariance, weight, scratch, voltage, out, max(net.order, 1))
    _to_physical(net, constants, out)
    held[HELD_CURRENT] = current_A
    held[HELD_TEMPERATURE] = temperature_degC
    held[SEEN] += 1.0
    held[COUNTED] = counted + moved


@njit(cache=True)
def _to_physical(net: FlatNetwork, constants: np.ndarray, out: np.ndarray) -> None:
    """Make volts of normalised ones, standard deviations of variances, and a capacity of its error."""
    for column in (SOC_STD_OUT, INNOVATION_STD_OUT, OFFSET_STD_OUT, CAPACITY_STD_OUT):
        out[column] = np.sqrt(max(out[column], 0.0))
    out[SOC_STD_OUT] *= constants[BAND]
    out[VOLTAGE_OUT] = net.voltage_low + net.voltage_span * out[VOLTAGE_OUT]
    out[INNOVATION_OUT] *= net.voltage_span
    out[INNOVATION_STD_OUT] *= net.voltage_span
    # The state of charge moves by (1 + e) times what the nominal capacity says.
    out[CAPACITY_OUT] = constants[CAPACITY_AH] / (1.0 + out[CAPACITY_OUT])
    out[CAPACITY_STD_OUT] *= constants[CAPACITY_AH]


@njit(cache=True)
def _predict(
    net: FlatNetwork,
    level: np.ndarray,
    gains: np.ndarray,
    constants: np.ndarray,
    x: np.ndarray,
    covariance: np.ndarray,
    history: np.ndarray,
    scratch: np.ndarray,
    base: float,
    moved: float,
    keep_slow: float,
    q_soc: float,
    first: bool,
    voltage: float,
) -> tuple[float, float]:
    """Move one hypothesis to this sample before its voltage is known.

    Returns the size of the model's error here, and what the current does to the output (normalised).
    """
    n, size = max(net.order, 1), x.shape[0]
    row, gain, phi, tilt = scratch[3], scratch[4], scratch[5], scratch[6]
    # Taken out of the tuple once: each access counts a reference.
    theta, centres, widths, kind, low, span = net.theta, net.centres, net.widths, net.kind, net.low, net.span
    axis_signal, axis_lag, tap_signal, tap_lag = net.axis_signal, net.axis_lag, net.tap_signal, net.tap_lag
    order = net.order
    n_models, n_params = theta.shape
    largest = -np.inf
    for i in range(n_models):
        phi[i] = tilt[i] = 0.0
    for j in range(axis_signal.shape[0]):
        s = axis_signal[j]
        z, per_soc = history[0, axis_lag[j], s], 0.0
        if kind[s] == SOC:
            per_soc = 1.0 / span[s]
            z += base * per_soc
        for i in range(n_models):
            scaled = (z - centres[i, j]) / widths[i, j]
            phi[i] -= 0.5 * scaled * scaled
            tilt[i] -= per_soc * scaled / widths[i, j]
    for i in range(n_models):
        largest = max(largest, phi[i])
    total, mean_tilt = 0.0, 0.0
    for i in range(n_models):
        phi[i] = np.exp(phi[i] - largest)
        total += phi[i]
    for i in range(n_models):
        phi[i] /= total
        mean_tilt += phi[i] * tilt[i]
    # Output and its derivative: the validity functions move with the state of charge too, and on a plateau the local
    # parameters without that part can even have the wrong sign.
    for a in range(size):
        row[a] = 0.0
    y, overpotential, kept = 0.0, 0.0, 0.0
    for p in range(n_params):
        blended, tilted = 0.0, 0.0
        for i in range(n_models):
            part = phi[i] * theta[i, p]
            blended += part
            tilted += part * (tilt[i] - mean_tilt)
        if p < order:
            value = x[p]
            row[p] = blended
            kept += blended
        elif p < n_params - 1:
            s, lag = tap_signal[p - order], tap_lag[p - order]
            value = history[0, lag, s]
            if constants[MORE_A] > 0.0:
                row[n + AT_OFFSET] -= blended * (history[1, lag, s] - value) / constants[MORE_A]
            if kind[s] == SOC:
                value += base / span[s]
                row[n] += blended / span[s]
            elif kind[s] == FILTERED or kind[s] == SQUARED or kind[s] == RELAXATION:
                overpotential += blended * (value + low[s] / span[s])
        else:
            value = 1.0
        y += blended * value
        row[n] += tilted * value
    overpotential /= 1.0 - kept
    error_level = 0.0
    for i in range(n_models):
        error_level += phi[i] * level[i]
    if constants[STEADY] > 0.0:
        for a in range(size + 1):
            gain[a] = 0.0
            for i in range(n_models):
                gain[a] += phi[i] * gains[i, a]
    if first and order > 0:
        # No output before the first sample: start from the measurement.
        y = voltage if not np.isnan(voltage) else x[0]
        for lag in range(order):
            x[lag] = y
            covariance[lag, lag] = constants[R_VOLTAGE]
        return error_level, overpotential
    soc_per_A = 0.0 if first else net.soc_per_A
    _spread(covariance, scratch, row, n, soc_per_A, moved, constants[QUICK_KEEP], keep_slow)
    covariance[0, 0] += constants[Q_OUTPUT]
    covariance[n, n] += q_soc
    covariance[n + AT_QUICK, n + AT_QUICK] += 1.0 - constants[QUICK_KEEP] ** 2
    covariance[n + AT_SLOW, n + AT_SLOW] += 1.0 - keep_slow**2
    covariance[n + AT_RESISTANCE, n + AT_RESISTANCE] += 1.0 - keep_slow**2
    for lag in range(n - 1, 0, -1):
        x[lag] = x[lag - 1]
    x[0] = y + row[n + AT_OFFSET] * x[n + AT_OFFSET]
    x[n] += moved * (1.0 + x[n + AT_CAPACITY]) - soc_per_A * x[n + AT_OFFSET]
    x[n + AT_QUICK] *= constants[QUICK_KEEP]
    x[n + AT_SLOW] *= keep_slow
    x[n + AT_RESISTANCE] *= keep_slow
    return error_level, overpotential


@njit(cache=True)
def _spread(
    covariance: np.ndarray,
    scratch: np.ndarray,
    row: np.ndarray,
    n: int,
    soc_per_A: float,
    moved: float,
    keep_quick: float,
    keep_slow: float,
) -> None:
    """Covariance of A x, in place; A has `row` on top, shifts the outputs, and counts charge."""
    size = covariance.shape[0]
    moved_rows = scratch[7 : 7 + size]
    for b in range(size):
        total = 0.0
        for a in range(size):
            total += row[a] * covariance[a, b]
        moved_rows[0, b] = total
        for lag in range(1, n):
            moved_rows[lag, b] = covariance[lag - 1, b]
        moved_rows[n, b] = covariance[n, b] - soc_per_A * covariance[n + AT_OFFSET, b]
        moved_rows[n, b] += moved * covariance[n + AT_CAPACITY, b]
        moved_rows[n + AT_QUICK, b] = keep_quick * covariance[n + AT_QUICK, b]
        moved_rows[n + AT_SLOW, b] = keep_slow * covariance[n + AT_SLOW, b]
        moved_rows[n + AT_OFFSET, b] = covariance[n + AT_OFFSET, b]
        moved_rows[n + AT_CAPACITY, b] = covariance[n + AT_CAPACITY, b]
        moved_rows[n + AT_VOLTAGE, b] = covariance[n + AT_VOLTAGE, b]
        moved_rows[n + AT_RESISTANCE, b] = keep_slow * covariance[n + AT_RESISTANCE, b]
    for a in range(size):
        line, old = covariance[a], moved_rows[a]
        total = 0.0
        for b in range(size):
            total += old[b] * row[b]
        line[0] = total
        for lag in range(1, n):
            line[lag] = old[lag - 1]
        line[n] = old[n] - soc_per_A * old[n + AT_OFFSET] + moved * old[n + AT_CAPACITY]
        line[n + AT_QUICK] = keep_quick * old[n + AT_QUICK]
        line[n + AT_SLOW] = keep_slow * old[n + AT_SLOW]
        line[n + AT_OFFSET] = old[n + AT_OFFSET]
        line[n + AT_CAPACITY] = old[n + AT_CAPACITY]
        line[n + AT_VOLTAGE] = old[n + AT_VOLTAGE]
        line[n + AT_RESISTANCE] = keep_slow * old[n + AT_RESISTANCE]


@njit(cache=True)
def _correct(
    constants: np.ndarray,
    x: np.ndarray,
    covariance: np.ndarray,
    scratch: np.ndarray,
    error_level: float,
    overpotential: float,
    voltage: float,
    started: bool,
    out: np.ndarray,
) -> None:
    """Correct one hypothesis by the measured voltage, if there is one."""
    size = x.shape[0]
    n = size - N_EXTRA
    gain, seen = scratch[4], scratch[3]
    quick, slow = constants[QUICK_STD] * error_level, constants[SLOW_STD] * error_level
    more = constants[RESISTANCE_STD] * overpotential
    for a in range(size):
        seen[a] = covariance[a, 0] + covariance[a, n + AT_VOLTAGE]
        seen[a] += quick * covariance[a, n + AT_QUICK] + slow * covariance[a, n + AT_SLOW]
        seen[a] += more * covariance[a, n + AT_RESISTANCE]
    variance = seen[0] + seen[n + AT_VOLTAGE] + quick * seen[n + AT_QUICK] + slow * seen[n + AT_SLOW]
    variance += more * seen[n + AT_RESISTANCE] + constants[R_VOLTAGE]
    expected = x[0] + x[n + AT_VOLTAGE] + quick * x[n + AT_QUICK] + slow * x[n + AT_SLOW] + more * x[n + AT_RESISTANCE]
    out[VOLTAGE_OUT], out[INNOVATION_STD_OUT] = expected, variance
    out[INNOVATION_OUT] = voltage - expected
    if np.isnan(voltage) or started:
        return
    if constants[STEADY] == 0.0 or covariance[n, n] > START_UP_RATIO * gain[size]:
        # Far less is known than in the steady state that the gains were designed for: the same filter's gain for
        # what is known now, until the two meet.
        for a in range(size):
            gain[a] = seen[a] / variance
    for a in range(size):
        x[a] += gain[a] * (voltage - expected)
    # Holds for any gain, not only for the optimal one (Joseph's form, multiplied out).
    for a in range(size):
        for b in range(a, size):
            value = covariance[a, b] - gain[a] * seen[b] - seen[a] * gain[b] + gain[a] * variance * gain[b]
            covariance[a, b] = value
            covariance[b, a] = value
    # A state of charge beyond empty or full is no estimate; the slack leaves room for a capacity that is a little off.
    x[n] = min(max(x[n], -SOC_SLACK), 1.0 + SOC_SLACK)


@njit(cache=True)
def _settle(
    x: np.ndarray,
    covariance: np.ndarray,
    weight: np.ndarray,
    scratch: np.ndarray,
    voltage: float,
    out: np.ndarray,
    n: int,
) -> None:
    """Weigh the hypotheses by what was measured, drop and merge them, and write what they say together."""
    expected, innovation, variance = 0.0, 0.0, 0.0
    best, alive = -np.inf, 0
    for j in range(weight.shape[0]):
        if weight[j] > 0.0:
            alive += 1
            expected += weight[j] * scratch[1, j]
            innovation += weight[j] * scratch[2, j]
            variance += weight[j] * (scratch[0, j] + scratch[1, j] ** 2)
    out[VOLTAGE_OUT], out[INNOVATION_OUT] = expected, innovation
    out[INNOVATION_STD_OUT] = scratch[0, 0] if alive == 1 and weight[0] > 0.0 else variance - expected**2
    if alive > 1:
        if not np.isnan(voltage):
            for j in range(weight.shape[0]):
                if weight[j] > 0.0:
                    scratch[0, j] = -0.5 * _TRUST * (scratch[2, j] ** 2 / scratch[0, j] + np.log(scratch[0, j]))
                    scratch[0, j] += np.log(weight[j])
                    best = max(best, scratch[0, j])
            for j in range(weight.shape[0]):
                if weight[j] > 0.0:
                    weight[j] = np.exp(scratch[0, j] - best)
        _thin_out(x, covariance, weight, n)
    for a in range(6):
        out[OFFSET_OUT + a] = 0.0
    mean, square, offset, offset2, capacity, capacity2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(weight.shape[0]):
        if weight[j] > 0.0:
            soc, o, c = x[j, n], x[j, n + AT_OFFSET], x[j, n + AT_CAPACITY]
            mean += weight[j] * soc
            offset += weight[j] * o
            capacity += weight[j] * c
    for j in range(weight.shape[0]):
        if weight[j] > 0.0:
            soc, o, c = x[j, n] - mean, x[j, n + AT_OFFSET] - offset, x[j, n + AT_CAPACITY] - capacity
            square += weight[j] * (covariance[j, n, n] + soc * soc)
            offset2 += weight[j] * (covariance[j, n + AT_OFFSET, n + AT_OFFSET] + o * o)
            capacity2 += weight[j] * (covariance[j, n + AT_CAPACITY, n + AT_CAPACITY] + c * c)
            out[HYPOTHESES_OUT] += 1.0
            out[ERROR_OUT] += weight[j] * max(abs(x[j, n + AT_SLOW]), abs(x[j, n + AT_RESISTANCE]))
    out[SOC_OUT], out[SOC_STD_OUT] = mean, square
    out[OFFSET_OUT], out[OFFSET_STD_OUT] = offset, offset2
    out[CAPACITY_OUT], out[CAPACITY_STD_OUT] = capacity, capacity2


@njit(cache=True)
def _thin_out(x: np.ndarray, covariance: np.ndarray, weight: np.ndarray, n: int) -> None:
    """Drop unlikely hypotheses, merge those that have met (moments kept), and make the weights add up to 1."""
    count, size = x.shape
    total = 0.0
    for j in range(count):
        total += weight[j]
    for j in range(count):
        weight[j] /= total
        if weight[j] < _LEAST_WEIGHT:
            weight[j] = 0.0
    for i in range(count):
        for j in range(i + 1, count):
            if weight[i] == 0.0 or weight[j] == 0.0:
                continue
            apart = (x[i, n] - x[j, n]) ** 2
            least = min(covariance[i, n, n], covariance[j, n, n])
            share = weight[i] / (weight[i] + weight[j])
            merged = share * covariance[i, n, n] + (1.0 - share) * covariance[j, n, n] + share * (1.0 - share) * apart
            if apart > _MERGE_SHARE * least or merged > _WIDEST_STD**2:
                continue
            for a in range(size):
                for b in range(size):
                    between = (x[i, a] - x[j, a]) * (x[i, b] - x[j, b])
                    covariance[i, a, b] = (
                        share * covariance[i, a, b]
                        + (1.0 - share) * covariance[j, a, b]
                        + share * (1.0 - share) * between
                    )
            for a in range(size):
                x[i, a] = share * x[i, a] + (1.0 - share) * x[j, a]
            weight[i] += weight[j]
            weight[j] = 0.0
    total = 0.0
    for j in range(count):
        total += weight[j]
    for j in range(count):
        weight[j] /= total
