"""What the parameters of a live network may be at all: the covariance that the recursion falls back to."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.network.compiled_network import flat_network
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import normalise
from models.network.signals import Held, is_soc, parse_signal
from models.network.signals.loop_form import DIFFUSION, LOOP, is_overpotential
from models.recursive.settings import UpdateSettings
from models.recursive.update_step import FlatUpdate

# Standard deviations that a parameter may move away from where it began.
_REACH = 10.0
# A tap is taken to be at least this share of all taps of the current.
_LEAST_SHARE = 0.1
_USUAL_DEGC = 25.0


def update_rule(network: LocalModelNetwork, settings: UpdateSettings) -> FlatUpdate:
    """What the recursion knows beforehand: prior, range of each parameter, noise and forgetting."""
    at = _middle(network)
    n_models, p = network.theta.shape
    prior = np.zeros((n_models, p, p))
    for i in range(n_models):
        directions = _directions(network, settings, i)
        # Whatever a parameter does, the settled voltage in the middle of the local model at rest stays: the offset
        # takes it back. What is left to the offset itself is the open-circuit voltage's own spread.
        directions[-1, :-1] -= at[i, :-1] @ directions[:-1, :-1]
        prior[i] = directions @ directions.T
    reach = _REACH * np.sqrt(np.einsum("ipp->ip", prior))
    forgetting = 1.0 - float(np.exp(-network.structure.dt_s / settings.memory_s))
    theta = network.theta
    noise = (_noise_V(network, settings) / network.voltage_span_V) ** 2
    low = theta - reach
    rest_low, rest_high = np.full(n_models, -np.inf), np.full(n_models, np.inf)
    if network.structure.kernel == "hat":
        low = np.where(_of_current(network) & (theta >= 0.0), np.maximum(low, 0.0), low)
        rest_low, rest_high = _between_neighbours(np.einsum("ip,ip->i", theta, at))
    return FlatUpdate(prior, low, theta + reach, noise, forgetting, at, rest_low, rest_high)


def _of_current(network: LocalModelNetwork) -> np.ndarray:
    """(p,) whether a parameter multiplies what a current does: of hats it keeps its sign."""
    net = flat_network(network)
    codes = net.form[net.tap_signal].tolist()
    past = [False] * network.structure.output_order
    return np.array([*past, *(is_overpotential(code) or code in (LOOP, DIFFUSION) for code in codes), False])


def _between_neighbours(rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range of the output at rest at each knot, (M,) each: halfway to its neighbours where the curve rises.

    Knots may lie closer together than the open-circuit voltage is known; each moving by itself, the curve could fall.
    """
    halfway = 0.5 * (rest[1:] + rest[:-1])
    rises = rest[1:] > rest[:-1]
    low = np.concatenate([[-np.inf], np.where(rises, halfway, -np.inf)])
    return low, np.concatenate([np.where(rises, halfway, np.inf), [np.inf]])


def _noise_V(network: LocalModelNetwork, settings: UpdateSettings) -> float:
    """Standard deviation of what one sample says, where errors of neighbouring samples are alike."""
    rmse_mV = network.record.train_rmse_mV(10.0)
    voltage_V = settings.voltage_std_V or 1e-3 * max(rmse_mV, 1.0)
    return voltage_V * float(np.sqrt(1.0 + 2.0 * settings.error_memory_s / network.structure.dt_s))


def _distance(network: LocalModelNetwork) -> FloatArray:
    """(M,) how far each local model is from an integrator: 1 - sum of its output coefficients."""
    return np.maximum(1.0 - network.theta[:, : network.structure.output_order].sum(axis=1), 1e-3)


def _middle(network: LocalModelNetwork) -> FloatArray:
    """(M, p) regressors in the middle of each local model, at rest and settled."""
    structure, theta = network.structure, network.theta
    if structure.kernel == "hat":
        return _at_knots(network)
    order = structure.output_order
    at = np.ones_like(theta)
    for column, (signal, _) in enumerate(structure.taps(), start=order):
        if parse_signal(signal).definition.as_resistance:
            at[:, column] = normalise(np.zeros(1), network.scaling[signal])[0]
        elif is_soc(signal) and structure.soc_axis >= 0:
            at[:, column] = network.partition.centres[:, structure.soc_axis]
        else:
            at[:, column] = 0.5
    settled = np.einsum("ip,ip->i", theta[:, order:], at[:, order:]) / _distance(network)
    at[:, :order] = settled[:, None]
    return at


def _at_knots(network: LocalModelNetwork) -> FloatArray:
    """(M, p) regressors at the knots of hats, at rest, between the branches of hysteresis."""
    low, high = network.scaling[network.structure.axes[0].signal]
    soc = low + (high - low) * network.partition.centres[:, 0]
    degC = network.record.domain.get("temperature_degC", (_USUAL_DEGC, _USUAL_DEGC))
    rest = np.zeros(len(soc))
    held = Held(rest, np.full(len(soc), float(np.mean(degC))), soc, rest, network.cell.capacity_Ah)
    parsed = [parse_signal(signal) for signal, _ in network.structure.taps()]
    columns = [normalise(each.definition.settled(each, held), network.scaling[each.name]) for each in parsed]
    return np.column_stack([*columns, np.ones(len(soc))])


def _directions(network: LocalModelNetwork, settings: UpdateSettings, i: int) -> FloatArray:
    """(p, p) columns: independent changes of local model i, each of one standard deviation.

    With past outputs a change of one tap of the current acts through the recursion: a cell whose ohmic resistance grows
    moves several taps at once, tap j by R and tap j + l by -a_l R. Where there are taps enough, that is the direction.
    """
    structure, theta = network.structure, network.theta[i]
    order, taps = structure.output_order, structure.taps()
    distance = float(_distance(network)[i])
    current = [order + t for t, (signal, _) in enumerate(taps) if parse_signal(signal).definition.as_resistance]
    settled = float(np.abs(theta[current]).sum()) if order == 0 else abs(float(theta[current].sum()))
    out = np.zeros((len(theta), len(theta)))
    out[:order, :order] = np.eye(order) * settings.pole_std * distance
    for column, (signal, _) in enumerate(taps, start=order):
        own = column + np.arange(order + 1)
        room = column + order < len(theta) - 1 and all(taps[c - order][0] == signal for c in own)
        if column not in current:
            out[column, column] = settings.slope_std * abs(theta[column])
        elif order > 0 and room:
            size = max(abs(theta[column]), _LEAST_SHARE * settled / distance)
            out[own, column] = settings.resistance_std * size * np.concatenate([[1.0], -theta[:order]])
        else:
            size = max(abs(theta[column]) if order == 0 else 0.0, _LEAST_SHARE * settled if order == 0 else settled)
            out[column, column] = settings.resistance_std * size
    out[-1, -1] = settings.ocv_std_V / network.voltage_span_V * distance
    return out
