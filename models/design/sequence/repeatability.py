"""How well a cell repeats itself: the same block played twice, against the measurement's noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.data.errors import ModelError
from models.data.metrics import noise_floor_V
from models.data.timeseries import FloatArray
from models.design.sequence.excitation_sequence import Block


@dataclass(frozen=True)
class Repeatability:
    """Difference of a block and its repetition.

    Attributes
    ----------
    rms_V : of the difference, over sqrt(2): what one measurement differs by
    bias_V : mean difference, repetition minus block
    noise_V : of the measurement; NaN where it cannot be told
    """

    rms_V: float
    bias_V: float
    noise_V: float

    @property
    def over_noise(self) -> float:
        """Near 1 where nothing but the noise differs; above it the history was not cleared, or the cell has changed."""
        return self.rms_V / self.noise_V


def repeatability(blocks: Sequence[Block], current_A: FloatArray, voltage_V: FloatArray) -> Repeatability:
    """Compare the repeated block of a sequence with the first time.

    Parameters
    ----------
    blocks : of the sequence; one of them repeats another
    current_A : (N,) that was played
    voltage_V : (N,) measured at the end of each sample; NaN where missing

    Raises
    ------
    ModelError
        No block was repeated, or none of its samples was measured both times.
    """
    again = next((block for block in blocks if block.repeats is not None), None)
    if again is None or again.repeats is None:
        raise ModelError("repeatability: no block of the sequence was repeated")
    first = blocks[again.repeats]
    difference = voltage_V[again.first : again.last] - voltage_V[first.first : first.last]
    known = difference[~np.isnan(difference)]
    if len(known) == 0:
        raise ModelError("repeatability: no sample of the repeated block was measured both times")
    rms_V = float(np.sqrt(np.mean(known**2) / 2.0))
    return Repeatability(rms_V, float(known.mean()), noise_floor_V(voltage_V, current_A))
