"""Parts of the state of charge that no run has measured."""

from __future__ import annotations

import numpy as np

from models.pipeline.training import Training
from models.pipeline.usability.bins import WIDTH, bin_of, in_words, ranges
from models.pipeline.usability.reason import Reason, limited

# A run that stays within this shows one level of charge, not a curve over it.
_ONE_LEVEL = 0.1


def not_covered(data: Training) -> list[Reason]:
    """Whether all runs leave the same part of the charge out, or stay at one level."""
    measured = np.concatenate(
        [soc[run.measured] for run, soc in zip(data.grid, data.counted_soc(), strict=True)] or [np.zeros(0)]
    )
    low, high = float(measured.min()), float(measured.max())
    found = []
    if high - low < _ONE_LEVEL:
        found.append(
            limited(
                f"the runs stay at a state of charge of {low:.2f} to {high:.2f}: the model holds there only; record "
                "runs over the range that it is for"
            )
        )
    visited = np.zeros(round(1.0 / WIDTH), bool)
    visited[bin_of(measured)] = True
    between = np.zeros_like(visited)
    between[int(bin_of(np.array(low))) : int(bin_of(np.array(high)))] = True
    gaps = ranges(between & ~visited)
    if gaps:
        found.append(
            limited(
                f"no run measured anything at a state of charge of {in_words(gaps)}: what the model says there is "
                "drawn from either side; record a run through it"
            )
        )
    return found
