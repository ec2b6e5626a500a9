"""A network fitted anew to runs once an effect is in it."""

from __future__ import annotations

from dataclasses import replace
from typing import TypedDict, Unpack

from models.data.timeseries import TimeSeries
from models.identification.progress import Progress
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import Structure
from models.pipeline.fit import FitResult, fit_network


class Options(TypedDict, total=False):
    """What is not as the network has it."""

    capacity_Ah: float
    structure: Structure | str
    without: tuple[str, ...]
    finer: tuple[str, ...]


def refitted(
    network: LocalModelNetwork,
    name: str,
    train: list[TimeSeries],
    train_soc: list[float],
    progress: Progress | None,
    **options: Unpack[Options],
) -> FitResult:
    """The network fitted anew with an effect; what no option says otherwise stays as it is."""
    own_name, choices = name_with(network, name), network.record.choices or {}
    bounded = network.structure.kernel == "hat" and choices.get("family") == "bounded"
    structure = options.get("structure", "bounded" if bounded else network.structure)
    kept = isinstance(structure, str) and structure == "bounded"
    fitted = fit_network(
        train,
        capacity_Ah=options.get("capacity_Ah", network.cell.capacity_Ah),
        coulombic_efficiency=network.cell.efficiency,
        structure=structure if isinstance(structure, str) else replace(structure, name=own_name),
        without=options.get("without", tuple(choices.get("without", ()))) if kept else (),
        finer=options.get("finer", tuple(choices.get("finer", ()))) if kept else (),
        initial_soc=train_soc,
        dt_s=network.structure.dt_s,
        progress=progress,
        in_step=True,
    )
    named = replace(fitted.network, structure=replace(fitted.network.structure, name=own_name))
    return replace(fitted, network=named)


def name_with(network: LocalModelNetwork, effect_name: str) -> str:
    """Name of a network's structure once an effect is in it."""
    return f"{network.structure.name}+{effect_name}"
