"""Signals derived from what a bench measures: state of charge, hysteresis, relaxation and their kin.

Over whole runs (arrays) here; sample by sample in `observer.compiled`, which a test holds against this file.
A signal is named "kind" or "kind:p1/p2/...", for example "low_pass:600" or "surface_soc:0.05/400/3500".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from models.data.errors import StructureError
from models.data.timeseries import FloatArray

# Below this share of 1C a current counts as rest: sensors read a few mA at rest, which is no change of direction.
REST_C_RATE = 0.005
KELVIN = 273.15
REFERENCE_K = 298.15

# Kind -> names of its parameters; those after "|" may be left out and are then 0.
_KINDS: dict[str, tuple[tuple[str, ...], int]] = {
    "soc": ((), 0),
    "current": ((), 0),
    "temperature": ((), 0),
    "inverse_temperature": ((), 0),
    "hysteresis": ((), 0),
    "hysteresis_state": (("rate",), 1),
    "relaxation": (("time_constant_s",), 1),
    "low_pass": (("time_constant_s", "activation_K"), 1),
    "scaled_current": (("activation_K",), 1),
    "charge_transfer": (("exchange_current_A", "activation_K", "time_constant_s"), 1),
    "squared_current": (("time_constant_s", "activation_K"), 1),
    "surface_soc": (("depth", "time_constant_s", "activation_K"), 2),
}
_POSITIVE = ("rate", "time_constant_s", "exchange_current_A")


@dataclass(frozen=True)
class Signal:
    """One parsed signal name.

    Attributes
    ----------
    kind : one of the known kinds
    parameters : by name; those left out are 0
    """

    kind: str
    parameters: dict[str, float]

    def get(self, name: str) -> float:
        """Value of a parameter; 0 where the kind has none of that name."""
        return self.parameters.get(name, 0.0)


@dataclass(frozen=True)
class RunSignals:
    """What signals of one run are made from, evenly spaced.

    Attributes
    ----------
    current_A, temperature_degC, soc : (n,)
    dt_s : sampling time
    capacity_Ah : cell capacity
    """

    current_A: FloatArray
    temperature_degC: FloatArray
    soc: FloatArray
    dt_s: float
    capacity_Ah: float

    def values(self, name: str) -> FloatArray:
        """(n,) values of a named signal in its physical unit."""
        signal = parse_signal(name)
        kind = signal.kind
        if kind == "soc":
            return self.soc
        if kind == "temperature":
            return self._temperature(name)
        if kind == "inverse_temperature":
            return 1.0 / (self._temperature(name) + KELVIN)
        if kind == "hysteresis":
            return held_sign(self.current_A, REST_C_RATE * self.capacity_Ah)
        if kind == "hysteresis_state":
            return hysteresis_state(self.current_A, signal.get("rate"), self.dt_s, self.capacity_Ah)
        if kind == "relaxation":
            return relaxation(self.current_A, signal.get("time_constant_s"), self.dt_s)
        return self._filtered(name, signal)

    def _filtered(self, name: str, signal: Signal) -> FloatArray:
        """Current, scaled by temperature where asked, through asinh where asked, then a first-order low-pass."""
        x = self.current_A
        slowed = np.ones(1)
        if signal.get("activation_K"):
            slowed = arrhenius(self._temperature(name), signal.get("activation_K"))
            x = x * slowed
        if signal.kind == "surface_soc":
            shift = diffusion(x, signal.get("time_constant_s"), slowed, self.dt_s)
            return self.soc + signal.get("depth") * shift / self.capacity_Ah
        if signal.kind == "charge_transfer":
            x = np.arcsinh(x / signal.get("exchange_current_A"))
        if signal.get("time_constant_s"):
            x = low_pass(x, signal.get("time_constant_s"), self.dt_s)
        return x * np.abs(x) if signal.kind == "squared_current" else x

    def _temperature(self, name: str) -> FloatArray:
        if np.isnan(self.temperature_degC).all():
            raise StructureError(f"signal {name!r} needs a temperature, but none was measured")
        return self.temperature_degC


def parse_signal(name: str) -> Signal:
    """Take a signal's name apart.

    Raises
    ------
    StructureError
        Unknown kind, parameters missing, too many, not finite, or not positive where they must be.
    """
    kind, _, text = name.partition(":")
    if kind not in _KINDS:
        raise StructureError(f"signal {name!r} is unknown; known are {', '.join(_KINDS)}")
    names, required = _KINDS[kind]
    try:
        values = [float(part) for part in text.split("/")] if text else []
    except ValueError:
        raise StructureError(f"signal {name!r}: {text!r} is not a list of numbers") from None
    if not required <= len(values) <= len(names):
        raise StructureError(f"signal {name!r}: {kind} takes {'/'.join(names) or 'no parameters'}")
    parameters = dict(zip(names, values, strict=False))
    for key, value in parameters.items():
        optional_zero = value == 0.0 and names.index(key) >= required
        if not np.isfinite(value) or (key in _POSITIVE and not value > 0.0 and not optional_zero):
            raise StructureError(f"signal {name!r}: {key} is {value:g}; it must be positive")
    return Signal(kind, parameters)


def is_soc(name: str) -> bool:
    """Whether a signal is the state of charge plus something that does not depend on it."""
    return name.partition(":")[0] in ("soc", "surface_soc")


def soc_by_counting(
    charge_Ah: FloatArray, initial_soc: float, capacity_Ah: float, efficiency: float = 1.0
) -> FloatArray:
    """State of charge from counted charge.

    Parameters
    ----------
    charge_Ah : (n,) charge counted from the start, positive: charged
    initial_soc : fraction 0..1
    capacity_Ah : cell capacity in Ah
    efficiency : coulombic efficiency that applies to charging

    Returns
    -------
    (n,) fraction

    Notes
    -----
    Unger, Kozek, Jakubek, "Energy Efficient Non-Road Hybrid Electric Vehicles", ch. 2, eq. 2.32 and 2.33.
    """
    if efficiency == 1.0:
        return initial_soc + charge_Ah / capacity_Ah
    step = np.diff(charge_Ah, prepend=charge_Ah[0])
    return initial_soc + np.cumsum(np.where(step > 0, efficiency * step, step)) / capacity_Ah


def held_sign(current_A: FloatArray, rest_A: float, initial: float = -1.0) -> FloatArray:
    """Direction of the last current: +1 after charge, -1 after discharge, held through rests.

    Parameters
    ----------
    current_A : (n,)
    rest_A : magnitudes up to this count as rest
    initial : value before the first current; a cell that was charged and then rested is about to be discharged

    Notes
    -----
    The hysteresis input z_Hyst of the method (ch. 2.2.3.1).
    """
    sign = np.where(current_A > rest_A, 1.0, np.where(current_A < -rest_A, -1.0, 0.0))
    index = np.maximum.accumulate(np.where(sign != 0.0, np.arange(len(sign)), -1))
    return np.where(index >= 0, sign[np.maximum(index, 0)], initial)


def hysteresis_state(current_A: FloatArray, rate: float, dt_s: float, capacity_Ah: float) -> FloatArray:
    """One-state hysteresis between -1 and 1: it follows the current's direction with the charge that flows.

    h(k) = e h(k-1) + (1 - e) sign(I(k)) with e = exp(-rate |I(k)| dt / Q), starting at 0.

    Notes
    -----
    Plett, "Battery Management Systems I", 2015, ch. 2.
    """
    keep = np.exp(-rate * np.abs(current_A) * dt_s / (3600.0 * capacity_Ah))
    return _first_order(keep, (1.0 - keep) * np.sign(current_A))


@njit(cache=True)
def _first_order(keep: np.ndarray, drive: np.ndarray) -> np.ndarray:
    out = np.empty(keep.shape[0])
    state = 0.0
    for k in range(keep.shape[0]):
        state = keep[k] * state + drive[k]
        out[k] = state
    return out


def arrhenius(temperature_degC: FloatArray, activation_K: float) -> FloatArray:
    """exp(activation (1/T - 1/298.15 K)): how much larger a resistance is than at 25 degC."""
    return np.exp(activation_K * (1.0 / (temperature_degC + KELVIN) - 1.0 / REFERENCE_K))


# Time constants of the three stages of the relaxation filter over the slowest of them: the slowest is the relaxation
# itself, the others only round off the step's edge.
_RELAXATION_STAGES = (1.0, 0.002, 0.002)


def relaxation_poles(time_constant_s: float, dt_s: float) -> FloatArray:
    """(3,) poles of the relaxation filter's stages at sampling time `dt_s`."""
    return np.exp(-dt_s / (time_constant_s * np.array(_RELAXATION_STAGES)))


def relaxation(current_A: FloatArray, time_constant_s: float, dt_s: float) -> FloatArray:
    """Third-order low-pass of the current's change: zero at rest and at constant current, non-zero in between.

    After a step of the current it rises to the step's height and dies out with `time_constant_s`. It is scaled by
    time_constant_s / dt_s, which makes it independent of the sampling time.

    Parameters
    ----------
    current_A : (n,) in A
    time_constant_s : in s
    dt_s : sampling time in s

    Returns
    -------
    (n,) in A

    Notes
    -----
    Eq. 2.7 of the method; third order and time constant from the voltage's return after pulses, after Unger et al.
    2014. Three equal stages would rise only after about the time constant itself, which no pulse test shows: with them
    a simulated cell was fitted to 5 mV, with quick second and third stages to 2.5 mV.
    """
    change = np.diff(current_A, prepend=current_A[:1])
    poles = relaxation_poles(time_constant_s, dt_s)
    from scipy.signal import lfilter  # 700 ms of processor time, which a control process without a model saves

    for pole in poles:
        change = lfilter([1.0 - pole], [1.0, -pole], change)
    return np.asarray(change, dtype=np.float64) / (1.0 - poles[0])


def low_pass(values: FloatArray, time_constant_s: float, dt_s: float) -> FloatArray:
    """First-order low-pass with unit gain, starting at rest: of a current, one RC pair's current in A."""
    from scipy.signal import lfilter  # as above

    pole = float(np.exp(-dt_s / time_constant_s))
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], values), dtype=np.float64)


# Roots of tan(x) = x: the modes in which concentration evens out in a sphere, slowest first. Of their infinite number
# three hold 84 % of the settled difference; the rest is quicker than a sample of 1 s and acts as a resistance.
_DIFFUSION_ROOTS = np.array([4.493409458, 7.725251837, 10.904121659])
DIFFUSION_GAINS = _DIFFUSION_ROOTS**-2.0 / float(np.sum(_DIFFUSION_ROOTS**-2.0))


def diffusion_rates(time_constant_s: float, dt_s: float) -> FloatArray:
    """(3,) samples' length over the time constants of the diffusion modes at 25 degC."""
    return dt_s / time_constant_s * (_DIFFUSION_ROOTS / _DIFFUSION_ROOTS[0]) ** 2


def diffusion(values: FloatArray, time_constant_s: float, slowed: FloatArray, dt_s: float) -> FloatArray:
    """Low-pass of unit gain with the modes of diffusion in a sphere, starting at rest.

    Parameters
    ----------
    values : (n,) what flows in
    time_constant_s : of the slowest mode at 25 degC
    slowed : (n,) or (1,) factor by which the time constants are longer at each sample's temperature
    dt_s : sampling time in s

    Returns
    -------
    (n,) difference between surface and mean, in the values' unit

    Notes
    -----
    Crank, "The Mathematics of Diffusion", 1975, eq. 6.45: the modes' settled shares go with the inverse squared roots,
    their time constants too. A slower diffusion has a larger settled difference and a longer way to it, both alike.
    """
    rates = diffusion_rates(time_constant_s, dt_s)
    return _diffusion(values, rates, DIFFUSION_GAINS, np.broadcast_to(slowed, values.shape))


@njit(cache=True)
def _diffusion(values: np.ndarray, rates: np.ndarray, gains: np.ndarray, slowed: np.ndarray) -> np.ndarray:
    out = np.empty(values.shape[0])
    modes = np.zeros(rates.shape[0])
    for k in range(values.shape[0]):
        total = 0.0
        for i in range(rates.shape[0]):
            keep = np.exp(-rates[i] / slowed[k])
            modes[i] = keep * modes[i] + (1.0 - keep) * gains[i] * values[k]
            total += modes[i]
        out[k] = total
    return out
