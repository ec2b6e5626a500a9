"""One call: which effect is missing in a model, or new in its cell, with evidence."""

from __future__ import annotations

import time
from dataclasses import replace

from models.data.errors import ModelError, NotIdentifiableError, StructureError
from models.data.resampling import GridRun, to_grid
from models.data.timeseries import TimeSeries
from models.diagnosis.answer.change_answer import change_answer
from models.diagnosis.answer.findings import Diagnosis, Mode
from models.diagnosis.answer.refits import try_refits
from models.diagnosis.answer.structure_answer import structure_answer, unexplained
from models.diagnosis.change.change import analyse_change
from models.diagnosis.evidence.memory import Memory, memory_in, remember
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.reference.reference import fit_reference
from models.diagnosis.structure.structure import analyse_structure
from models.effects import Effect, effects
from models.effects.input_correction import as_read
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal
from models.network.structure import Structure

# How much better than one more run like the diagnosed ones a network is taken to know its parameters.
_TRUST = 100.0
_FEWEST_SAMPLES = 100


def diagnose(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    initial_soc: list[float],
    *,
    train: list[TimeSeries] | None = None,
    train_soc: list[float] | None = None,
    mode: Mode = "change",
    memory: Memory | None = None,
) -> Diagnosis:
    """Diagnose runs.

    Parameters
    ----------
    network : the model
    runs, initial_soc : measurements to be explained, with their SoC at the start
    train, train_soc : the runs that the network was made from, which make a diagnosis of a change far sharper
    memory : of the training runs, where it is at hand already
    mode : "change": the model was right, what is new? "structure": what does the model's structure lack?

    Raises
    ------
    ModelError
        No run, unknown mode, or runs that the model cannot be held against.
    """
    started = time.perf_counter()
    if not runs:
        raise ModelError("nothing to diagnose: no run was given")
    record = make_record(network, runs, initial_soc)
    if train and (train_soc is None or len(train_soc) != len(train)):
        raise ModelError("each training run needs its SoC at the start")
    grid = [to_grid(as_read(network.record, run), network.structure.dt_s) for run in train or []]
    check_training(grid)
    catalogue = list(effects().values())
    if mode == "structure":
        every, soc = [*grid, *record.runs], [*(train_soc or []), *record.soc]
        reference = fit_reference(every, soc, network.cell.capacity_Ah, Shape(own_activation_K(network.structure)))
        lacking = [each for each in catalogue if not _has(network, each)]
        found = analyse_structure(network, reference, grid, train_soc or [], record.runs, record.soc, lacking)
        refits = None
        if grid and unexplained(found):
            refits = try_refits(network, grid, train_soc or [], record, found)
        return structure_answer(found, reference, record, started, refits)
    if mode != "change":
        raise ModelError(f"mode {mode!r} is unknown; use change or structure")
    known = memory if memory is not None else _memory(network, record, grid, train_soc or [])
    analysis = analyse_change(known, record.runs, record.soc, catalogue)
    has_train = bool(grid) or memory is not None or network.record.diagnosis is not None
    return change_answer(analysis, record, started, has_train)


def check_training(train: list[GridRun]) -> None:
    """Refuse training runs that say nothing of the cell.

    Raises
    ------
    NotIdentifiableError
        They have hardly a sample with a voltage.
    """
    measured = sum(int(run.measured.sum()) for run in train)
    if train and measured < _FEWEST_SAMPLES:
        raise NotIdentifiableError(
            f"diagnosis: the training runs have {measured} samples with a voltage; at least {_FEWEST_SAMPLES} are "
            "needed: name other training runs, or none"
        )


def _memory(network: LocalModelNetwork, record: Record, train: list[GridRun], train_soc: list[float]) -> Memory:
    """Of the training runs; else as the model's document has it; else of the network's own voltage."""
    if train:
        return memory_of(train, train_soc, network.cell.capacity_Ah)
    return memory_in(network) or network_memory(network, record)


def network_memory(network: LocalModelNetwork, record: Record) -> Memory:
    """What the network itself says of the diagnosed runs, where nothing is known of its training runs.

    Its voltage is taken as right to its own training error, and its parameters as well known: nothing tells how well.
    """
    simulated, soc = as_simulated(record)
    memory = memory_of(simulated, soc, network.cell.capacity_Ah)
    floor_mV = record.noise_floor_mV or 0.0
    trained_mV = network.record.train_rmse_mV(0.0)
    own_mse = max(memory.own_mse, (1e-3 * floor_mV) ** 2, (1e-3 * trained_mV) ** 2)
    noise_mse = min((1e-3 * floor_mV) ** 2, own_mse)
    scaled = {"information": _TRUST * memory.information, "right": _TRUST * memory.right}
    return replace(memory, **scaled, own_mse=own_mse, noise_mse=noise_mse)


def memory_of(runs: list[GridRun], soc: list[float], capacity_Ah: float) -> Memory:
    """What a diagnosis needs to know of training runs; `to_json` of it goes into a model's record as `diagnosis`."""
    return remember(fit_reference(runs, soc, capacity_Ah), runs, soc, list(effects().values()))


def _has(network: LocalModelNetwork, effect: Effect) -> bool:
    """Whether an effect was added already, or would leave the structure as it is."""
    if any(entry["effect"] == effect.name for entry in network.record.effects):
        return True
    structure = network.structure
    try:
        return effect.extend is not None and effect.extend(structure, {}, network.cell.capacity_Ah) == structure
    except StructureError:
        # There is no place for it in a structure of this kernel.
        return False


def own_activation_K(structure: Structure) -> float:
    """Scaling of the current by temperature that a structure has; 0: none."""
    return max((parse_signal(name).get("activation_K") for name in structure.signals), default=0.0)


def as_simulated(record: Record) -> tuple[list[GridRun], list[float]]:
    """The runs as the network would have them: without the training runs they stand for the cell as it was."""
    simulated = [
        replace(run, voltage_V=run.voltage_V - error) for run, error in zip(record.runs, record.error_V, strict=True)
    ]
    return simulated, list(record.soc)
