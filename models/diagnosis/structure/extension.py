"""How an effect can be put into a structure, and which way simulates held-out training runs best.

An effect has a plain way in (`Effect.extend`), which is all that a simulated cell asks for. In a measured cell charge
transfer has more than one speed, and diffusion more than one time constant, with a surface whose state of charge sets
the voltage; both depend on temperature. Such ways are tried beside the plain one, each by a refit that is judged on
training runs which it has not seen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from threadpoolctl import threadpool_limits

from models.effects import Effect
from models.effects.effect import Values
from models.identification.search.auto import Offer, find_offer
from models.identification.search.given import GivenCandidate, pole_alternatives
from models.identification.search.search import Search
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import is_soc, parse_signal
from models.network.structure import InputChannel, Structure

_EXCHANGE_C_RATES = (0.02, 0.2, 0.6, 2.0)
_SLOWED_S = 20.0
_TIME_CONSTANTS_S = (4.0, 40.0, 400.0)
_SURFACES = ("0.02/400", "0.02/1500", "0.05/400", "0.05/1500", "0.05/4000")
_SURFACE_K = 2500.0
# Of relaxation one part may change with temperature and another not.
_ACTIVATIONS_K = ((0.0,), (2500.0,), (5000.0,), (0.0, 5000.0))
# A richer way than the plain one must lower the held-out error by this share.
_WORTH = 0.02


@dataclass(frozen=True)
class Extension:
    """A structure, judged.

    Attributes
    ----------
    choice : the structure with poles and size
    error_V : free-run RMSE on held-out training runs
    """

    choice: GivenCandidate
    error_V: float


@dataclass
class ExtensionSearch:
    """Refits of a network's structure and of what it can be extended to, on the network's training runs.

    Attributes
    ----------
    search : on the training runs; its judge compares the refits
    sizes : numbers of local models that every structure is tried with
    """

    search: Search
    sizes: tuple[int, ...] = (24,)

    def own(self, network: LocalModelNetwork) -> Extension:
        """The network's structure as it is, with the best of the poles that are offered."""
        first = GivenCandidate(network.structure, ())
        poles = pole_alternatives(first, self.search.fastest_s) if network.structure.output_order else [first]
        return self._least(poles)

    def extended(self, own: Extension, added: Effect, values: Values) -> Extension | None:
        """The best way to put an effect in; None where there is none, or the structure has it already.

        Parameters
        ----------
        own : without the effect
        added : the effect
        values : of its parameters, for the plain way
        """
        structure = own.choice.given
        plain = structure if added.extend is None else added.extend(structure, values, self.search.cell.capacity_Ah)
        if plain == structure:
            return None
        found = self._best([plain], own)
        ways = {"charge_transfer": self._charge_transfer, "relaxation": self._relaxation}
        return _worthier(ways[added.name](own), found) if added.name in ways else found

    def _charge_transfer(self, own: Extension) -> Extension:
        """At once and slowed: its exchange current, then its activation."""
        structure, capacity_Ah = own.choice.given, self.search.cell.capacity_Ah

        def at(rate: float, activation_K: float = 0.0) -> Extension:
            name = f"charge_transfer:{rate * capacity_Ah:.4g}/{activation_K:g}"
            return self._best([_with(structure, (name, f"{name}/{_SLOWED_S:g}"))], own)

        rate = min(_EXCHANGE_C_RATES, key=lambda each: at(each).error_V)
        alone = [each[0] for each in self._activations(structure) if len(each) == 1]
        return min((at(rate, activation_K) for activation_K in alone), key=_error)

    def _relaxation(self, own: Extension) -> Extension:
        """Several time constants; then at the particles' surface, too."""
        structure, fastest_s, slowest_s = own.choice.given, 1.5 * self.search.judge.dt_s, self._offer.longest_s
        constants_s = [tau_s for tau_s in _TIME_CONSTANTS_S if fastest_s <= tau_s <= slowest_s] or [slowest_s]
        activations = self._activations(structure)
        spread = self._best([_spread(structure, constants_s, each) for each in activations], own)
        surface_K = _SURFACE_K if len(activations) > 1 else 0.0
        surfaces = [_at_surface(spread.choice.given, f"{each}/{surface_K:g}") for each in _SURFACES]
        return _worthier(self._best(surfaces, spread), spread)

    @cached_property
    def _offer(self) -> Offer:
        return find_offer(self.search.judge.bank)

    def _activations(self, structure: Structure) -> list[tuple[float, ...]]:
        """Those that the temperatures of the runs tell apart; none beside a structure that knows no temperature.

        There an effect would be taken for what is the temperature's.
        """
        if not (self._offer.warm and _knows_temperature(structure)):
            return [each for each in _ACTIVATIONS_K if not any(each)]
        return [each for each in _ACTIVATIONS_K if self._offer.several_activations or len(each) == 1]

    def _best(self, structures: Iterable[Structure], before: Extension) -> Extension:
        poles_s = before.choice.poles_s
        return self._least([GivenCandidate(each, poles_s if each.output_order else ()) for each in structures])

    def _least(self, choices: list[GivenCandidate]) -> Extension:
        with threadpool_limits(1, user_api="blas"):
            sized = [replace(each, n_models=size) for each in choices for size in self.sizes]
            # Penalties that serve a neighbour may lie in a side valley of another structure: none is started from.
            return min((Extension(each, self.search.judge.error_V(each, each)) for each in sized), key=_error)


def _error(extension: Extension) -> float:
    return extension.error_V


def _worthier(richer: Extension, plain: Extension) -> Extension:
    return richer if richer.error_V < (1.0 - _WORTH) * plain.error_V else plain


def _knows_temperature(structure: Structure) -> bool:
    scaled = any(parse_signal(name).get("activation_K") for name in structure.signals)
    return scaled or any(axis.signal.endswith("temperature") for axis in structure.axes)


def _with(structure: Structure, names: tuple[str, ...]) -> Structure:
    new = [InputChannel(name) for name in names if name not in structure.signals]
    return replace(structure, inputs=(*structure.inputs, *new))


def _spread(structure: Structure, constants_s: list[float], activations_K: tuple[float, ...]) -> Structure:
    """Low-passes of the current in place of output feedback, whose poles all inputs share."""
    inputs = tuple(replace(each, order=0) for each in structure.inputs)
    names = tuple(f"low_pass:{tau_s:g}" + (f"/{k:g}" if k else "") for k in activations_K for tau_s in constants_s)
    return _with(replace(structure, output_order=0, inputs=inputs), names)


def _at_surface(structure: Structure, surface: str) -> Structure:
    """The open-circuit curve over the state of charge at the surface."""
    name = f"surface_soc:{surface}"
    inputs = tuple(replace(each, signal=name) if is_soc(each.signal) else each for each in structure.inputs)
    axes = tuple(replace(each, signal=name) if is_soc(each.signal) else each for each in structure.axes)
    return replace(structure, inputs=inputs, axes=axes)
