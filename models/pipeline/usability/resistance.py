"""Resistance of the fitted model: whether it is known, and that of a thing that takes up energy."""

from __future__ import annotations

import numpy as np

from models.network.local_model_network import LocalModelNetwork
from models.pipeline.usability.bins import WIDTH, bin_of, in_words, ranges
from models.pipeline.usability.reason import Reason, limited, unusable
from models.readouts.resistance import ResistanceTable
from models.readouts.tables import tables_of

# A cell under load loses energy; a model that gains some at most of its points answers a load in the wrong direction.
_MOSTLY = 0.5
# Single points at the corners of the table lie outside of what was measured.
_CORNERS = 0.05
# A resistance whose standard deviation is half of it has 0 in its 95 % band.
_UNKNOWN = 0.5


def bad_resistance(network: LocalModelNetwork) -> list[Reason]:
    """Whether the model's resistance is negative, or not known, and where."""
    return judged_table(tables_of(network)[1])


def judged_table(table: ResistanceTable) -> list[Reason]:
    """Reasons of a table."""
    # The caller may have no current in a direction, or none at all.
    if table.resistance_Ohm.size == 0:
        return []
    with np.errstate(invalid="ignore"):
        wrong = ~(table.resistance_Ohm > 0.0)
    share = float(wrong.mean())
    if share >= _MOSTLY:
        return [
            unusable(
                f"the resistance of the model is negative or unknown at {100.0 * share:.0f} % of its points: it "
                "answers a load in the wrong direction. Look at the log's interval, the time stamps and the capacity, "
                "and record pulses that are logged every second"
            )
        ]
    found = []
    if share > _CORNERS:
        found.append(_where("negative", wrong, table))
    if table.std_Ohm is not None:
        open_ = ~wrong & ~(table.std_Ohm <= _UNKNOWN * np.abs(table.resistance_Ohm))
        if float(open_.mean()) > _CORNERS:
            found.append(_where("not known to better than its own size", open_, table))
    return found


def _where(what: str, bad: np.ndarray, table: ResistanceTable) -> Reason:
    parts = np.zeros(round(1.0 / WIDTH), bool)
    parts[bin_of(table.soc[bad.mean(axis=(0, 1)) > _CORNERS])] = True
    return limited(
        f"the resistance of the model is {what} at {100.0 * float(bad.mean()):.0f} % of its points (state of charge "
        f"{in_words(ranges(parts))}): do not trust voltages under load there; add pulses there"
    )
