"""Quadratic penalties on the parameters of a network."""

from __future__ import annotations

from dataclasses import dataclass

from models.data.timeseries import FloatArray


@dataclass(frozen=True)
class Penalty:
    """A quadratic penalty that an estimate was found with.

    Attributes
    ----------
    matrix : (P, P) that was added to the information
    apart : (P,) estimate less the parameters at which the penalty is least
    """

    matrix: FloatArray
    apart: FloatArray
