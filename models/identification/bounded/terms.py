"""What a bounded network's voltage is made of: signals, the effect that each stands for, and its bound."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

from models.data.errors import ModelError
from models.network.signals.temperature import signal_within

# Time constants of the low-passes: each a factor of about three from the next.
_RELAXATION_S = (2.0, 6.0, 20.0, 60.0, 200.0, 600.0, 2000.0)
# From here on a branch is slower than what charge transfer and double layer do: it is named relaxation.
_SLOW_S = 100.0
# A non-negative sum over these can neither turn negative nor rise with temperature, and bends as measured ones do.
_ACTIVATIONS_K = (0.0, 3500.0, 7500.0)
# Where all runs have one temperature no scaling can be told from another; this one is common to many cells.
_TYPICAL_K = 3500.0
# Exchange currents over the capacity, 1/h, and their activation.
_EXCHANGE_RATES = (0.02, 0.1, 0.5, 2.0)
_EXCHANGE_K = 4000.0
_SLOWED_S = 20.0
_LOOP_RATES = (10.0, 40.0, 150.0)
_SQUARED_S = (60.0, 600.0)
# How much more strongly what only one direction loses is held to nothing: runs that charge at other rates, or at other
# states of charge, than they discharge do not tell direction from either. Of 16 splits of measured records 1000 left 1
# worse by more than a tenth and 4 better, 1 left 4 and 5, and 10 000 left 2 and 1.
_SYMMETRY = 1000.0
# What stands between them, and beyond, where a part is asked for with more resolution.
_MORE_RELAXATION_S = (115.0, 350.0, 1100.0, 3500.0, 6000.0)
_MORE_ACTIVATIONS_K = (1700.0, 5500.0, 9500.0)
_MORE_EXCHANGE_RATES = (0.007, 0.05, 0.22, 1.0, 6.0)
_MORE_LOOP_RATES = (4.0, 20.0, 80.0, 300.0)
_WAYS = ("directed_transfer:1/", "directed_transfer:-1/")
# Below this many samples a low-pass cannot be told from the current itself.
_FASTEST_SAMPLES = 1.5


# Parts that a network can do without; a physical effect names the one that stands for it.
SLOW, TRANSFER, LOOP = "relaxation", "charge_transfer", "hysteresis"
BOTH_WAYS = "asymmetry of charge and discharge"
SCALED, SLOPE = "scaling by temperature", "slope with temperature"
# The state of charge at a surface, and by how much the mean is behind it, where the faster electrode stands.
_SURFACE, BEHIND = "surface_soc", "behind_surface"
# What every network has: gains over the state of charge.
GAINS_OVER_SOC = ""


@dataclass(frozen=True)
class Term:
    """One input: a signal with a gain over the state of charge.

    Attributes
    ----------
    signal : as `models.network.signals` names it
    parts : without any of which it is not there; none: it always is
    bounded : its gain must not be negative
    held : how many times as strongly as others its gain is held to nothing
    """

    signal: str
    parts: tuple[str, ...] = ()
    bounded: bool = True
    held: float = 1.0

    @property
    def flat(self) -> bool:
        """Whether its gain is the same at every state of charge.

        A surface may be far ahead of the mean. A slope that changed on the way could take back more than the curve has.
        """
        return self.signal.startswith(f"{BEHIND}:")

    @property
    def mirrored(self) -> str:
        """What the signal would be if the current flowed the other way; of most kinds, the same but for its sign."""
        for way, other in (_WAYS, _WAYS[::-1]):
            if self.signal.startswith(way):
                return other + self.signal.removeprefix(way)
        return self.signal


@dataclass(frozen=True)
class Basis:
    """What a bounded network may be made of.

    Attributes
    ----------
    axis : state of charge that curve and gains stand over
    terms : inputs
    """

    axis: str
    terms: tuple[Term, ...]

    def without(self, parts: Iterable[str]) -> Basis:
        """Leave out all terms of some parts; the loop, for one, or whatever is scaled by temperature.

        Raises
        ------
        ModelError
            No term stands for one of them, or nothing would be left.
        """
        wanted = set(parts)
        known = {name for term in self.terms for name in term.parts}
        unknown = sorted(wanted - known)
        if unknown:
            raise ModelError(
                f"{', '.join(unknown)} cannot be left out of a bounded network of these runs; "
                f"it has {', '.join(sorted(known))}"
            )
        left = tuple(term for term in self.terms if not wanted.intersection(term.parts))
        if not left:
            raise ModelError(f"nothing is left of the network without {', '.join(sorted(wanted))}")
        return replace(self, terms=left)


def make_basis(
    dt_s: float,
    capacity_Ah: float,
    temperature: str,
    *,
    axis: str = "soc",
    slowest_s: float = 2000.0,
    squared: bool = False,
    behind: bool = False,
    range_degC: tuple[float, float] | None = None,
    finer: Collection[str] = (),
) -> Basis:
    """All terms that runs can tell something of.

    Parameters
    ----------
    dt_s : sampling time
    capacity_Ah : of the cell
    temperature : "moves", "one" (measured, but hardly moving) or "missing"
    axis : state of charge that curve and gains stand over
    slowest_s : longest time constant
    squared : whether overvoltages that grow faster than the current are offered
    behind : whether a part of the curve may stand at the mean state of charge, where the axis is that at a surface
    range_degC : temperatures of the runs, beyond which the curve changes ever less; None: it goes on
    finer : parts that are wanted with more resolution: more time constants, rates or activations
    """
    factors = {"moves": _ACTIVATIONS_K, "one": (_TYPICAL_K,), "missing": (0.0,)}[temperature]
    factors += _MORE_ACTIVATIONS_K if SCALED in finer and temperature == "moves" else ()
    slow_s, slowest_s = (_MORE_RELAXATION_S, _MORE_RELAXATION_S[-1]) if SLOW in finer else ((), slowest_s)
    relaxation_s = [
        tau_s for tau_s in sorted((*_RELAXATION_S, *slow_s)) if _FASTEST_SAMPLES * dt_s <= tau_s <= slowest_s
    ]
    terms = []
    for kelvin in factors:
        scaled = (SCALED,) if kelvin and temperature == "moves" else ()
        terms += _linear(kelvin, scaled, relaxation_s)
        if squared:
            signals = [f"squared_current:{tau_s:g}/{kelvin:g}" for tau_s in _SQUARED_S]
            terms += [Term(signal, (*scaled, SLOW)) for signal in signals]
    exchange_rates = (*_EXCHANGE_RATES, *(_MORE_EXCHANGE_RATES if TRANSFER in finer else ()))
    held = 1.0 if BOTH_WAYS in finer else _SYMMETRY
    terms += _charge_transfer(dt_s, capacity_Ah, 0.0 if temperature == "missing" else _EXCHANGE_K, exchange_rates, held)
    loop_rates = (*_LOOP_RATES, *(_MORE_LOOP_RATES if LOOP in finer else ()))
    terms += [Term(f"hysteresis_state:{rate:g}", (LOOP,)) for rate in loop_rates]
    surface, _, numbers = axis.partition(":")
    if behind and surface == _SURFACE:
        terms.append(Term(f"{BEHIND}:{numbers}", (SLOW,)))
    if temperature == "moves":
        signal = "temperature" if range_degC is None else signal_within(*range_degC)
        terms.append(Term(signal, (SLOPE, SCALED), bounded=False))
    return Basis(axis, tuple(terms))


def _linear(kelvin: float, scaled: tuple[str, ...], relaxation_s: Iterable[float]) -> list[Term]:
    """The current and its low-passes times one factor of the temperature."""
    terms = [Term(f"scaled_current:{kelvin:g}" if kelvin else "current", scaled)]
    for tau_s in relaxation_s:
        slow = (SLOW,) if tau_s >= _SLOW_S else ()
        terms.append(Term(f"low_pass:{tau_s:g}/{kelvin:g}", (*scaled, *slow)))
    return terms


def _charge_transfer(
    dt_s: float, capacity_Ah: float, activation_K: float, rates: Iterable[float], held: float
) -> list[Term]:
    """At once and slowed, for each exchange current: alike in both directions, and what one of them loses alone."""
    slowed_s = (0.0, _SLOWED_S) if _FASTEST_SAMPLES * dt_s <= _SLOWED_S else (0.0,)
    terms = []
    # Those of one exchange current follow each other: the loops ask for its asinh once.
    for rate in rates:
        ends = [f"{rate * capacity_Ah:.6g}/{activation_K:g}/{tau_s:g}" for tau_s in slowed_s]
        terms += [Term(f"charge_transfer:{end}", (TRANSFER,)) for end in ends]
        # Neither gain is negative, so that the cell gives no voltage away in either direction.
        directed = [f"{way}{end}" for way in _WAYS for end in ends]
        terms += [Term(signal, (TRANSFER, BOTH_WAYS), held=held) for signal in directed]
    return terms
