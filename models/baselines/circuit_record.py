"""What an equivalent circuit was made from and how well it did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Self

from models.baselines.samples import Samples
from models.baselines.variable_projection import Fitted
from models.network.model_record import AddedEffect, Domain, Json, read, written


@dataclass(frozen=True, kw_only=True)
class CircuitRecord:
    """What a circuit was made from and how well it did; a part that says nothing is None or empty.

    Attributes
    ----------
    domain : ranges of the training data
    train_runs : names of the runs
    n_samples : that the fit used
    train_rmse_mV, held_out_rmse_mV : error of the free run on the runs, and on samples that the fit did not see
    log_strengths : logarithms of the penalties' strengths
    effects : that were added to the circuit; nothing here adds any
    other, stated : as in `models.network.model_record.ModelRecord`
    """

    domain: Domain = field(default_factory=dict)
    train_runs: tuple[str, ...] = ()
    n_samples: int | None = None
    train_rmse_mV: float | None = None
    held_out_rmse_mV: float | None = None
    log_strengths: tuple[float, ...] = ()
    effects: tuple[AddedEffect, ...] = ()
    other: Json = field(default_factory=dict)
    stated: frozenset[str] = field(default=frozenset(), compare=False)

    def to_json(self) -> Json:
        """Return a document of plain types."""
        return written(self)

    @classmethod
    def from_json(cls, document: Any) -> Self:
        """Read what `to_json` wrote; StructureError where it is no object or a list in it is none."""
        return read(cls, document)


def circuit_record(samples: Samples, found: Fitted) -> CircuitRecord:
    """Record of a fit."""
    return CircuitRecord(
        domain=samples.domain(),
        train_runs=tuple(samples.names),
        n_samples=int((samples.fold >= 0).sum()),
        train_rmse_mV=1e3 * found.train_rmse_V,
        held_out_rmse_mV=1e3 * found.held_out_rmse_V,
        log_strengths=tuple(found.log_strengths),
    )
