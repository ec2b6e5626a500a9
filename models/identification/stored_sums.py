"""What runs that may be gone have said of a network's parameters: sums of products, as one document."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork

SCHEMA_VERSION = 1


@dataclass(frozen=True)
class StoredSums:
    """Sums of products of the free run's sensitivities over runs that may be gone.

    Attributes
    ----------
    information : (P, P) at the parameters of the model it is stored with, normalised units
    n_samples : samples in the sums
    squared_error : sum of the squared free-run error, normalised units
    """

    information: FloatArray
    n_samples: float
    squared_error: float

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types; the matrix as base64 of its upper triangle (little-endian float64)."""
        upper = self.information[np.triu_indices(len(self.information))].astype("<f8")
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "stored_sums",
            "size": len(self.information),
            "information": base64.b64encode(upper.tobytes()).decode(),
            "n_samples": self.n_samples,
            "squared_error": self.squared_error,
        }

    @classmethod
    def from_json(cls, document: dict[str, Any]) -> StoredSums:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is something else, or damaged.
        """
        if document.get("kind") != "stored_sums" or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not stored sums of schema version {SCHEMA_VERSION}")
        try:
            size = int(document["size"])
            upper = np.frombuffer(base64.b64decode(document["information"]), dtype="<f8").astype(np.float64)
            information = np.zeros((size, size))
            information[np.triu_indices(size)] = upper
            counted = float(document["n_samples"]), float(document["squared_error"])
        except (KeyError, TypeError, ValueError) as error:
            raise ModelError(f"stored sums are damaged: {error!r}") from None
        if not (np.isfinite(upper).all() and np.isfinite(counted).all()):
            raise ModelError("stored sums are damaged: they hold values that are not finite")
        return cls(information + np.triu(information, 1).T, *counted)


def sums_of(network: LocalModelNetwork) -> StoredSums | None:
    """Read what a network's record keeps of its training runs; None where it keeps nothing."""
    document = network.record.sums
    return None if document is None else StoredSums.from_json(document)
