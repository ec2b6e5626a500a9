"""Drawings of dQ/dV and dV/dQ of a run and of the model, on the same axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench_service.cli.readout_page import Line, plot
from models.readouts.incremental_beside import Beside, beside

if TYPE_CHECKING:
    from models.comparison.simulated_runs import RunComparison

# The ends of the curve, steeper than its middle by more than this, would flatten all that lies between.
_STEEP = 5.0
_MEASURED, _SIMULATED = "#0b62a8", "#c2410c"


def incremental_parts(compared: RunComparison, capacity_Ah: float) -> list[str]:
    """HTML of the drawings of one run; none where no charge or discharge is long and slow enough to show stages.

    Parameters
    ----------
    compared : the run beside its free run
    capacity_Ah : of the model's cell
    """
    run = compared.run
    voltages_V = (run.voltage_V, compared.simulated_V)
    found = beside(run.time_s, run.current_A, run.charge_Ah, voltages_V, capacity_Ah)
    return [part for each in found for part in _drawn(each)]


def _drawn(found: Beside) -> list[str]:
    labels = (("measured", _MEASURED), ("simulated", _SIMULATED))
    slopes = found.dV_dQ_V_per_Ah
    steepest = _STEEP * float(np.nanmedian(slopes))
    cut = f", cut at {steepest:.2g} V/Ah" if np.nanmax(slopes) > steepest else ""
    by_voltage, by_charge = (
        [Line(label, x, rows[k], None, colour) for k, (label, colour) in enumerate(labels)]
        for x, rows in (
            (found.voltage_V, found.dQ_dV_Ah_per_V),
            (found.charge_Ah, np.minimum(slopes, steepest)),
        )
    )
    return [
        f"<h3>Stages of the electrodes, longest {found.way}, at {found.rate:.2g}C</h3>",
        f"<p>dQ/dV over voltage, smoothed over {1e3 * found.width_V:.3g} mV</p>",
        plot(by_voltage, "voltage / V", "Ah/V"),
        f"<p>dV/dQ over charge since the start, smoothed over {found.width_Ah:.2g} Ah{cut}</p>",
        plot(by_charge, "charge / Ah", "V/Ah"),
    ]
