"""What a comparison asks of a model of a cell, whatever is inside."""

from __future__ import annotations

from typing import Any, Protocol, Self

from models.network.regression import CellContext


class CellModel(Protocol):
    """A model that simulates a run from its current and temperature alone.

    Attributes
    ----------
    name : what a person calls it
    dt_s : step in s of the grid that it was made on and is compared on
    cell : capacity and efficiency that turn current into state of charge
    record : what the model was made from; `record["domain"]` holds the ranges of the training data
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
    def record(self) -> dict[str, Any]:
        """What the model was made from; plain types."""
        ...

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types with its schema version and kind."""
        ...

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> Self:
        """Read what `to_json` wrote."""
        ...
