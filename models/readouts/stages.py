"""Stages of the electrodes over a life: dQ/dV and dV/dQ of some of its runs, measured and by the model as it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.readouts.incremental_beside import Beside, beside

# Runs that are looked at, spread over the life, and those of either direction that are told.
_LOOKED_AT, _TOLD = 24, 4


@dataclass(frozen=True)
class Stages:
    """One run.

    Attributes
    ----------
    run, at : its name and place along the life
    curves : of its longest charge or discharge; the first row is measured, the second that of the model
    """

    run: str
    at: float
    curves: Beside

    def to_json(self) -> dict[str, Any]:
        """Return an entry of `stages` of the public contract; null where a voltage or a charge never came."""
        found = self.curves
        sources = {
            name: {"dQ_dV_Ah_per_V": _plain(found.dQ_dV_Ah_per_V[k]), "dV_dQ_V_per_Ah": _plain(found.dV_dQ_V_per_Ah[k])}
            for k, name in enumerate(("measured", "model"))
        }
        return {
            "run": self.run,
            "at": self.at,
            "way": found.way,
            "rate_1_per_h": found.rate,
            "voltage_V": found.voltage_V.tolist(),
            "charge_Ah": found.charge_Ah.tolist(),
            "width_V": found.width_V,
            "width_Ah": found.width_Ah,
        } | sources


def stages_of(runs: Sequence[tuple[GridRun, FloatArray]], at: FloatArray, capacity_Ah: float) -> tuple[Stages, ...]:
    """Curves of some runs, spread over the life; of none that is too short or too fast to show stages.

    Parameters
    ----------
    runs : in the order of the life, each with the error of the model of the cell as it was, measured less simulated
    at : (n,) their places
    capacity_Ah : of the fresh cell
    """
    found: dict[str, list[Stages]] = {}
    for k in _spread(len(runs), _LOOKED_AT):
        run, error_V = runs[k]
        voltages_V = (run.voltage_V, run.voltage_V - error_V)
        for each in beside(run.time_s, run.current_A, run.charge_Ah, voltages_V, capacity_Ah):
            found.setdefault(each.way, []).append(Stages(run.name, float(at[k]), each))
    return tuple(every[k] for every in found.values() for k in _spread(len(every), _TOLD))


def _spread(count: int, most: int) -> list[int]:
    """At most so many numbers below a count, spread evenly, the first and the last among them."""
    return np.unique(np.round(np.linspace(0, count - 1, min(count, most))).astype(np.int64)).tolist()


def _plain(values: FloatArray) -> list[float | None]:
    return [float(each) if np.isfinite(each) else None for each in values]
