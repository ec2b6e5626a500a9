"""What a model's document says beside the model itself: its data, its choices, how well it did, what it does not know.

A part whose type belongs to a room above this one is held as the document that this type writes; the room has the one
function that reads it, which each part below names. A part that says nothing is None or empty.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Any, Self, TypedDict, TypeVar, cast

from models.data.errors import StructureError
from models.data.metrics import Metrics

Json = dict[str, Any]
# Lowest and highest value of "soc", "current_A", "slow_current_A" (low-passed current; not in older documents) and,
# where it was measured, "temperature_degC".
Domain = Mapping[str, tuple[float, float]]


class EffectValue(TypedDict):
    """One parameter of an effect, as the runs showed it; `std` is None where nothing tells it."""

    value: float
    std: float | None
    unit: str


class AddedEffect(TypedDict):
    """An effect that a model was made with; `correction`: it is put right in a run's columns, not in the structure."""

    effect: str
    parameters: dict[str, EffectValue]
    correction: bool
    error_before_mV: float
    error_after_mV: float


@dataclass(frozen=True, kw_only=True)
class ModelRecord:
    """What a network was made from and how well it did.

    Attributes
    ----------
    domain : ranges of the training data
    train_runs : names of the runs
    choices, candidates : the set of choices that was taken, and all that were tried, with their held-out errors
    reservations : what a person should know before trusting the model
    usability : how far the model can be used, with reasons in words: {"verdict", "reasons"}; None in older documents
    refinement : what was tried to free the poles (`models.identification.refinement`)
    uncertainty : covariance and held-out error; read by `models.uncertainty.model_uncertainty.uncertainty_of`
    tables : what is read out of the network; read by `models.readouts.tables.tables_of`
    thermal : heat balance and its reservations; read by `models.thermal.cell_temperature.thermal_of`
    residuals : statistics of each training run's error (`models.comparison.residuals`)
    train, validation : free-run figures; `validation` is None where no run was held out
    noise_floor_mV : of the training runs' voltage
    sums : sums of products of the training runs; read by `models.identification.stored_sums.sums_of`
    diagnosis : the training runs as a diagnosis remembers them; read by `models.diagnosis.known.record.known_in`
    version : place in the chain of models; read by `models.network.lineage.version_of`
    effects : that were added to the model, the oldest first
    observer : settings that were tuned with it; read by `models.observer.filter.settings.default_settings`
    update : how a live update changed its parameters (`models.recursive.update`)
    parent : the file that it was made from, where one was
    other : parts of a document that this version does not know; they are written again as they were
    stated : parts that the document names even where they say nothing; so that a document that is read and written is
        the same one, and with it its hash
    """

    domain: Domain = field(default_factory=dict)
    train_runs: tuple[str, ...] = ()
    choices: Json | None = None
    candidates: tuple[Json, ...] = ()
    reservations: tuple[str, ...] = ()
    usability: Json | None = None
    refinement: Json | None = None
    uncertainty: Json | None = None
    tables: Json | None = None
    thermal: Json | None = None
    residuals: tuple[Json, ...] = ()
    train: Metrics | None = None
    validation: Metrics | None = None
    noise_floor_mV: float | None = None
    sums: Json | None = None
    diagnosis: Json | None = None
    version: Json | None = None
    effects: tuple[AddedEffect, ...] = ()
    observer: Json | None = None
    update: Json | None = None
    parent: str | None = None
    other: Json = field(default_factory=dict)
    stated: frozenset[str] = field(default=frozenset(), compare=False)

    def train_rmse_mV(self, unknown_mV: float) -> float:
        """Free-run error on the training runs; `unknown_mV` where the record does not say."""
        return float((self.train or {}).get("rmse_mV", unknown_mV))

    def without(self, *parts: str) -> Self:
        """Return the record with parts left out."""
        kept = self.stated.difference(parts)
        return replace(self, stated=kept, **{each.name: _nothing(each) for each in fields(self) if each.name in parts})

    def to_json(self) -> Json:
        """Return a document of plain types."""
        return written(self)

    @classmethod
    def from_json(cls, document: Any) -> Self:
        """Read what `to_json` wrote.

        Raises
        ------
        StructureError
            It is no object, or a part of it is not of its kind.
        """
        return read(cls, document)


RecordT = TypeVar("RecordT")
# Fields of every kind of record that are about its document, not parts of it.
_ABOUT = ("other", "stated")


def written(record: Any) -> Json:
    """Document of a record: its parts that say something or are stated, then those that it does not know."""
    parts: Json = {}
    for each in fields(record):
        value = getattr(record, each.name)
        if each.name not in _ABOUT and (value != _nothing(each) or each.name in record.stated):
            parts[each.name] = _plain(each.name, value)
    return parts | record.other


def read(kind: type[RecordT], document: Any) -> RecordT:
    """Read a record of a kind that has the fields `other` and `stated`.

    Raises
    ------
    StructureError
        The document is no object, or a list in it is none.
    """
    if not isinstance(document, dict):
        raise StructureError(f"record must be an object; it is {document!r:.60}")
    known = {each.name: _nothing(each) for each in fields(cast(Any, kind)) if each.name not in _ABOUT}
    parts = {name: _part(name, document[name], nothing) for name, nothing in known.items() if name in document}
    other = {name: value for name, value in document.items() if name not in known}
    return cast(Any, kind)(**parts, other=other, stated=frozenset(parts))


def _nothing(part: Any) -> Any:
    return part.default if part.default is not MISSING else part.default_factory()


def _plain(name: str, value: Any) -> Any:
    if name == "domain":
        return {key: list(bounds) for key, bounds in value.items()}
    return list(value) if isinstance(value, tuple) else value


def _part(name: str, value: Any, nothing: Any) -> Any:
    if name == "domain":
        if not isinstance(value, dict) or not all(_is_list(bounds) and len(bounds) == 2 for bounds in value.values()):
            raise StructureError(f"record.domain must hold pairs of numbers; it is {value!r:.60}")
        return {key: (low, high) for key, (low, high) in value.items()}
    if isinstance(nothing, tuple):
        if not _is_list(value):
            raise StructureError(f"record.{name} must be a list; it is {value!r:.60}")
        return tuple(value)
    return value


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple)
