"""Where a run begins: states that nobody knows, each with what it does to the voltage."""

from __future__ import annotations

import numpy as np

from models.data.timeseries import FloatArray
from models.diagnosis.known.cell import KnownCell
from models.diagnosis.known.thresholds import KNOWN
from models.effects.view import View
from models.network.signals import parse_signal

# The first columns are of the state of charge, which stays; the other ones fade.
SOC_COLUMNS = 2


def start_columns(cell: KnownCell, view: View, soc_std: float) -> FloatArray:
    """(m, k) V that one standard deviation of each unknown state at the start makes at a run's samples.

    The state of charge (`SOC_COLUMNS`), the place in the hysteresis loop, polarisation of each branch of the model and
    of branches that it does not have, the surface's lead.

    Parameters
    ----------
    cell : the known cell
    view : run and samples
    soc_std : standard deviation of the stated state of charge
    """
    index, at = view.index, KNOWN
    # What flowed before a log, where it is known, stands in front of it.
    time_s = view.run.time_s[index] - view.run.time_s[0]
    passed = view.throughput_Ah[index] / view.capacity_Ah
    soc = view.soc[index] + view.inputs.surface
    above, here, below = (cell.open_circuit_V(soc + each) for each in (soc_std, 0.0, -soc_std))
    # A wide statement reaches where the curve bends.
    columns: list[FloatArray] = [
        0.5 * (above - below),
        0.5 * (above + below) - here,
        at.start_V * np.exp(-at.start_loop * passed),
    ]
    signals = np.zeros((len(cell.layout.basis.terms), len(index)))
    for b, term in enumerate(cell.layout.basis.terms):
        signal = parse_signal(term.signal)
        if signal.kind == "hysteresis_state":
            signals[b] = np.exp(-signal.get("rate") * passed) / cell.layout.scale[b]
        elif signal.get("time_constant_s"):
            signals[b] = at.start_share * cell.usual[b] * np.exp(-time_s / signal.get("time_constant_s"))
        else:
            continue
        columns.append(cell.through(signals, soc, np.array([b])))
        signals[b] = 0.0
    usual_A = at.start_share * float(cell.usual_A)
    columns += [at.start_of_typical * cell.typical_Ohm * usual_A * np.exp(-time_s / tau_s) for tau_s in at.start_s]
    axis = parse_signal(cell.layout.basis.axis)
    if axis.get("depth"):
        lead = axis.get("depth") * usual_A / view.capacity_Ah
        columns.append(lead * view.slope_V * np.exp(-time_s / axis.get("time_constant_s")))
    return np.column_stack(columns)
