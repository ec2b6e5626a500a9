"""How large an effect is in runs, held against a network that lacks it, or has it otherwise."""

from __future__ import annotations

import numpy as np

from models.data.errors import ModelError
from models.diagnosis.diagnosis import network_memory, own_activation_K
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.likelihood.analysis import analyse
from models.diagnosis.likelihood.values import values_of
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import Record
from models.diagnosis.reference.reference import fit_reference
from models.diagnosis.structure.structure import analyse_structure
from models.effects import Effect
from models.network.local_model_network import LocalModelNetwork
from models.readouts.tables import summary


def missing(network: LocalModelNetwork, chosen: Effect, own: Record) -> dict[str, Value]:
    """Parameters of an effect that the structure lacks, from the training runs."""
    shape = Shape(own_activation_K(network.structure))
    reference = fit_reference(own.runs, own.soc, network.cell.capacity_Ah, shape)
    found = analyse_structure(network, reference, own.runs, own.soc, [], [], [chosen])
    named = Named(found.comparison, found.ranking)
    return Readings((named,)).parameters(named, found.ranking.candidates[0])


def in_network(network: LocalModelNetwork, chosen: Effect) -> dict[str, Value]:
    """First parameter of an effect, in its unit, as a refitted bounded network has it; none without a figure for it.

    What runs show to first order may contradict the network: a loop that is inside out, where they pass each state of
    charge once.
    """
    if chosen.read_out is None:
        return {}
    figure, share = chosen.read_out
    value = {**summary(network)}[figure]
    first = chosen.parameters[0]
    return {first.name: Value(share * value, None, first.unit)} if isinstance(value, float) else {}


def changed(chosen: Effect, own: Record, network: LocalModelNetwork) -> dict[str, Value]:
    """Parameters of an effect that is new in the runs, held against what the network would have given.

    Raises
    ------
    ModelError
        The runs cannot size it.
    """
    try:
        # The network is held against itself: the start is the same for both.
        analysis = analyse(network_memory(network, own), own.runs, own.soc, None, [chosen], same_start=True)
    except np.linalg.LinAlgError:
        raise ModelError(
            f"{chosen.name}: the training runs determine too little to size it; name longer ones"
        ) from None
    if not analysis.tried:
        missing = "have no ambient temperature, or the cell hardly warmed up" if chosen.warmth else "cannot show it"
        raise ModelError(f"{chosen.name}: the runs {missing}")
    return values_of(analysis, analysis.tried[0])


def sized(chosen: Effect, own: Record, network: LocalModelNetwork) -> dict[str, Value]:
    """The same of an effect that is put in whether or not the runs can size it; none where they cannot."""
    try:
        return changed(chosen, own, network)
    except ModelError:
        return {}
