"""Richer ways to put an effect into a structure than the plain one, tried by refits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from models.network.structure import InputChannel, Structure


@dataclass(frozen=True)
class Ground:
    """What the training runs let a way in choose from.

    Attributes
    ----------
    capacity_Ah : of the cell
    fastest_s, slowest_s : time constants that they can show
    activations_K : sets of activation temperatures, one for each part of the effect; (0.0,) alone where they show
        nothing of temperature
    """

    capacity_Ah: float
    fastest_s: float
    slowest_s: float
    activations_K: tuple[tuple[float, ...], ...]

    @property
    def single_activations_K(self) -> tuple[float, ...]:
        """Activation temperatures of an effect with one part."""
        return tuple(each[0] for each in self.activations_K if len(each) == 1)


@dataclass(frozen=True)
class WayIn:
    """One step: structures of which the best is taken.

    Attributes
    ----------
    structures : (structure that the step before has ended with, ground) -> structures to try, at least one
    only_if_worth : the step is left out where the best is not clearly better than what it began with
    """

    structures: Callable[[Structure, Ground], list[Structure]]
    only_if_worth: bool = False


def with_inputs(structure: Structure, names: tuple[str, ...]) -> Structure:
    """The structure with more inputs; those that it has are not added twice."""
    new = [InputChannel(name) for name in names if name not in structure.signals]
    return replace(structure, inputs=(*structure.inputs, *new))
