"""The module models side by side on runs of a module, and what differs from group to group there."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np

from models.comparison.placed_runs import place_runs
from models.data.metrics import Metrics, metrics
from models.module.groups import judge_groups, weak_group
from models.module.log import ModuleLog
from models.module.network import ModuleNetwork
from models.network.model_record import Json


class ModuleKind(TypedDict):
    """One module model's error."""

    kind: str
    overall: Metrics


class ModuleKinds(TypedDict):
    """What only a module's comparison has; see `compare_module`."""

    chosen: str
    models: list[ModuleKind]
    groups: list[Json]
    weak_group: Json | None


def compare_module(model: ModuleNetwork, logs: Sequence[ModuleLog], initial_soc: list[float]) -> ModuleKinds:
    """Error of each module model on the same runs of the cell, and the groups as these runs show them.

    Parameters
    ----------
    model : with the module models that were identified with it
    logs : runs of the module; groups only where their voltages were measured
    initial_soc : fraction at the start of each

    Returns
    -------
    The `module` object of the public contract.
    """
    placed = place_runs(model, [log.run for log in logs], initial_soc)
    measured_V = np.concatenate([each.run.voltage_V for each in placed])
    current_A = np.concatenate([each.run.current_A for each in placed])
    simulated_V = np.concatenate([each.simulated_V for each in placed])
    beside_V = model.module.voltage_V(np.zeros(len(current_A)), current_A)
    cell_V = (simulated_V - beside_V) / model.module.cells_in_series
    groups = judge_groups(model.network, model.module.cells_in_parallel, logs, initial_soc)
    return {
        "chosen": model.module.kind,
        "models": [
            {"kind": each.kind, "overall": metrics(measured_V, each.voltage_V(cell_V, current_A))}
            for each in model.candidates
        ],
        "groups": [each.to_json() for each in groups],
        "weak_group": weak_group(groups),
    }
