"""Parameters of an effect with their standard deviations, out of its evidence."""

from __future__ import annotations

import numpy as np

from models.diagnosis.evidence.parameters import Value
from models.diagnosis.likelihood.analysis import Analysis
from models.diagnosis.likelihood.shapes import Linear
from models.diagnosis.likelihood.tried import Tried


def values_of(analysis: Analysis, tried: Tried) -> dict[str, Value]:
    """Parameters of an effect with their standard deviations, by name."""
    found = analysis.sizes[tried.effect.name]
    shape, mean, covariance = tried.shape, found.mean, found.covariance
    if isinstance(shape, Linear):
        out = {}
        for told in shape.told:
            weights = np.array(told.weights)
            std = float(np.sqrt(max(weights @ covariance @ weights, 0.0)))
            out[told.name] = Value(told.base + float(weights @ mean), std, told.unit)
        return out | {name: Value(value, None, unit) for name, unit, value in shape.fixed}
    at = np.array(shape.physical(mean))
    steps = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
    slopes = np.array(
        [np.array(shape.physical(mean + s * u)) - at for s, u in zip(steps, np.eye(len(mean)), strict=True)]
    )
    slopes = slopes / steps[:, None]
    stds = np.sqrt(np.maximum(np.einsum("ip,ij,jp->p", slopes, covariance, slopes), 0.0))
    return {
        each.name + (shape.of if k == 0 else ""): Value(float(value), float(std), each.unit)
        for k, (each, value, std) in enumerate(zip(tried.effect.parameters, at, stds, strict=False))
    }
