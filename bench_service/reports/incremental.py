"""Drawings of dQ/dV and dV/dQ of a run and of the model, on the same axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench_service.reports import words
from bench_service.reports.document import Part
from bench_service.reports.drawing import BLUE, RUST, Axis, Line, curves

if TYPE_CHECKING:
    from models.comparison.simulated_runs import RunComparison
    from models.readouts.incremental_beside import Beside

# The ends of the curve, steeper than its middle by more than this, would flatten all that lies between.
_STEEP = 5.0
_LABELS = (("measured", BLUE), ("model", RUST))


def incremental_parts(compared: RunComparison, capacity_Ah: float) -> list[Part]:
    """Drawings of one run; none where no charge or discharge is long and slow enough to show stages.

    Parameters
    ----------
    compared : the run beside its free run
    capacity_Ah : of the model's cell
    """
    # Lazy: numba and scipy take 1.0 s.
    from models.readouts.incremental_beside import beside

    run = compared.run
    voltages_V = (run.voltage_V, compared.simulated_V)
    found = beside(run.time_s, run.current_A, run.charge_Ah, voltages_V, capacity_Ah)
    return [part for each in found for part in _drawn(each)]


def _drawn(found: Beside) -> list[Part]:
    slopes = found.dV_dQ_V_per_Ah
    steepest = _STEEP * float(np.nanmedian(slopes))
    cut = f", cut at {words.number(steepest, 2)} V/Ah" if np.nanmax(slopes) > steepest else ""
    by_voltage, by_charge = (
        [Line(label, x, rows[k], None, colour) for k, (label, colour) in enumerate(_LABELS)]
        for x, rows in ((found.voltage_V, found.dQ_dV_Ah_per_V), (found.charge_Ah, np.minimum(slopes, steepest)))
    )
    widths = words.number(1e3 * found.width_V), words.number(found.width_Ah, 2)
    return [
        f"Stages of the electrodes in the longest {found.way}, at {words.number(found.rate, 2)}C:",
        curves(f"dQ/dV over voltage, smoothed over {widths[0]} mV", by_voltage, Axis("voltage", "V"),
               Axis("dQ/dV", "Ah/V")),
        curves(f"dV/dQ over charge since the start, smoothed over {widths[1]} Ah{cut}", by_charge,
               Axis("charge", "Ah"), Axis("dV/dQ", "V/Ah")),
    ]  # fmt: skip
