"""The information of an experiment written down plainly and slowly, for currents that may be complex.

Shares nothing with the compiled code but the network's document: signals, validity, output and sensitivities follow
eq. 2.1 to 2.12 of the method sample by sample, so that a complex step gives derivatives to machine precision.
"""

from __future__ import annotations

import numpy as np

from models.design.information.experiment import Experiment
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal


def information(experiment: Experiment, current_A: np.ndarray) -> np.ndarray:
    """Information matrix with its prior."""
    psi, _ = sensitivities(experiment, current_A)
    variance = (experiment.noise_V / experiment.network.voltage_span_V) ** 2
    return psi.T @ psi / variance + experiment.prior_information()


def criterion(name: str, matrix: np.ndarray) -> complex:
    """A, D or E, analytic in the matrix's entries."""
    if name == "D":
        sign, log_size = np.linalg.slogdet(matrix)
        return log_size + 1j * np.angle(sign)
    if name == "A":
        return -np.log(np.trace(np.linalg.inv(matrix)))
    values = np.linalg.eig(matrix)[0]
    return np.log(values[np.argmin(values.real)])


def complex_step_gradient(experiment: Experiment, name: str, current_A: np.ndarray, step: float = 1e-25) -> np.ndarray:
    """Derivative of a criterion to each sample of the current."""
    gradient = np.empty(len(current_A))
    for k in range(len(current_A)):
        moved = current_A.astype(complex)
        moved[k] += 1j * step
        # dJ = tr(dJ/dI dI): the eigenvalue and determinant routines see real matrices only.
        by_information = _by_information(name, information(experiment, current_A).real)
        gradient[k] = np.sum(by_information * (information(experiment, moved).imag / step))
    return gradient


def _by_information(name: str, matrix: np.ndarray) -> np.ndarray:
    if name == "D":
        return np.linalg.inv(matrix)
    if name == "A":
        inverse = np.linalg.inv(matrix)
        return inverse @ inverse / np.trace(inverse)
    values, vectors = np.linalg.eigh(matrix)
    return np.outer(vectors[:, 0], vectors[:, 0]) / values[0]


def sensitivities(experiment: Experiment, current_A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N + lead, M p) sensitivities and (N + lead,) outputs in normalised units."""
    network, lead = experiment.network, experiment.lead
    structure, order = network.structure, network.structure.output_order
    current = np.concatenate([np.zeros(lead), current_A])
    scaled = {name: _signal(network, name, current, experiment) for name in structure.signals}
    n, size = len(current), network.theta.size
    psi, y = np.zeros((n, size), current.dtype), np.zeros(n, current.dtype)
    for k in range(n):
        lags = [1 if a.signal.startswith(("soc", "surface")) else 0 for a in structure.axes]
        z = np.array([scaled[a.signal][max(k - lag, 0)] for a, lag in zip(structure.axes, lags, strict=True)])
        weight = _validity(network, z)
        taps = [scaled[signal][max(k - lag, 0)] for signal, lag in structure.taps()]
        blended = weight @ network.theta
        if k < order:
            y[k] = y[k - 1] if k else (blended[order:] @ np.array([*taps, 1.0])) / (1.0 - blended[:order].sum())
            continue
        phi = np.array([*(y[k - 1 - j] for j in range(order)), *taps, 1.0])
        y[k] = blended @ phi
        psi[k] = np.outer(weight, phi).ravel()
        if experiment.sensitivity == "free_run":
            psi[k] += sum(blended[j] * psi[k - 1 - j] for j in range(order))
    return psi, y


def _validity(network: LocalModelNetwork, z: np.ndarray) -> np.ndarray:
    if network.partition.kernel == "hat":
        return _hats(network.partition.centres[:, 0], z[0])
    away = (z - network.partition.centres) / network.partition.widths
    if network.partition.kernel == "gaussian":
        exponent = -0.5 * (away**2).sum(axis=1)
        mu = np.exp(exponent - exponent.real.max())
    else:
        size = np.where(away.real < 0, -away, away)
        mu = np.prod(np.where(size.real < 2.0, 1.0 - 0.5 * size, 0.0), axis=1)
        if mu.sum() == 0.0:
            mu[(size.real**2).sum(axis=1).argmin()] = 1.0
    return mu / mu.sum()


def _hats(knots: np.ndarray, z: complex) -> np.ndarray:
    """Each knot's own roof, which falls to 0 at its neighbours; flat beyond the ends."""
    out = np.zeros(len(knots), np.asarray(z).dtype)
    held = z if knots[0] <= z.real < knots[-1] else min(max(z.real, knots[0]), knots[-1])
    for i, knot in enumerate(knots):
        if i > 0 and knots[i - 1] <= held.real < knot:
            out[i] = (held - knots[i - 1]) / (knot - knots[i - 1])
        elif i + 1 < len(knots) and knot <= held.real < knots[i + 1]:
            out[i] = (knots[i + 1] - held) / (knots[i + 1] - knot)
    if held.real == knots[-1]:
        out[-1] = 1.0
    return out


def _signal(network: LocalModelNetwork, name: str, current: np.ndarray, experiment: Experiment) -> np.ndarray:
    low, high = network.scaling[name]
    signal, dt_s = parse_signal(name), network.structure.dt_s
    capacity_Ah = network.cell.capacity_Ah
    per_A = dt_s / 3600.0 / capacity_Ah
    soc = experiment.initial_soc + np.concatenate([[0.0], np.cumsum(current[1:])]) * per_A
    kelvin = np.full(len(current), experiment.temperature_degC + 273.15)
    tau = signal.get("time_constant_s")
    slowed = np.exp(signal.get("activation_K") * (1.0 / kelvin - 1.0 / 298.15))
    x = current * slowed
    if signal.kind == "charge_transfer":
        x = np.arcsinh(x / signal.get("exchange_current_A"))
    # Kept at that of empty below it; nothing but the real part decides.
    slower = 1.0 + signal.get("emptying") * np.exp(-np.where(soc.real > 0.0, soc, 0.0) / 0.12)
    depth_per_A = signal.get("depth") / capacity_Ah
    filtered = _low_pass(x, np.exp(-dt_s / tau)) if tau else x
    values = {
        "soc": lambda: soc,
        "surface_soc": lambda: soc + depth_per_A * _sphere(x * slower, tau, slowed * slower, dt_s),
        "squared_current": lambda: np.where(filtered.real < 0, -filtered, filtered) * filtered,
        "temperature": lambda: kelvin - 273.15,
        "inverse_temperature": lambda: 1.0 / kelvin,
        "hysteresis": lambda: _held(current, network.cell.rest_A),
        "hysteresis_state": lambda: _state(current, signal.get("rate") * per_A),
        "relaxation": lambda: _relaxation(current, tau, dt_s),
    }.get(signal.kind, lambda: filtered)()
    return (values - low) / (high - low)


def _low_pass(x: np.ndarray, pole: float | np.ndarray) -> np.ndarray:
    poles = np.broadcast_to(pole, x.shape)
    out, state = np.empty_like(x), 0.0
    for k, value in enumerate(x):
        state = poles[k] * state + (1.0 - poles[k]) * value
        out[k] = state
    return out


def _sphere(x: np.ndarray, tau: float, slowed: np.ndarray, dt_s: float) -> np.ndarray:
    """First three modes of diffusion in a sphere, roots of tan(x) = x, with unit gain."""
    roots = np.array([4.493409457909064, 7.725251836937707, 10.904121659428899])
    gains = roots**-2.0 / (roots**-2.0).sum()
    rates = dt_s / tau * (roots / roots[0]) ** 2
    return sum(gain * _low_pass(x, np.exp(-rate / slowed)) for gain, rate in zip(gains, rates, strict=True))


def _relaxation(current: np.ndarray, tau: float, dt_s: float) -> np.ndarray:
    out = np.concatenate([[0.0], np.diff(current)])
    for share in (1.0, 0.002, 0.002):
        out = _low_pass(out, np.exp(-dt_s / (tau * share)))
    return out / (1.0 - np.exp(-dt_s / tau))


def _held(current: np.ndarray, rest_A: float) -> np.ndarray:
    out, held = np.empty(len(current)), -1.0
    for k, value in enumerate(current.real):
        held = np.sign(value) if abs(value) > rest_A else held
        out[k] = held
    return out


def _state(current: np.ndarray, rate: float) -> np.ndarray:
    out, state = np.empty_like(current), 0.0
    for k, value in enumerate(current):
        sign = np.sign(value.real)
        keep = np.exp(-rate * sign * value)
        state = keep * state + (1.0 - keep) * sign
        out[k] = state
    return out
