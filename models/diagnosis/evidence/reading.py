"""Parameters of an effect that a structure lacks, where the structure lacks much else besides.

Beside a network that is poor in more than one way the size of an effect is bent to serve the rest, too. The reference
model has nearly every effect; with what stands for the one that is asked for taken out of it, that one is read beside
everything else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from models.diagnosis.evidence.candidates import Candidate, Comparison, try_effect, try_lean
from models.diagnosis.evidence.evidence import Evidence
from models.diagnosis.evidence.joint import Named, best_form, with_form
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.reference import Reference, fit_reference
from models.diagnosis.reference.samples import Samples
from models.effects import Effect
from models.effects.view import View

# The reference model is asked where it leaves less than this share of the squared error that the network does, and is
# believed where it knows the parameter to this share of it.
_CLEARLY_BETTER, _KNOWN_TO = 0.5, 0.2
_RIDGE = 1e-9


@dataclass(frozen=True)
class Readings:
    """Everything that a structure was found to lack, to be sized."""

    named: tuple[Named, ...]

    def parameters(self, named: Named, candidate: Candidate) -> dict[str, Value]:
        """Read the parameters of an effect.

        Parameters
        ----------
        named : what the effect was tried against
        candidate : the effect, or a rival of it
        """
        comparison, effect = named.comparison, candidate.effect
        own = parameters(comparison, candidate)
        if effect.local is not None:
            return own
        richer = self._beside_reference(named, effect)
        again = try_effect(richer, effect)
        if _left(richer, again) >= _CLEARLY_BETTER * _left(comparison, candidate):
            return own
        found = parameters(richer, again)
        first = found[effect.parameters[0].name]
        known = first.std is not None and first.std <= _KNOWN_TO * abs(first.value)
        return found if known else own

    def _beside_reference(self, named: Named, effect: Effect) -> Comparison:
        """The measured voltage against the reference model without an effect, with others that it does not have."""
        others = [each for each in self.named if each is not named]
        # Where resistances change with temperature, those of every other effect do.
        activated = effect.activation_K is None and any(each.effect.activation_K is not None for each in others)
        runs = self._activated if activated else named.comparison.runs
        reference = runs.views[0].model
        assert isinstance(reference, Reference)
        voltage_V = np.concatenate([view.run.voltage_V[view.index] for view in runs.views])
        kept = ~reference.layout.places_of(effect.reference_terms)
        information = len(voltage_V) * reference.penalty[np.ix_(kept, kept)]
        information += _RIDGE * np.eye(len(information))
        evidence = Evidence(voltage_V, runs.own_regressors(reference)[:, kept], information, runs.blocks)
        columns = {effect.name: runs.regressors(effect)}
        found = replace(named.comparison, runs=runs, effects=(effect,), columns=columns, evidence=evidence)
        for each in others:
            if not reference.layout.places_of(each.effect.reference_terms).any():
                found = with_form(found, best_form(each.ranking))
        return found

    @cached_property
    def _activated(self) -> Samples:
        """The samples with a reference model whose currents are scaled by temperature, fitted to the same runs."""
        warm = next(each for each in self.named if each.effect.activation_K is not None)
        assert warm.effect.activation_K is not None
        found = parameters(warm.comparison, warm.ranking.candidates[0])
        change_K = warm.effect.activation_K({name: each.value for name, each in found.items()})
        samples, views = warm.comparison.runs, warm.comparison.runs.views
        model = fit_reference(
            [view.run for view in views],
            [view.initial_soc for view in views],
            views[0].capacity_Ah,
            Shape(views[0].model.activation_K + change_K),
        )
        return replace(samples, views=tuple(View(model, view.run, view.initial_soc, view.index) for view in views))


def _left(comparison: Comparison, candidate: Candidate) -> float:
    """Remaining error with the smallest form of an effect, V^2."""
    if candidate.effect.lean is None:
        return candidate.solution.cost
    return try_lean(comparison, candidate.effect).cost
