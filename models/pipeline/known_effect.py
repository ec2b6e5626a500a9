"""An effect that a network has already, estimated again: as it has become, or with more resolution.

On runs that the network was not made from, the effect has changed: of a bounded network only the part that stands for
it is free, and the rest is held to what was known, so that a wrong effect does not help. On the network's own runs it
is resolved too coarsely.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.diagnosis import memory_of, memory_to_json, own_variant
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.reference.record import Record
from models.effects import Effect
from models.effects.effect import CURVE
from models.network.lineage import run_sha256, version_of
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal
from models.pipeline.refitting import refit_part
from models.readouts.tables import read_out
from models.thermal.cell_temperature import thermal_record

# Held-out error of a network with only one part free, over that which was expected of the parent, from which on more
# than this part must have changed; and by how much a fit of everything has to be better then.
_AS_GOOD, _WORTH = 1.1, 0.98
_HELD = "the rest was held to what was known"
_MOVED = "more than that has changed, so the rest was held to what was known only as far as these runs bear it"
_MILLI = {"V": "mV", "Ohm": "mOhm", "A": "mA"}


@dataclass(frozen=True)
class Again:
    """A network with an effect estimated again, and how that was done; `held`: to what was known of other runs."""

    network: LocalModelNetwork
    remark: str
    held: bool = False


def is_own(network: LocalModelNetwork, train: list[TimeSeries]) -> bool:
    """Whether a network was made from these runs, and so cannot have changed in them."""
    version = version_of(network)
    known = set() if version is None else {run.sha256 for run in version.runs}
    return bool(known) and all(run_sha256(run) in known for run in train)


def holds_others(network: LocalModelNetwork) -> bool:
    """Whether a network holds what earlier runs said beside those of its version, which a fit to these would lose."""
    version = version_of(network)
    return version is not None and (version.made_by in ("refit", "update") or bool(version.settings.get("held")))


def estimated_again(
    network: LocalModelNetwork, chosen: Effect, train: list[TimeSeries], train_soc: list[float], own: Record
) -> Again:
    """Estimate the part of a bounded network that stands for an effect again, from runs that it was not made from.

    Parameters
    ----------
    network : of which `bounded_refit.remembers` holds
    chosen : the effect
    train, train_soc : runs to learn from
    own : the network on them
    """
    freed = freed_parts(network, chosen)
    found, remark = refit_part(network, train, train_soc, freed), _HELD
    error_mV = _held_out_mV(found)
    if error_mV > _AS_GOOD * _expected_mV(network):
        moved = refit_part(network, train, train_soc, freed, None)
        if _held_out_mV(moved) < _WORTH * error_mV:
            found, remark = moved, _MOVED
    return Again(_read_again(found, own), remark)


def freed_parts(network: LocalModelNetwork, chosen: Effect) -> tuple[str, ...]:
    """Signals of a bounded network, and its curve, that a change of an effect shows in."""
    terms = (network.record.choices or {}).get("terms", [])
    kinds = chosen.renews
    found = [
        term["signal"] for term in terms if chosen.name in term["effects"] or parse_signal(term["signal"]).kind in kinds
    ]
    return (*found, *(kind for kind in kinds if kind == CURVE))


def difference(chosen: Effect, values: dict[str, Value]) -> str:
    """The change of the first parameter as a technician reads it; empty where the runs do not size it."""
    first = chosen.parameters[0]
    found = values.get(first.name)
    if found is None:
        return ""
    factor, unit = (1e3, _MILLI[first.unit]) if first.unit in _MILLI else (1.0, first.unit)
    band = "" if found.std is None else f" +- {factor * found.std:.1g}"
    return f"{first.meaning}: {factor * found.value:+.3g}{band} {unit} against what it was"


def _held_out_mV(network: LocalModelNetwork) -> float:
    return float((network.record.choices or {}).get("held_out_rmse_mV", np.inf))


def _expected_mV(network: LocalModelNetwork) -> float:
    return float((network.record.choices or {}).get("expected_rmse_mV", np.inf))


def _read_again(network: LocalModelNetwork, own: Record) -> LocalModelNetwork:
    """With tables and a heat balance, and with what a later diagnosis needs to know of the new runs."""
    choices = {**(network.record.choices or {}), "expected_rmse_mV": _held_out_mV(network)}
    network = replace(network, record=replace(network.record, choices=choices))
    network = replace(network, record=replace(network.record, tables=dict(read_out(network))))
    heat = thermal_record(network, own.runs, own.soc)
    if heat is not None and heat["model"] is not None:
        network = replace(network, record=replace(network.record, thermal=dict(heat)))
    try:
        memory = memory_of(own.runs, own.soc, network.cell.capacity_Ah, own_variant(network, own.runs))
    except (ModelError, np.linalg.LinAlgError):
        return replace(network, record=network.record.without("diagnosis"))
    return replace(network, record=replace(network.record, diagnosis=memory_to_json(memory)))
