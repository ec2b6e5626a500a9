"""What a comparison asks of a model of a cell, whatever is inside."""

from __future__ import annotations

from typing import Any, Protocol, Self

from models.network.model_record import AddedEffect, Domain
from models.network.regression import CellContext


class CellRecord(Protocol):
    """What a comparison asks of the record of a model, whatever kind of model it is.

    Attributes
    ----------
    domain : ranges of the training data
    effects : that were added to the model; some are put right in a run's columns before the model sees them
    """

    @property
    def domain(self) -> Domain:
        """Ranges of the training data."""
        ...

    @property
    def effects(self) -> tuple[AddedEffect, ...]:
        """Effects that were added to the model."""
        ...


class CellModel(Protocol):
    """A model that simulates a run from its current and temperature alone.

    Attributes
    ----------
    name : what a person calls it
    dt_s : step in s of the grid that it was made on and is compared on
    cell : capacity and efficiency that turn current into state of charge
    record : what the model was made from
    """

    @property
    def name(self) -> str:
        """What a person calls the model."""
        ...

    @property
    def dt_s(self) -> float:
        """Step in s of the grid that the model was made on."""
        ...

    @property
    def cell(self) -> CellContext:
        """Capacity and efficiency."""
        ...

    @property
    def record(self) -> CellRecord:
        """What the model was made from."""
        ...

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types with its schema version and kind."""
        ...

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Self:
        """Read what `to_json` wrote."""
        ...
