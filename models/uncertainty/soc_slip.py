"""What a voltage may be wrong by because the state of charge behind it is: it slips along a curve that has a slope.

No fit shows this where each training run was counted from one full charge, or where runs differ in more than that. Near
empty, where the curve of an iron-phosphate cell falls by a volt over a tenth, a count that is off by one hundredth is
100 mV.
"""

from __future__ import annotations

import numpy as np

from models.data.resampling import GridRun
from models.data.timeseries import FloatArray
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.signals import soc_by_counting

# A charge "to full" ends within half a percent of the last one, as the current at which it is cut off stands for that.
_START_STD = 0.005
# One percent of the charge moved: a cycler's current is good to a part in some hundreds, and the capacity that three
# tests of one cell count differs as much (2.031, 2.031 and 2.018 Ah, see `docs/results.md`).
_MOVED_SHARE = 0.01
# A slip shows all along the curve: in its middle it is at most so much of what the model is known to be wrong by.
_UNSEEN = 0.5
_STEP = 1e-3


def slip_std_V(network: LocalModelNetwork, run: GridRun, initial_soc: float, known_std_V: FloatArray) -> FloatArray:
    """(n,) standard deviation of the free run by an uncertain state of charge.

    Parameters
    ----------
    network : the model
    run : on a grid of the network's sampling time
    initial_soc : fraction 0..1 from which charge is counted
    known_std_V : (n,) what else the free run may be wrong by; where that is little over the whole run, training runs
        have shown that their states of charge were good
    """
    # Away from the nearer end: beyond it the curve only goes on as it ended.
    step = _STEP if initial_soc < 0.5 else -_STEP
    slope_V = np.abs(free_run_V(network, run, initial_soc + step) - free_run_V(network, run, initial_soc)) / _STEP
    soc = soc_by_counting(run.charge_Ah, initial_soc, network.cell.capacity_Ah, network.cell.efficiency)
    slip_V = slope_V * np.hypot(_START_STD, _MOVED_SHARE * (soc - initial_soc))
    most_V, usual_V = _UNSEEN * float(np.median(known_std_V)), float(np.median(slip_V))
    low, high = network.record.domain["soc"]
    # A knee goes on to fall faster: by as much again as it is steeper than the curve on average.
    mean_slope_V = network.voltage_span_V / max(high - low, 1e-9)
    bent_V = np.maximum(slope_V - mean_slope_V, 0.0) * np.maximum(np.maximum(low - soc, soc - high), 0.0)
    return np.hypot(slip_V * min(1.0, most_V / max(usual_V, 1e-12)), bent_V)
