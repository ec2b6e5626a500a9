"""Signals of a block of samples, one signal after the other: the same as `compiled_network.step_signals` makes.

A low-pass waits for its own last value, so that four of them go side by side in about the time of one. What signals
share, the current scaled by temperature and its charge transfer, is worked out once for all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from models.network.compiled_network import FlatNetwork, bent
from models.network.signals.filters import DIFFUSION_GAINS, FURTHEST_BEHIND, slower_at
from models.network.signals.loop_form import (
    AS_IS,
    CASCADE,
    DIFFUSION,
    DRIVEN,
    ENTRY_BITS,
    INVERSE_TEMPERATURE,
    LOOP,
    SOC,
    SQUARED_BIT,
    TEMPERATURE,
)
from models.network.signals.temperature_scale import KELVIN, REFERENCE_K, within_degC


@njit(cache=True)
def _make_signals(
    net: FlatNetwork,
    filters: np.ndarray,
    held: np.ndarray,
    current_A: np.ndarray,
    temperature_degC: np.ndarray,
    soc: np.ndarray,
    into: np.ndarray,
) -> None:
    """Write the (S, size) normalised signals of a block; `filters` and `held` carry on to the next.

    Parameters
    ----------
    net : the network
    filters : (S, 3) memory of the signals
    held : last direction, and the current before the block
    current_A, temperature_degC, soc : (size,)
    into : (S, size) written
    """
    slowed, slowed_of, drive, drive_of = _drives(net, current_A, temperature_degC)
    plain, count = np.empty(net.form.shape[0], np.int64), 0
    for s in range(net.form.shape[0]):
        form = net.form[s]
        if form >= DRIVEN:
            if form & ENTRY_BITS == AS_IS and form & SQUARED_BIT == 0:
                plain[count] = s
                count += 1
            else:
                _bent(form, net.pole[s, 0], filters[s], drive[drive_of[s]], into[s])
        elif form == SOC or form == DIFFUSION:
            _diffusion(net, s, filters[s], slowed[slowed_of[s]], current_A, soc, into[s])
        else:
            _others(net, s, filters[s], held, current_A, temperature_degC, into[s])
    for first in range(0, count - count % 4, 4):
        _four_low_passes(net, filters, plain[first : first + 4], drive, drive_of, into)
    for s in plain[count - count % 4 : count]:
        _bent(int(net.form[s]), net.pole[s, 0], filters[s], drive[drive_of[s]], into[s])
    for k in range(current_A.shape[0]):
        if abs(current_A[k]) > net.rest_A:
            held[0] = np.sign(current_A[k])
    held[1] = current_A[-1]
    for s in range(net.form.shape[0]):
        row, low, span = into[s], net.low[s], net.span[s]
        for k in range(row.shape[0]):
            row[k] = (row[k] - low) / span


@njit(cache=True)
def _drives(net: FlatNetwork, current_A: np.ndarray, temperature_degC: np.ndarray) -> tuple:
    """Scaling by temperature and what enters the low-passes, each kind once, and which of them a signal takes."""
    n_signals, size = net.form.shape[0], current_A.shape[0]
    slowed_of, drive_of = np.zeros(n_signals, np.int64), np.zeros(n_signals, np.int64)
    n_slowed, n_drives = 0, 0
    own_slowed, own_drive = np.empty(n_signals, np.int64), np.empty(n_signals, np.int64)
    for s in range(n_signals):
        slowed_of[s] = drive_of[s] = -1
        if net.form[s] < DRIVEN and net.form[s] != SOC and net.form[s] != DIFFUSION:
            continue
        for t in range(s):
            if slowed_of[t] >= 0 and net.activation_K[t] == net.activation_K[s]:
                slowed_of[s] = slowed_of[t]
                if drive_of[t] >= 0 and net.exchange_A[t] == net.exchange_A[s]:
                    drive_of[s] = drive_of[t]
        if slowed_of[s] < 0:
            slowed_of[s], own_slowed[n_slowed] = n_slowed, s
            n_slowed += 1
        if drive_of[s] < 0 and net.form[s] >= DRIVEN:
            drive_of[s], own_drive[n_drives] = n_drives, s
            n_drives += 1
    slowed, drive = np.empty((n_slowed, size)), np.empty((n_drives, size))
    for row in range(n_slowed):
        activation_K = net.activation_K[own_slowed[row]]
        for k in range(size):
            slowed[row, k] = 1.0
            if activation_K != 0.0:
                slowed[row, k] = np.exp(activation_K * (1.0 / (temperature_degC[k] + KELVIN) - 1.0 / REFERENCE_K))
    for row in range(n_drives):
        s = own_drive[row]
        exchange_A, scale = net.exchange_A[s], slowed[slowed_of[s]]
        for k in range(size):
            drive[row, k] = current_A[k] * scale[k]
            if exchange_A != 0.0:
                drive[row, k] = np.arcsinh(drive[row, k] / exchange_A)
    return slowed, slowed_of, drive, drive_of


@njit(cache=True)
def _four_low_passes(
    net: FlatNetwork, filters: np.ndarray, which: np.ndarray, drive: np.ndarray, drive_of: np.ndarray, into: np.ndarray
) -> None:
    a, b, c, d = which[0], which[1], which[2], which[3]
    x0, x1, x2, x3 = drive[drive_of[a]], drive[drive_of[b]], drive[drive_of[c]], drive[drive_of[d]]
    p0, p1, p2, p3 = net.pole[a, 0], net.pole[b, 0], net.pole[c, 0], net.pole[d, 0]
    y0, y1, y2, y3 = filters[a, 0], filters[b, 0], filters[c, 0], filters[d, 0]
    r0, r1, r2, r3 = into[a], into[b], into[c], into[d]
    for k in range(into.shape[1]):
        y0 = p0 * y0 + (1.0 - p0) * x0[k]
        y1 = p1 * y1 + (1.0 - p1) * x1[k]
        y2 = p2 * y2 + (1.0 - p2) * x2[k]
        y3 = p3 * y3 + (1.0 - p3) * x3[k]
        r0[k], r1[k], r2[k], r3[k] = y0, y1, y2, y3
    filters[a, 0], filters[b, 0], filters[c, 0], filters[d, 0] = y0, y1, y2, y3


@njit(cache=True)
def _bent(form: int, pole: float, state: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """One low-pass, whose entry or result may be bent."""
    entry, squared, y = form & ENTRY_BITS, form & SQUARED_BIT != 0, state[0]
    for k in range(out.shape[0]):
        value = x[k]
        if entry != AS_IS:
            value = bent(entry, value)
        y = pole * y + (1.0 - pole) * value
        out[k] = y * abs(y) if squared else y
    state[0] = y


@njit(cache=True)
def _diffusion(
    net: FlatNetwork,
    s: int,
    state: np.ndarray,
    slowed: np.ndarray,
    current_A: np.ndarray,
    soc: np.ndarray,
    out: np.ndarray,
) -> None:
    """What diffuses, with the state of charge that it is ahead of or without."""
    rates, factor, emptying = net.pole[s], net.factor[s], net.exchange_A[s]
    constant = net.activation_K[s] == 0.0 and emptying == 0.0
    if emptying != 0.0:
        # What is slowed by temperature is shared with other signals.
        slowed = slowed.copy()
        for k in range(out.shape[0]):
            slowed[k] *= slower_at(emptying, soc[k])
    for k in range(out.shape[0]):
        out[k] = soc[k] if net.form[s] == SOC else 0.0
    for mode in range(3 if factor != 0.0 else 0):
        y, keep, gain = state[mode], np.exp(-rates[mode]), DIFFUSION_GAINS[mode]
        for k in range(out.shape[0]):
            if not constant:
                keep = np.exp(-rates[mode] / slowed[k])
            y = keep * y + (1.0 - keep) * gain * (current_A[k] * slowed[k])
            out[k] += factor * y
        state[mode] = y
    if net.form[s] == DIFFUSION:
        for k in range(out.shape[0]):
            out[k] = min(max(out[k], -FURTHEST_BEHIND), FURTHEST_BEHIND)


@njit(cache=True)
def _others(
    net: FlatNetwork,
    s: int,
    state: np.ndarray,
    held: np.ndarray,
    current_A: np.ndarray,
    temperature_degC: np.ndarray,
    out: np.ndarray,
) -> None:
    """Relaxation, hysteresis, direction and temperature."""
    form, before_A, direction = net.form[s], held[1], held[0]
    for k in range(out.shape[0]):
        current = current_A[k]
        if form == CASCADE:
            value = current - before_A
            for stage in range(3):
                state[stage] = net.pole[s, stage] * state[stage] + (1.0 - net.pole[s, stage]) * value
                value = state[stage]
            value /= 1.0 - net.pole[s, 0]
        elif form == LOOP:
            keep = np.exp(-net.factor[s] * abs(current))
            state[0] = keep * state[0] + (1.0 - keep) * np.sign(current)
            value = state[0]
        elif form == TEMPERATURE:
            value = within_degC(temperature_degC[k], net.pole[s, 0], net.pole[s, 1])
        elif form == INVERSE_TEMPERATURE:
            value = 1.0 / (temperature_degC[k] + KELVIN)
        else:
            if abs(current) > net.rest_A:
                direction = np.sign(current)
            value = direction
        before_A = current
        out[k] = value


# Seen through Any: the type checker takes a compiled function's arguments for those of a plain one.
make_signals: Any = _make_signals
