"""What a fitted network does not know, as its document carries it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.errors import ModelError
from models.data.timeseries import FloatArray
from models.network.local_model_network import LocalModelNetwork
from models.uncertainty.correlation import ResidualCorrelation
from models.uncertainty.covariance import ParameterCovariance
from models.uncertainty.expansion import Expansion

SCHEMA_VERSION = 1
# Of the covariance's factor, which is better conditioned than the covariance itself.
_DIGITS = 7


@dataclass(frozen=True)
class Uncertainty:
    """What a network does not know.

    Attributes
    ----------
    parameters : covariance of the parameters, normalised units
    level_V : (M,) standard deviation of the held-out error near each local model
    samples, effective_samples : (M,) samples, of those that the fit used, at which a local model weighs most, and how
        many independent ones they are worth
    thin : (M,) whether a local model has too little data of its own
    band_factor : by how much bands are widened so that 95 % of the held-out training samples lie within
    correlation : of the held-out errors, from one sample of the model's grid to the next
    """

    parameters: ParameterCovariance
    level_V: FloatArray
    samples: FloatArray
    effective_samples: FloatArray
    thin: np.ndarray
    band_factor: float
    correlation: ResidualCorrelation

    def to_json(self) -> dict[str, Any]:
        """Return a document of plain types; the factor's lower triangle is rounded to seven digits."""
        size, expansion = len(self.parameters.factor), self.parameters.expansion
        triangle = self.parameters.factor[np.tril_indices(size)]
        local = zip(
            self.samples,
            self.effective_samples,
            self.parameters.data_share,
            1e3 * self.level_V,
            self.thin,
            strict=True,
        )
        return {
            "schema_version": SCHEMA_VERSION,
            "kind": "parameter_uncertainty",
            "n_free": size,
            "n_shared": self.parameters.n_shared,
            **({} if expansion is None else {"expansion": expansion.to_json()}),
            "covariance_factor": [float(f"{value:.{_DIGITS}g}") for value in triangle],
            "band_factor": self.band_factor,
            "correlation": {
                "white": self.correlation.white,
                "shares": self.correlation.shares.tolist(),
                "keep": self.correlation.keep.tolist(),
            },
            "local_models": [
                {
                    "samples": float(n),
                    "effective_samples": float(independent),
                    "data_share": float(share),
                    "residual_std_mV": float(level_mV),
                    "thin": bool(thin),
                }
                for n, independent, share, level_mV, thin in local
            ],
        }

    @classmethod
    def from_json(cls, document: dict[str, Any], n_models: int, order: int) -> Uncertainty:
        """Read what `to_json` wrote.

        Raises
        ------
        ModelError
            It is no such document, damaged, or does not fit the network.
        """
        known = isinstance(document, dict) and document.get("kind") == "parameter_uncertainty"
        if not known or document.get("schema_version") != SCHEMA_VERSION:
            raise ModelError(f"not a parameter uncertainty of schema version {SCHEMA_VERSION}")
        try:
            size, n_shared = int(document["n_free"]), int(document["n_shared"])
            triangle = np.array(document["covariance_factor"], dtype=np.float64)
            factor = np.zeros((size, size))
            factor[np.tril_indices(size)] = triangle.reshape(size * (size + 1) // 2)
            local = document["local_models"]
            columns = {key: np.array([row[key] for row in local], float) for key in local[0]}
            memory = document["correlation"]
            correlation = ResidualCorrelation(
                float(memory["white"]), np.array(memory["shares"], float), np.array(memory["keep"], float)
            )
            expansion = Expansion.from_json(document["expansion"]) if "expansion" in document else None
            parameters = ParameterCovariance(factor, n_shared, n_models, order, columns["data_share"], expansion)
            out = cls(
                parameters,
                1e-3 * columns["residual_std_mV"],
                columns["samples"],
                columns["effective_samples"],
                columns["thin"] > 0.0,
                float(document["band_factor"]),
                correlation,
            )
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise ModelError(f"parameter uncertainty is damaged: {error!r}") from None
        if expansion is not None:
            fits = len(expansion.centres) == n_models and expansion.size == size
        else:
            fits = n_shared in (0, order) and (size - n_shared) % n_models == 0
        if len(local) != n_models or not fits:
            raise ModelError(f"parameter uncertainty is of another network: {len(local)} local models, not {n_models}")
        return out


def uncertainty_of(network: LocalModelNetwork) -> Uncertainty | None:
    """Read what a network's record says of it; None where it says nothing."""
    document = network.record.uncertainty
    if document is None:
        return None
    return Uncertainty.from_json(document, network.n_models, network.structure.output_order)
