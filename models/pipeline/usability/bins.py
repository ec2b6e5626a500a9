"""Parts of the state of charge: where the runs were, and how ranges of it are told."""

from __future__ import annotations

import numpy as np

from models.data.stretches import stretches
from models.data.timeseries import FloatArray

WIDTH = 0.05


def bin_of(soc: FloatArray) -> np.ndarray:
    """(n,) part that each value lies in; what is below 0 or above 1 belongs to the part at the end."""
    return np.clip((np.asarray(soc) / WIDTH).astype(np.int64), 0, round(1.0 / WIDTH) - 1)


def ranges(chosen: np.ndarray) -> list[tuple[float, float]]:
    """Lowest and highest state of charge of each stretch of chosen parts."""
    return [(low * WIDTH, high * WIDTH) for low, high in stretches(chosen)]


def in_words(found: list[tuple[float, float]]) -> str:
    """Ranges as a person reads them."""
    return ", ".join(f"{low:.2f} to {high:.2f}" for low, high in found)
