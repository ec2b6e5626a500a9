"""One call: which effect is missing in a model, or new in its cell, with evidence."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from models.data.errors import ModelError, NotIdentifiableError, StructureError
from models.data.resampling import GridRun, to_grid
from models.data.run_order import check_no_repeat, in_order
from models.data.timeseries import TimeSeries
from models.diagnosis.answer.beyond import beyond_remarks
from models.diagnosis.answer.change_answer import change_answer
from models.diagnosis.answer.findings import Diagnosis, Mode
from models.diagnosis.answer.refits import try_refits
from models.diagnosis.answer.structure_answer import structure_answer, unexplained
from models.diagnosis.known.memory import KnownRuns
from models.diagnosis.known.record import known_in
from models.diagnosis.likelihood.analysis import analyse
from models.diagnosis.likelihood.learning import know
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.reference.reference import fit_reference
from models.diagnosis.structure.steep import without_steep
from models.diagnosis.structure.structure import analyse_structure
from models.diagnosis.thermal.heat_balance import HeatBalance
from models.effects import Effect, effects
from models.effects.input_correction import as_read
from models.identification.bounded.variants import Variant, variant_of
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import parse_signal
from models.network.structure import Structure
from models.thermal.cell_temperature import thermal_of

# Error of a temperature that a heat balance is taken to have where no training run tells, and what is left of the error
# elsewhere where a network is held against itself.
_OWN_K, _TRUST = 0.1, 0.01
_FEWEST_SAMPLES = 100


def diagnose(
    network: LocalModelNetwork,
    runs: list[TimeSeries],
    initial_soc: list[float],
    *,
    train: list[TimeSeries] | None = None,
    train_soc: list[float] | None = None,
    mode: Mode = "change",
    memory: KnownRuns | None = None,
    soc_std: list[float] | None = None,
) -> Diagnosis:
    """Diagnose runs.

    Parameters
    ----------
    network : the model
    runs, initial_soc : measurements to be explained, with their SoC at the start
    train, train_soc : the runs that the network was made from, which make a diagnosis of a change far sharper
    memory : of the training runs, where it is at hand already
    soc_std : standard deviation of each run's SoC at the start; None: that of a careful statement
    mode : "change": the model was right, what is new? "structure": what does the model's structure lack?

    Raises
    ------
    ModelError
        No run, a record that is given twice, unknown mode, or runs that the model cannot be held against.
    """
    started = time.perf_counter()
    if not runs:
        raise ModelError("nothing to diagnose: no run was given")
    check_no_repeat(runs, "a diagnosis")
    record = make_record(network, runs, initial_soc)
    if train and (train_soc is None or len(train_soc) != len(train)):
        raise ModelError("each training run needs its SoC at the start")
    train, train_soc = in_order(train or [], train_soc or [])
    grid = [to_grid(as_read(network.record, run), network.structure.dt_s) for run in train]
    check_training(grid)
    if mode == "structure":
        return _structure(network, record, grid, train_soc, soc_std, started)
    if mode != "change":
        raise ModelError(f"mode {mode!r} is unknown; use change or structure")
    has_train = bool(grid) or memory is not None or network.record.diagnosis is not None
    try:
        with np.errstate(over="raise"):
            known = memory if memory is not None else known_of(network, record, grid, train_soc)
            analysis = analyse(known, record.runs, record.soc, soc_std, list(effects().values()))
            answer = change_answer(analysis, record, started, has_train)
            return replace(answer, remarks=(*answer.remarks, *beyond_remarks(network, record, mode)))
    except ModelError:
        raise
    except (ArithmeticError, IndexError, ValueError) as error:
        raise ModelError(
            f"diagnosis: these runs cannot be weighed ({str(error).splitlines()[0][:100]}); look at them for outliers, "
            "missing columns and hardly any samples, or name other training runs"
        ) from error


def _structure(
    network: LocalModelNetwork,
    record: Record,
    train: list[GridRun],
    train_soc: list[float],
    soc_std: list[float] | None,
    started: float,
) -> Diagnosis:
    """What the structure lacks, by the voltages that do not hang on half a point of counted charge."""
    every, soc = [*train, *record.runs], [*train_soc, *record.soc]
    reference = fit_reference(every, soc, network.cell.capacity_Ah, Shape(own_activation_K(network.structure)))
    lacking = [each for each in effects().values() if not _has(network, each)]
    told, shown = without_steep(network, train, train_soc), record.of(without_steep(network, record.runs, record.soc))
    found = analyse_structure(network, reference, told, train_soc, shown.runs, record.soc, lacking, soc_std)
    refits = try_refits(network, told, train_soc, shown, found) if train and unexplained(found) else None
    answer = structure_answer(found, reference, shown, started, refits, 1.0 - shown.n_measured / record.n_measured)
    return replace(answer, remarks=(*answer.remarks, *beyond_remarks(network, record, "structure")))


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


def known_of(network: LocalModelNetwork, record: Record, train: list[GridRun], train_soc: list[float]) -> KnownRuns:
    """Of the training runs; else as the model's document has it; else of the network's own voltage."""
    if train:
        return memory_of(train, train_soc, network.cell.capacity_Ah, own_variant(network, train))
    return known_in(network) or network_memory(network, record)


def network_memory(network: LocalModelNetwork, record: Record) -> KnownRuns:
    """What the network itself says of the diagnosed runs, where nothing is known of its training runs.

    Its voltage is taken as right to its own training error, which hangs together over minutes.
    """
    simulated, soc = as_simulated(record)
    # What was simulated begins where it is said to; without noise even a tiny gain would move its state of charge.
    form = own_variant(network, simulated)
    known = know(simulated, soc, network.cell.capacity_Ah, list(effects().values()), form, starts_known=True)
    noise_V2 = (1e-3 * (record.noise_floor_mV or 0.0)) ** 2
    own_V2 = max((1e-3 * network.record.train_rmse_mV(0.0)) ** 2 - noise_V2, 0.0)
    # What the network itself says is the same in every run: only its own error is left.
    alike = replace(known.elsewhere, variances=_TRUST * known.elsewhere.variances, granted={})
    elsewhere = replace(alike, noise_V2=noise_V2, own_V2=own_V2)
    # Trained is what the network was made from, not what these runs go through.
    cell = replace(known.cell, domain={**known.cell.domain, **network.record.domain})
    return replace(known, cell=cell, elsewhere=elsewhere, balance=_own_balance(network) or known.balance)


def _own_balance(network: LocalModelNetwork) -> HeatBalance | None:
    """The heat balance of the network's record: one of the diagnosed runs would take in what is asked for."""
    found = thermal_of(network)
    if found is None:
        return None
    transfer = found[0].heat_transfer_W_per_K
    tau_s = found[0].heat_capacity_J_per_K / transfer
    return HeatBalance(1.0 / transfer, tau_s, float(np.mean(found[0].dU_dT_V_per_K)), _OWN_K**2)


def memory_of(runs: list[GridRun], soc: list[float], capacity_Ah: float, variant: Variant | None = None) -> KnownRuns:
    """What a diagnosis needs to know of training runs; `to_json` of it goes into a model's record as `diagnosis`."""
    return know(runs, soc, capacity_Ah, list(effects().values()), variant)


def own_variant(network: LocalModelNetwork, train: list[GridRun]) -> Variant | None:
    """Form of a bounded network, or of the one that it was held against, which need not be chosen again; None: none."""
    choices = network.record.choices or {}
    known = not any(np.isnan(run.temperature_degC).any() for run in train)
    form = choices if choices.get("family") == "bounded" else choices.get("bounded")
    if not known or form is None:
        return None
    return variant_of(form)


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
