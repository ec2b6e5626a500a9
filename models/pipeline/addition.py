"""An effect put into a model: into its structure, or as a correction, with a refit on the training runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np

from models.comparison.placed_runs import ErrorsApart, errors_apart, free_run_metrics
from models.data.errors import ModelError
from models.data.resampling import to_grid
from models.data.run_order import run_order
from models.data.timeseries import TimeSeries
from models.diagnosis.diagnosis import check_training
from models.diagnosis.evidence.parameters import Value
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.reference.samples import visible
from models.diagnosis.structure.extension import ExtensionSearch
from models.effects import Effect, effect
from models.effects.input_correction import as_read, check_correction, corrected
from models.effects.reading import Assumption
from models.identification.progress import Progress, silent
from models.identification.search.search import Search
from models.network.lineage import version_of, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import AddedEffect
from models.network.structure import Structure
from models.pipeline.anew import Options, name_with, refitted
from models.pipeline.bounded_refit import remembers
from models.pipeline.effect_sizes import changed, in_network, missing, sized
from models.pipeline.faults import Logs, freed
from models.pipeline.known_effect import Again, difference, estimated_again, holds_others, is_own
from models.readouts.counted_on import Counting, counted_anew

# Numbers of local models with which the ways to put an effect in are compared.
_SIZES = (12, 24, 36)
# Less than this is no news: an effect that is in the model already moves nothing else.
_CLEARLY = 1.02
_ROSE = (
    "; the error rose on the runs that judge: they need something else, or the training runs, with one mean current or "
    "one temperature, do not tell it from other effects: learn from runs that differ, or leave it out"
)
_FINER = "the bounded network had it already; it was fitted to the training runs again, with more resolution for it"
_ANEW = "the structure had it already; it was fitted to the training runs again"
_OTHER_KIND = "a bounded network cannot have it: the full structure, which can, was fitted to the training runs instead"
_FREED = "the bounded network was fitted to the training runs with the effect among its terms"
_OF_RUNS = "the runs were freed of it before the refit; no model can have it: look for it and mend it"
_AGED = "the runs were freed of it before the refit: the network is the cell as each run began, which grows old in it"
_REFITTED = "the network was refitted to the training runs, which takes it in"


@dataclass(frozen=True)
class Addition:
    """A model with one more effect.

    Attributes
    ----------
    network : the new model; its record names the parent's effects and this one
    effect : name
    parameters : of the effect, as the training runs show it
    before, after : free-run errors over the validation runs of the parent and of the new model, parted by the ranges
        that the parent was trained in
    remark : how it was put in
    """

    network: LocalModelNetwork
    effect: str
    parameters: dict[str, Value]
    before: ErrorsApart
    after: ErrorsApart
    remark: str


def add_effect(
    network: LocalModelNetwork,
    name: str,
    train: list[TimeSeries],
    train_soc: list[float],
    validate: list[TimeSeries],
    validate_soc: list[float],
    progress: Progress | None = None,
) -> Addition:
    """Put an effect into a model; one that its structure has already is estimated again.

    Parameters
    ----------
    network : the parent
    name : of the effect
    train, train_soc : runs to refit to, with their SoC at the start; one that was counted on from another comes later
    validate, validate_soc : runs that only judge
    progress : called with a share 0..1 and a short text

    Raises
    ------
    ModelError
        Unknown effect, or one that the training runs cannot show.
    """
    chosen = effect(name)
    order = run_order(train)
    train, train_soc = [train[k] for k in order], [train_soc[k] for k in order]
    before = make_record(network, validate, validate_soc)
    # The user compares the same model with the same run on the next page: one figure for both.
    was = errors_apart(network, validate, validate_soc, network)
    own = make_record(network, train, train_soc)
    check_training(own.runs)
    if chosen.regressors is not None and not visible(chosen, own.runs):
        raise ModelError(f"{name}: the training runs cannot show it, their temperature is missing or hardly moves")
    given, known = train, is_own(network, train)
    train, validate = ([as_read(network.record, run) for run in runs] for runs in (train, validate))
    # From here on the runs are as the network reads them: it must not correct them once more.
    bare = replace(network, record=replace(network.record, effects=()))
    task = _Task(bare, chosen, train, train_soc, own, progress, known, order)
    if chosen.extend is None:
        ages = chosen.fault_V is not None and chosen.life is not None and known
        values = missing(network, chosen, own) if ages else changed(chosen, own, network)
        check_correction(chosen, _plain(values))
        task, validate, made = _without_fault(task, values, validate, before)
        validate_soc, made = _starting(task, values, validate_soc, made)
        validate = [corrected(run, chosen, _plain(values)) for run in validate]
    else:
        made, values = _in_structure(task)
    now = errors_apart(made.network, validate, validate_soc, network)
    remark = made.remark + (_ROSE if now.overall_mV > _CLEARLY * was.overall_mV else "")
    return _addition(network, made, chosen, values, (was, now), remark, given)


@dataclass(frozen=True)
class _Task:
    """An effect to be put into a network's structure, and the runs to refit to, as the network reads them.

    The network corrects nothing; `known` says whether it was made from these runs, `order` at which place of time's
    order each was given, `freed` whether the effect is out of them.
    """

    network: LocalModelNetwork
    chosen: Effect
    train: list[TimeSeries]
    train_soc: list[float]
    own: Record
    progress: Progress | None
    known: bool
    order: list[int]
    freed: bool = False

    def fitted(self, remark: str, **options: Unpack[Options]) -> Again:
        """The network fitted anew."""
        network, name = self.network, self.chosen.name
        return Again(refitted(network, name, self.train, self.train_soc, self.progress, **options).network, remark)

    @property
    def can_be_held(self) -> bool:
        """Whether something has changed since, and what was known is there to hold the rest to."""
        return remembers(self.network) and (not self.known or holds_others(self.network))

    def again(self, before: str) -> Again:
        """The effect as it has become, in runs that the network was not made from."""
        network, name = self.network, name_with(self.network, self.chosen.name)
        made = estimated_again(network, self.chosen, self.train, self.train_soc, self.own)
        structure = replace(made.network.structure, name=name)
        return Again(replace(made.network, structure=structure), f"{before}; {made.remark}", held=True)


def _in_structure(task: _Task) -> tuple[Again, dict[str, Value]]:
    """The network with the effect in its structure, and the effect's parameters."""
    network, chosen, own = task.network, task.chosen, task.own
    if network.structure.kernel != "hat":
        values = missing(network, chosen, own)
        extended = _extended(network, chosen, own, values)
        if extended is not None:
            structure, remark = extended
            return task.fitted(remark, structure=structure), values
        return task.fitted(_ANEW), values
    choices = network.record.choices or {}
    if choices.get("family") != "bounded":
        raise ModelError(
            f"{chosen.name}: {network.name} has hats, which are fitted with bounds: fit it anew to its runs, with the "
            "effect among its terms"
        )
    without = tuple(choices.get("without", ()))
    if chosen.name in without:
        left = tuple(each for each in without if each != chosen.name)
        made = task.fitted(_FREED, without=left)
        return made, in_network(made.network, chosen) or missing(network, chosen, own)
    if chosen.bounded_part is None:
        return task.fitted(_OTHER_KIND, structure="full"), sized(chosen, own, network)
    if task.can_be_held:
        values = sized(chosen, own, network)
        told = difference(chosen, values) or "it was in the network already"
        return task.again(f"{told}: that part was estimated again from the training runs"), values
    finer = tuple(dict.fromkeys((*choices.get("finer", ()), chosen.name)))
    return task.fitted(_FINER, finer=finer), sized(chosen, own, network)


def _extended(
    network: LocalModelNetwork, chosen: Effect, own: Record, values: dict[str, Value]
) -> tuple[Structure, str] | None:
    """The structure with an effect in it, and how it was put in; None: it has the effect already."""
    search = ExtensionSearch(Search(own.runs, own.soc, network.cell, silent), _SIZES)
    extension = search.extended(search.own(network), chosen, _plain(values))
    if extension is None:
        return None
    before, structure = network.structure, extension.choice.given
    return structure, f"structure extended from {', '.join(before.signals)} to {', '.join(structure.signals)}"


def _plain(values: dict[str, Value]) -> dict[str, float]:
    return {key: each.value for key, each in values.items()}


def _without_fault(
    task: _Task, values: dict[str, Value], validate: list[TimeSeries], before: Record
) -> tuple[_Task, list[TimeSeries], Again]:
    """The network refitted to runs that are free of a fault, which the task and the judged runs then are, too."""
    network, chosen = task.network, task.chosen
    if chosen.fault_V is None:
        return task, validate, _by_correction(task, values)
    learned = Logs(task.train, task.own).placed(np.argsort(task.order).tolist())
    in_time, judged, passed_Ah = freed(chosen, values, network, learned, Logs(validate, before))
    train = [in_time[k] for k in task.order]
    clean = replace(task, train=train, freed=True)
    made = _by_correction(clean, values)
    left_mV = free_run_metrics(made.network, train, task.train_soc)["rmse_mV"]
    if chosen.life is not None and left_mV > _CLEARLY * network.record.train_rmse_mV(0.0):
        # What has become of a cell since it was known may have stopped: then a refit takes in what was lost by then.
        stopped = _by_correction(task, values)
        if free_run_metrics(stopped.network, task.train, task.train_soc)["rmse_mV"] < _CLEARLY * left_mV:
            return task, validate, stopped
    if passed_Ah > 0.0:
        made = replace(made, remark=f"{made.remark}; {passed_Ah:.3g} Ah had passed before the judged run")
    return clean, judged, made


def _by_correction(task: _Task, values: dict[str, Value]) -> Again:
    """The network refitted to runs that are put right, or with its assumptions put right."""
    network, chosen, own = task.network, task.chosen, task.own
    plain = _plain(values)
    told = chosen.assumption or Assumption()
    capacity_Ah = network.cell.capacity_Ah if told.capacity_Ah is None else told.capacity_Ah(plain)
    moved = 0.0 if told.soc_moved is None else told.soc_moved(plain, own.soc[0])
    remark = f"the model counts charge on {capacity_Ah:.4g} Ah" if told.capacity_Ah is not None else _REFITTED
    if task.freed:
        remark = _OF_RUNS if chosen.life is None else _AGED
    if chosen.correction is not None:
        remark = "the runs' columns were corrected by it before the refit; correct further runs of this rig likewise"
    train, soc = [corrected(run, chosen, plain) for run in task.train], [each + moved for each in own.soc]
    right = replace(task, train=train, train_soc=soc)
    if not task.can_be_held:
        return right.fitted(remark, capacity_Ah=capacity_Ah)
    network = replace(network, cell=replace(network.cell, capacity_Ah=capacity_Ah))
    return replace(right, network=network, own=make_record(network, train, soc)).again(remark)


def _starting(task: _Task, values: dict[str, Value], stated: list[float], made: Again) -> tuple[list[float], Again]:
    """States of charge at which the judged runs start once it is known how to count, and the remark that says so."""
    plain, own, cell = _plain(values), task.own, task.network.cell
    told = task.chosen.assumption or Assumption()
    moved = 0.0 if told.soc_moved is None else told.soc_moved(plain, own.soc[0])
    right = cell if told.capacity_Ah is None else replace(cell, capacity_Ah=told.capacity_Ah(plain))
    runs = [to_grid(corrected(run, task.chosen, plain), task.network.dt_s) for run in task.train]
    after = Counting(runs, [each + moved for each in own.soc], right)
    found = counted_anew(stated, Counting(own.runs, own.soc, cell), after)
    anew = [f"{now:.3f} instead of {thought:.3f}" for now, thought in zip(found, stated, strict=True) if now != thought]
    if not anew:
        return stated, made
    counted = f"{made.remark}; judged from SoC {', '.join(anew)}, counted on from a training run"
    return found, replace(made, remark=counted)


def _addition(
    parent: LocalModelNetwork,
    made: Again,
    chosen: Effect,
    values: dict[str, Value],
    errors: tuple[ErrorsApart, ErrorsApart],
    remark: str,
    train: list[TimeSeries],
) -> Addition:
    entry: AddedEffect = {
        "effect": chosen.name,
        "parameters": {key: {"value": v.value, "std": v.std, "unit": v.unit} for key, v in values.items()},
        "correction": chosen.correction is not None,
        "error_before_mV": errors[0].overall_mV,
        "error_after_mV": errors[1].overall_mV,
    }
    network = made.network
    record = replace(network.record, effects=(*parent.record.effects, entry))
    made_by = version_of(network)
    versioned = with_version(
        replace(network, record=record),
        "effect",
        train,
        parent=parent,
        settings={"effect": chosen.name, "held": made.held},
        errors={"parent_rmse_mV": errors[0].overall_mV, "rmse_mV": errors[1].overall_mV},
        code_version="unknown" if made_by is None else made_by.code_version,
        sums_sha256=None if made_by is None else made_by.sums_sha256,
    )
    return Addition(versioned, chosen.name, values, *errors, remark)
