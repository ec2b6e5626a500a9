"""The settled voltage of a network: all signals held, all dynamics died out; exact, with its gradient.

With all signals held, the past outputs equal the present one, so the blended local model (eq. 2.1 to 2.4 of the method)
gives y = (sum_j b_j u_j + c) / (1 - a_1 - ... - a_n), which is read back in volts by undoing the normalisation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.network.regression import normalise
from models.network.signals import Held, parse_signal
from models.network.structure import Structure
from models.uncertainty.spread import LocalFactor, gradient_variance

# A trained range narrower than this is one temperature: sensors and self-heating move it by as much.
_ONE_TEMPERATURE_K = 2.0
_FALLBACK_DEGC = 25.0


@dataclass(frozen=True)
class OperatingPoints:
    """Where a network is read out; all arrays of one length.

    Attributes
    ----------
    soc : (n,) fraction
    current_A : (n,) held current, positive charges
    direction : (n,) +1 after charge, -1 after discharge
    temperature_degC : (n,)
    """

    soc: FloatArray
    current_A: FloatArray
    direction: FloatArray
    temperature_degC: FloatArray

    @classmethod
    def grid(
        cls, soc: ArrayLike, current_A: ArrayLike, direction: ArrayLike, temperature_degC: ArrayLike
    ) -> OperatingPoints:
        """Broadcast the four against each other and flatten them (last axis fastest)."""
        arrays = np.broadcast_arrays(
            *(np.asarray(a, np.float64) for a in (soc, current_A, direction, temperature_degC))
        )
        return cls(*(np.ascontiguousarray(a).ravel() for a in arrays))


@dataclass(frozen=True)
class SettledVoltage:
    """Settled voltages.

    Attributes
    ----------
    voltage_V : (n,) NaN where the blended local model does not settle
    gradient_V : (n, M p) derivatives to the network's parameters (normalised units), as `theta.ravel()` orders them
    """

    voltage_V: FloatArray
    gradient_V: FloatArray


def settled_voltage(network: LocalModelNetwork, points: OperatingPoints) -> SettledVoltage:
    """Voltage that the network reaches when everything is held, and its gradient.

    Parameters
    ----------
    network : any output order and inputs
    points : n operating points

    Returns
    -------
    SettledVoltage
    """
    order = network.structure.output_order
    u, z = settled_regressors(network, points)
    validity = network.partition.validity(z)
    blended = validity @ network.theta
    poles_sum = blended[:, :order].sum(axis=1)
    settles = _settles(blended[:, :order])
    gain = np.where(settles, 1.0 / np.where(settles, 1.0 - poles_sum, 1.0), np.nan)
    y = gain * np.einsum("kp,kp->k", blended[:, order:], u)
    phi = np.hstack([np.repeat(y[:, None], order, axis=1), u]) * gain[:, None]
    gradient = np.einsum("km,kp->kmp", validity, phi).reshape(len(y), -1)
    return SettledVoltage(network.to_volts(y), network.voltage_span_V * gradient)


def settled_regressors(network: LocalModelNetwork, points: OperatingPoints) -> tuple[FloatArray, FloatArray]:
    """(n, q + 1) normalised input taps with a last column of ones, and (n, axes) normalised partition variables."""
    structure = network.structure
    held = Held(points.current_A, points.temperature_degC, points.soc, points.direction, network.cell.capacity_Ah)
    parsed = [parse_signal(name) for name in structure.signals]
    value = {each.name: normalise(each.definition.settled(each, held), network.scaling[each.name]) for each in parsed}
    columns = [value[signal] for signal, _ in structure.taps()]
    u = np.column_stack([*columns, np.ones(len(points.soc))])
    z = np.column_stack([value[axis.signal] for axis in structure.axes])
    return u, z


def standard_deviation(gradient: FloatArray, local: LocalFactor) -> FloatArray:
    """(n,) standard deviations by the delta method from (n, M p) gradients and the covariance's factor.

    Raises
    ------
    ModelError
        The factor does not fit the parameters.
    """
    size = gradient.shape[1]
    if local.factor.shape[0] != size:
        raise ModelError(
            f"the factor of the parameters' covariance has shape {local.factor.shape}; the network needs {size} rows"
        )
    return np.sqrt(gradient_variance(local, gradient))


def soc_axis(network: LocalModelNetwork, n: int = 51) -> FloatArray:
    """(n,) SoC over the trained range."""
    return np.linspace(*_trained(network, "soc", "soc", (0.0, 1.0)), n)


def temperature_axis(network: LocalModelNetwork, n: int = 5) -> FloatArray:
    """Temperatures in degC over the trained range: `n` of them, or one where the network cannot tell them apart."""
    low, high = _trained(network, "temperature_degC", "temperature", (_FALLBACK_DEGC, _FALLBACK_DEGC))
    if high - low < _ONE_TEMPERATURE_K or not depends_on_temperature(network.structure):
        return np.array([0.5 * (low + high)])
    return np.linspace(low, high, n)


def current_axis(network: LocalModelNetwork, per_direction: int = 4) -> FloatArray:
    """Currents in A of both signs, without zero, from the largest trained one down by halves."""
    low, high = _trained(network, "current_A", "current", (-network.cell.capacity_Ah, network.cell.capacity_Ah))
    halves = 0.5 ** np.arange(per_direction)
    return np.concatenate([low * halves if low < 0.0 else [], (high * halves)[::-1] if high > 0.0 else []])


def depends_on_temperature(structure: Structure) -> bool:
    """Whether a network of this structure can tell temperatures apart."""
    return any(parse_signal(name).depends_on_temperature for name in structure.signals)


def outside_domain(network: LocalModelNetwork, values: dict[str, FloatArray]) -> np.ndarray:
    """(n,) whether each point lies outside the ranges of the training runs.

    Parameters
    ----------
    network : its record holds the ranges
    values : (n,) arrays by the names that the record's domain uses: soc, current_A, temperature_degC
    """
    outside = np.zeros(len(next(iter(values.values()))), dtype=bool)
    for name, (low, high) in network.record.domain.items():
        if name in values:
            outside |= _beyond(values[name], low, high)
    return outside


def outside_reservations(network: LocalModelNetwork, axes: dict[str, FloatArray]) -> list[str]:
    """Name the axes of a read-out that reach beyond the ranges of the training runs."""
    found = []
    for name, (low, high) in network.record.domain.items():
        axis = axes.get(name)
        if axis is None or (name == "temperature_degC" and not depends_on_temperature(network.structure)):
            continue
        if _beyond(axis, low, high).any():
            found.append(
                f"read out at {name} {axis.min():g}..{axis.max():g}; the training runs cover {low:g}..{high:g} only"
            )
    return found


def _beyond(values: FloatArray, low: float, high: float) -> np.ndarray:
    # Half a percent of the range: sensor noise at the edge is not a new operating point.
    slack = 0.005 * (high - low)
    return (values < low - slack) | (values > high + slack)


def _settles(a: FloatArray) -> np.ndarray:
    """Whether each row of output coefficients has its poles inside the unit circle (orders 0, 1, 2)."""
    if a.shape[1] == 0:
        return np.ones(len(a), dtype=bool)
    if a.shape[1] == 1:
        return np.abs(a[:, 0]) < 1.0
    return (np.abs(a[:, 1]) < 1.0) & (1.0 - a[:, 0] - a[:, 1] > 0.0) & (1.0 + a[:, 0] - a[:, 1] > 0.0)


def _trained(network: LocalModelNetwork, name: str, signal: str, fallback: tuple[float, float]) -> tuple[float, float]:
    """Range of a quantity in the training runs: as recorded, else as the signal was normalised."""
    low, high = network.record.domain.get(name) or network.scaled_over(signal) or fallback
    return float(low), float(high)
