"""An effect put into a model: into its structure, or as a correction, with a refit on the training runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.diagnosis.change.change import analyse_change
from models.diagnosis.diagnosis import network_memory, own_activation_K
from models.diagnosis.evidence.joint import Named
from models.diagnosis.evidence.parameters import Value, parameters
from models.diagnosis.evidence.reading import Readings
from models.diagnosis.reference.layout import Shape
from models.diagnosis.reference.record import Record, make_record
from models.diagnosis.reference.reference import fit_reference
from models.diagnosis.reference.samples import visible
from models.diagnosis.structure.extension import ExtensionSearch
from models.diagnosis.structure.structure import analyse_structure
from models.effects import Effect, effect
from models.effects.bounded_parts import bounded_effects
from models.effects.input_correction import as_read, corrected
from models.effects.reading import Assumption
from models.identification.progress import Progress, silent
from models.identification.search.search import Search
from models.network.lineage import version_of, with_version
from models.network.local_model_network import LocalModelNetwork
from models.network.model_record import AddedEffect
from models.network.structure import Structure
from models.pipeline.fit import FitResult, fit_network

# Numbers of local models with which the ways to put an effect in are compared.
_SIZES = (12, 24, 36)
_FREED = "the bounded network was fitted to the training runs with the effect among its terms"
_REFITTED = "the network was refitted to the training runs, which takes it in"


@dataclass(frozen=True)
class Addition:
    """A model with one more effect.

    Attributes
    ----------
    network : the new model; its record names the parent's effects and this one
    effect : name
    parameters : of the effect, as the training runs show it
    error_before_mV, error_after_mV : free-run RMSE over the validation runs of the parent and of the new model
    remark : how it was put in
    """

    network: LocalModelNetwork
    effect: str
    parameters: dict[str, Value]
    error_before_mV: float
    error_after_mV: float
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
    """Put an effect into a model.

    Parameters
    ----------
    network : the parent
    name : of the effect
    train, train_soc : runs to refit to, with their SoC at the start
    validate, validate_soc : runs that only judge
    progress : called with a share 0..1 and a short text

    Raises
    ------
    ModelError
        Unknown effect, one that the structure has already or cannot have, or one that the training runs cannot show.
    """
    chosen = effect(name)
    left_out = _left_out(network, name)
    before = make_record(network, validate, validate_soc)
    own = make_record(network, train, train_soc)
    if chosen.regressors is not None and not visible(chosen, own.runs):
        raise ModelError(f"{name}: the training runs cannot show it, their temperature is missing or hardly moves")
    train, validate = ([as_read(network.record, run) for run in runs] for runs in (train, validate))
    if chosen.extend is None:
        return _by_correction(network, chosen, own, train, validate, validate_soc, before, progress)
    values = _missing(network, chosen, own)
    structure, remark = (None, _FREED) if left_out is not None else _extended(network, chosen, own, values)
    fitted = _refitted(network, name, train, train_soc, progress=progress, structure=structure, without=left_out)
    after = make_record(fitted.network, validate, validate_soc)
    return _addition(network, fitted.network, chosen, values, before, after, remark, train)


def _left_out(network: LocalModelNetwork, name: str) -> tuple[str, ...] | None:
    """Effects that a bounded network leaves out once one more is in; None: it is another kind of network.

    Raises
    ------
    ModelError
        It has the effect already, or cannot have it.
    """
    if network.structure.kernel != "hat":
        return None
    choices = network.record.choices or {}
    if choices.get("family") != "bounded":
        raise ModelError(
            f"{name}: {network.name} has hats, which are fitted with bounds: fit it anew to its runs, with the effect "
            "among its terms"
        )
    without = tuple(choices.get("without", ()))
    if effect(name).extend is None or name in without:
        return tuple(each for each in without if each != name)
    if effect(name).bounded_part is not None:
        raise ModelError(f"the model's structure has {name} already; nothing to add")
    raise ModelError(
        f"{name}: a bounded network cannot have it, only {', '.join(bounded_effects())}; fit its runs with "
        "--structure full and add it to that model"
    )


def _extended(
    network: LocalModelNetwork, chosen: Effect, own: Record, values: dict[str, Value]
) -> tuple[Structure, str]:
    """The structure with an effect in it, and how it was put in."""
    search = ExtensionSearch(Search(own.runs, own.soc, network.cell, silent), _SIZES)
    extension = search.extended(search.own(network), chosen, {key: each.value for key, each in values.items()})
    if extension is None:
        raise ModelError(f"the model's structure has {chosen.name} already; nothing to add")
    before, structure = network.structure, extension.choice.given
    return structure, f"structure extended from {', '.join(before.signals)} to {', '.join(structure.signals)}"


def _refitted(
    network: LocalModelNetwork,
    name: str,
    train: list[TimeSeries],
    train_soc: list[float],
    *,
    progress: Progress | None,
    capacity_Ah: float | None = None,
    structure: Structure | None = None,
    without: tuple[str, ...] | None = None,
) -> FitResult:
    """The network fitted anew with an effect; by default of the same structure, a bounded one `without` the others."""
    own_name = _name(network, name)
    kept: Structure = replace(structure or network.structure, name=own_name)
    fitted = fit_network(
        train,
        capacity_Ah=network.cell.capacity_Ah if capacity_Ah is None else capacity_Ah,
        coulombic_efficiency=network.cell.efficiency,
        structure=kept if without is None else "bounded",
        without=without or (),
        initial_soc=train_soc,
        dt_s=network.structure.dt_s,
        progress=progress,
    )
    named = replace(fitted.network, structure=replace(fitted.network.structure, name=own_name))
    return replace(fitted, network=named)


def _by_correction(
    network: LocalModelNetwork,
    chosen: Effect,
    own: Record,
    train: list[TimeSeries],
    validate: list[TimeSeries],
    validate_soc: list[float],
    before: Record,
    progress: Progress | None,
) -> Addition:
    values = _changed(chosen, own, network)
    plain = {key: each.value for key, each in values.items()}
    told = chosen.assumption or Assumption()
    capacity_Ah = network.cell.capacity_Ah if told.capacity_Ah is None else told.capacity_Ah(plain)
    moved = 0.0 if told.soc_moved is None else told.soc_moved(plain, own.soc[0])
    fitted = _refitted(
        network,
        chosen.name,
        [corrected(run, chosen, plain) for run in train],
        [soc + moved for soc in own.soc],
        progress=progress,
        capacity_Ah=capacity_Ah,
        without=_left_out(network, chosen.name),
    )
    after = make_record(fitted.network, [corrected(run, chosen, plain) for run in validate], validate_soc)
    remark = f"the model counts charge on {capacity_Ah:.4g} Ah" if told.capacity_Ah is not None else _REFITTED
    if chosen.correction is not None:
        remark = "the runs' columns were corrected by it before the refit; correct further runs of this rig likewise"
    return _addition(network, fitted.network, chosen, values, before, after, remark, train)


def _missing(network: LocalModelNetwork, chosen: Effect, own: Record) -> dict[str, Value]:
    """Parameters of an effect that the structure lacks, from the training runs."""
    shape = Shape(own_activation_K(network.structure))
    reference = fit_reference(own.runs, own.soc, network.cell.capacity_Ah, shape)
    found = analyse_structure(network, reference, own.runs, own.soc, [], [], [chosen])
    named = Named(found.comparison, found.ranking)
    return Readings((named,)).parameters(named, found.ranking.candidates[0])


def _changed(chosen: Effect, own: Record, network: LocalModelNetwork) -> dict[str, Value]:
    """Parameters of an effect that is new in the runs, held against what the network would have given."""
    analysis = analyse_change(network_memory(network, own), own.runs, own.soc, [chosen])
    if chosen.warmth is not None:
        trial = analysis.thermal.trials[0] if analysis.thermal is not None else None
        if trial is None:
            raise ModelError(f"{chosen.name}: the runs have no ambient temperature, or the cell hardly warmed up")
        named = zip(chosen.parameters, trial.values, trial.std, strict=True)
        return {each.name: Value(value, std, each.unit) for each, value, std in named}
    if analysis.comparison is None or analysis.ranking is None:
        raise ModelError(f"{chosen.name}: the training runs have too few samples in the trained domain to size it")
    return parameters(analysis.comparison, analysis.ranking.candidates[0])


def _name(network: LocalModelNetwork, effect_name: str) -> str:
    return f"{network.structure.name}+{effect_name}"


def _addition(
    parent: LocalModelNetwork,
    network: LocalModelNetwork,
    chosen: Effect,
    values: dict[str, Value],
    before: Record,
    after: Record,
    remark: str,
    train: list[TimeSeries],
) -> Addition:
    entry: AddedEffect = {
        "effect": chosen.name,
        "parameters": {key: {"value": v.value, "std": v.std, "unit": v.unit} for key, v in values.items()},
        "correction": chosen.correction is not None,
        "error_before_mV": before.rms_mV,
        "error_after_mV": after.rms_mV,
    }
    record = replace(network.record, effects=(*parent.record.effects, entry))
    made_by = version_of(network)
    versioned = with_version(
        replace(network, record=record),
        "effect",
        train,
        parent=parent,
        settings={"effect": chosen.name},
        errors={"parent_rmse_mV": before.rms_mV, "rmse_mV": after.rms_mV},
        code_version="unknown" if made_by is None else made_by.code_version,
        sums_sha256=None if made_by is None else made_by.sums_sha256,
    )
    return Addition(versioned, chosen.name, values, before.rms_mV, after.rms_mV, remark)
