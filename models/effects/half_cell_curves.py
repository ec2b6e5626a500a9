"""Published open-circuit potentials of electrodes over lithium, in V over their filling."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from models.data.timeseries import FloatArray

# Rise of a graphite's potential below empty, V per filling, where its formula would rise out of all bounds.
_STEEP_V = 30.0


@dataclass(frozen=True)
class PositiveCurve:
    """Potential of a positive electrode.

    Attributes
    ----------
    low, high : fillings between which the formula holds
    usual : fillings of an empty and of a full cell
    potential_V : (n,) fillings -> (n,)
    """

    low: float
    high: float
    usual: tuple[float, float]
    potential_V: Callable[[FloatArray], FloatArray]


def _from_empty(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n,) fillings from empty on, and (n,) V by which a potential that is steep there goes on rising below."""
    return np.maximum(x, 0.0), _STEEP_V * np.maximum(-x, 0.0)


def _graphite(x: FloatArray) -> FloatArray:
    """Graphite (Mohtat et al., J. Electrochem. Soc. 167, 2020, 110561)."""
    x = np.maximum(x, -0.05)
    stages = ((0.0120, 0.127, 0.016), (0.0118, 0.155, 0.016), (0.0035, 0.220, 0.020), (0.0095, 0.190, 0.013))
    more = ((0.0145, 0.490, 0.020), (0.0800, 1.030, 0.055))
    return 0.063 + 0.8 * np.exp(-75.0 * (x + 0.007)) - sum(h * np.tanh((x - c) / w) for h, c, w in (*stages, *more))


def _graphite_silicon(x: FloatArray) -> FloatArray:
    """Graphite with some silicon oxide of the LG M50 (Chen et al., J. Electrochem. Soc. 167, 2020, 080534)."""
    x = np.maximum(x, -0.05)
    steps = ((0.0909, 29.8538, 0.1234), (0.04478, 14.9159, 0.2769), (0.0205, 30.4444, 0.6103))
    return 1.9793 * np.exp(-39.3631 * x) + 0.2482 - sum(h * np.tanh(k * (x - c)) for h, k, c in steps)


def _mesocarbon(x: FloatArray) -> FloatArray:
    """Mesocarbon microbeads (Doyle, Newman et al., Dualfoil 1998; Marquis et al., J. Electrochem. Soc. 166, 2019)."""
    x, steep_V = _from_empty(x)
    rises = ((0.0351, 0.286, 0.083), (0.0155, 0.105, 0.029), (-0.0045, 0.849, 0.119), (-0.035, 0.9233, 0.05))
    more = ((-0.0147, 0.5, 0.034), (-0.102, 0.194, 0.142), (-0.022, 0.9, 0.0164), (-0.011, 0.124, 0.0226))
    # As printed it rises by 10 uV around 0.32; no electrode does.
    steep_V = steep_V - 0.004 * (x - 0.32)
    return steep_V + 0.194 + 1.5 * np.exp(-120.0 * x) + sum(h * np.tanh((x - c) / w) for h, c, w in (*rises, *more))


def _graphite_pouch(x: FloatArray) -> FloatArray:
    """Graphite of a 7.5 Ah pouch cell (Ecker et al., J. Electrochem. Soc. 162, 2015, A1836)."""
    x, steep_V = _from_empty(x)
    steps = ((0.0189193, 21.1967, 0.196176), (0.0169644, 27.1365, 0.312832), (0.0199313, 28.5697, 0.614221))
    ends = 0.716502 * np.exp(-369.028 * x) + 0.12193 * np.exp(-35.6478 * (x - 0.0530947))
    full = 0.931153 * np.exp(36.328 * (np.minimum(x, 1.02) - 1.10743))
    return steep_V + 0.140031 + ends - full - sum(h * np.tanh(k * (x - c)) for h, k, c in steps)


def _graphite_nca(x: FloatArray) -> FloatArray:
    """Graphite beside oxide of nickel, cobalt and aluminium (Kim et al., J. Electrochem. Soc. 158, 2011, A955)."""
    x, steep_V = _from_empty(x)
    falls = ((0.0351, 0.286, 0.083), (0.0045, 0.9, 0.119), (0.035, 0.99, 0.05), (0.0147, 0.5, 0.034))
    more = ((0.102, 0.194, 0.142), (0.022, 0.98, 0.0164), (0.011, 0.124, 0.0226), (-0.0155, 0.105, 0.029))
    return steep_V + 0.124 + 1.5 * np.exp(-70.0 * x) - sum(h * np.tanh((x - c) / w) for h, c, w in (*falls, *more))


def _nmc811(y: FloatArray) -> FloatArray:
    """Nickel-rich oxide of the LG M50 (Chen et al. 2020)."""
    steps = ((-0.0428, 18.5138, 0.5542), (-17.7326, 15.7890, 0.3117), (17.5842, 15.9308, 0.3120))
    return 4.4875 - 0.8090 * y + sum(h * np.tanh(k * (y - c)) for h, k, c in steps)


def _nmc532(y: FloatArray) -> FloatArray:
    """Layered oxide of nickel, manganese and cobalt (Mohtat et al. 2020)."""
    power = np.polynomial.Polynomial([4.3452, -1.6518, 1.6225, -2.0843, 3.5146, -2.2166])
    return power(y) - 0.5623e-4 * np.exp(109.451 * y - 100.006)


def _nca(y: FloatArray) -> FloatArray:
    """Oxide of nickel, cobalt and aluminium (Kim et al., J. Electrochem. Soc. 158, 2011, A955)."""
    power = np.polynomial.Polynomial(
        [11.8058, -66.3691, 264.427, -554.774, 621.3475, -344.566, 81.246, -23.488, 15.056, -2.222, 1.638]
    )
    return power(y) - 0.61386 * np.exp(5.8201 * y**136.4)


def _cobalt(y: FloatArray) -> FloatArray:
    """Oxide of cobalt (Doyle, Newman et al., Dualfoil 1998; Marquis et al. 2019)."""
    y = 1.062 * y
    steps = ((0.07645, 30.834, 54.4806), (2.1581, 52.294, 50.294), (-0.14169, 11.0923, 19.8543))
    more = ((0.2051, 1.4684, 5.4888), (0.2531, 0.56478 / 0.1316, 1.0 / 0.1316), (0.02167, 0.525 / 0.006, 1.0 / 0.006))
    return np.full_like(y, 2.16216) + sum(h * np.tanh(a - b * y) for h, a, b in (*steps, *more))


def _nickel_cobalt(y: FloatArray) -> FloatArray:
    """Oxide of nickel and cobalt of a 7.5 Ah pouch cell (Ecker et al. 2015)."""
    steps = ((0.0747061, 31.886, 0.0219921), (-6.34984, 2.66395, 0.174352), (0.640243, 5.48623, 0.439245))
    more = ((3.82383, 4.12167, 0.176187), (0.0542123, 18.2919, 0.762272))
    return 4.23285 - 2.35211 * y - sum(h * np.tanh(k * (y - c)) for h, k, c in (*steps, *more))


def _olivine(y: FloatArray) -> FloatArray:
    """Iron phosphate (Afshar, Morris and Khajepour, arXiv:1709.03970, 2017)."""
    return 3.4077 - 0.020269 * y + 0.5 * np.exp(-150.0 * y) - 0.9 * np.exp(-30.0 * (1.0 - y))


NEGATIVES: MappingProxyType[str, Callable[[FloatArray], FloatArray]] = MappingProxyType(
    {
        "graphite": _graphite,
        "graphite-silicon": _graphite_silicon,
        "mesocarbon": _mesocarbon,
        "graphite-pouch": _graphite_pouch,
        "graphite-nca": _graphite_nca,
    }
)
POSITIVES: MappingProxyType[str, PositiveCurve] = MappingProxyType(
    {
        "nmc811": PositiveCurve(0.2, 0.98, (0.9, 0.27), _nmc811),
        "nmc532": PositiveCurve(0.0, 0.97, (0.9, 0.25), _nmc532),
        "nca": PositiveCurve(0.3, 0.987, (0.93, 0.42), _nca),
        "cobalt": PositiveCurve(0.4, 0.975, (0.95, 0.5), _cobalt),
        "nickel-cobalt": PositiveCurve(0.1, 0.98, (0.9, 0.3), _nickel_cobalt),
        "olivine": PositiveCurve(0.005, 0.995, (0.95, 0.05), _olivine),
    }
)
