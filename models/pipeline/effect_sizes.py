"""How large an effect is in runs, held against a network that lacks it, or has it otherwise."""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError
from models.diagnosis.change.change import analyse_change
from models.diagnosis.diagnosis import network_memory, own_activation_K
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import Record
from models.diagnosis.reference.reference import fit_reference
from models.diagnosis.structure.structure import analyse_structure
from models.effects import Effect
from models.network.local_model_network import LocalModelNetwork


def missing(network: LocalModelNetwork, chosen: Effect, own: Record) -> dict[str, Value]:
    """Parameters of an effect that the structure lacks, from the training runs."""
    shape = Shape(own_activation_K(network.structure))
    reference = fit_reference(own.runs, own.soc, network.cell.capacity_Ah, shape)
    found = analyse_structure(network, reference, own.runs, own.soc, [], [], [chosen])
    named = Named(found.comparison, found.ranking)
    return Readings((named,)).parameters(named, found.ranking.candidates[0])


def changed(chosen: Effect, own: Record, network: LocalModelNetwork) -> dict[str, Value]:
    """Parameters of an effect that is new in the runs, held against what the network would have given.

    Raises
    ------
    ModelError
        The runs cannot size it.
    """
    try:
        analysis = analyse_change(network_memory(network, own), own.runs, own.soc, [chosen])
    except np.linalg.LinAlgError:
        raise ModelError(
            f"{chosen.name}: the training runs determine too little to size it; name longer ones"
        ) from None
    if chosen.warmth is not None:
        trial = analysis.thermal.trials[0] if analysis.thermal is not None else None
        if trial is None:
            raise ModelError(f"{chosen.name}: the runs have no ambient temperature, or the cell hardly warmed up")
        named = zip(chosen.parameters, trial.values, trial.std, strict=True)
        return {each.name: Value(value, std, each.unit) for each, value, std in named}
    if analysis.comparison is None or analysis.ranking is None:
        raise ModelError(f"{chosen.name}: the training runs have too few samples in the trained domain to size it")
    return parameters(analysis.comparison, analysis.ranking.candidates[0])


def sized(chosen: Effect, own: Record, network: LocalModelNetwork) -> dict[str, Value]:
    """The same of an effect that is put in whether or not the runs can size it; none where they cannot."""
    try:
        return changed(chosen, own, network)
    except ModelError:
        return {}
