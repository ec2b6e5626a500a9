"""How an effect can be put into a structure, and which way simulates held-out training runs best.

An effect has a plain way in (`Effect.extend`), which is all that a simulated cell asks for. In a measured cell it may
have more than one speed or time constant, and depend on temperature. Such ways (`Effect.ways_in`) are tried beside the
plain one, each by a refit that is judged on training runs which it has not seen.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from threadpoolctl import threadpool_limits

from models.effects import Effect
from models.effects.reading import Values
from models.effects.ways_in import Ground
from models.identification.search.auto import Offer, find_offer
from models.identification.search.given import GivenCandidate, pole_alternatives
from models.identification.search.search import Search
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal
from models.network.structure import Structure

# Of an effect one part may change with temperature and another not.
_ACTIVATIONS_K = ((0.0,), (2500.0,), (5000.0,), (0.0, 5000.0))
# A richer way than the plain one must lower the held-out error by this share.
_WORTH = 0.02
# Time constant of a filter, in samples, from which on it is told from no filter.
_FASTEST = 1.5


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
        return _worthier(self._richer(own, added), found) if added.ways_in else found

    def _richer(self, own: Extension, added: Effect) -> Extension:
        """The steps of an effect's richer way in, each from the best of the one before."""
        ground = self._ground(own.choice.given)
        found = own
        for step in added.ways_in:
            best = self._best(step.structures(found.choice.given, ground), found)
            found = _worthier(best, found) if step.only_if_worth else best
        return found

    def _ground(self, structure: Structure) -> Ground:
        activations_K = tuple(self._activations(structure))
        return Ground(
            self.search.cell.capacity_Ah, _FASTEST * self.search.judge.dt_s, self._offer.longest_s, activations_K
        )

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
