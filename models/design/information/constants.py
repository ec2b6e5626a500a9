"""What a test tells of the constants that a fit takes as given: capacity, initial state of charge, time constants.

They stand beside the network's own parameters, which are unknown as well; their sensitivities are central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from models.data.timeseries import FloatArray
from models.design.information.coloured import told_of
from models.design.information.experiment import Evaluator, Experiment
from models.design.information.parameters import parameter_std
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal

# Of each: step of the differences, and what it is known to beforehand. Capacity and time constants as shares.
_CAPACITY, _SOC, _TIME = (1e-3, 0.05), (1e-4, 0.05), (0.02, 0.7)
_KINDS = ("low_pass", "relaxation")

_Change = Callable[[float], Experiment]


def constants_std(experiment: Experiment, current_A: FloatArray) -> dict[str, float]:
    """Standard deviations after a test: shares of the capacity and of each time constant, fraction of the charge."""
    evaluator = Evaluator(experiment, len(current_A))
    rows, level_V = evaluator.predict(current_A).sensitivity_V, evaluator.level_V()
    names, columns, known = list[str](), list[FloatArray](), list[float]()
    for name, change, (step, std) in _changes(experiment):
        high, low = (Evaluator(change(by), len(current_A)).predict(current_A).voltage_V for by in (step, -step))
        names.append(name)
        columns.append((high - low) / (2.0 * step))
        known.append(std)
    size = rows.shape[1]
    prior = np.zeros((size + len(names), size + len(names)))
    prior[:size, :size] = experiment.prior_information()
    prior[size:, size:] = np.diag(np.square(1.0 / np.array(known)))
    told = told_of(experiment, np.column_stack([rows, *columns]), level_V, prior)
    return dict(zip(names, parameter_std(told)[size:].tolist(), strict=True))


def _changes(experiment: Experiment) -> Iterator[tuple[str, _Change, tuple[float, float]]]:
    network, bare = experiment.network, replace(experiment, prior=None)
    cell, soc = network.cell, experiment.initial_soc

    def other_capacity(by: float) -> Experiment:
        return replace(bare, network=replace(network, cell=replace(cell, capacity_Ah=cell.capacity_Ah * (1.0 + by))))

    yield "capacity", other_capacity, _CAPACITY
    yield "initial_soc", lambda by: replace(bare, initial_soc=soc + by), _SOC
    for tau_s in sorted({tau_s for tau_s in map(_time_s, network.structure.signals) if tau_s is not None}):
        yield (
            f"time_constant {tau_s:g} s",
            lambda by, tau_s=tau_s: replace(bare, network=_slower(network, tau_s, by)),
            _TIME,
        )


def _time_s(name: str) -> float | None:
    signal = parse_signal(name)
    return signal.get("time_constant_s") if signal.kind in _KINDS else None


def _slower(network: LocalModelNetwork, tau_s: float, by: float) -> LocalModelNetwork:
    """The network with other filters where they have a time constant."""
    names = {name: _renamed(name, by) if _time_s(name) == tau_s else name for name in network.structure.signals}
    inputs = tuple(replace(channel, signal=names[channel.signal]) for channel in network.structure.inputs)
    axes = tuple(replace(axis, signal=names[axis.signal]) for axis in network.structure.axes)
    scaling = {names.get(name, name): window for name, window in network.scaling.items()}
    return replace(network, structure=replace(network.structure, inputs=inputs, axes=axes), scaling=scaling)


def _renamed(name: str, by: float) -> str:
    kind, values = name.split(":")
    tau_s, *others = values.split("/")
    return f"{kind}:{'/'.join([repr(float(tau_s) * (1.0 + by)), *others])}"
