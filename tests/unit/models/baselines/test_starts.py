"""Where a log begins, for circuits as for networks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.baselines import fit_equivalent_circuit
from models.comparison.start import Start, free_run_from_V
from models.comparison.start_fit import start_from_run
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries
from models.network.free_run import memory_s
from tests.unit.models.baselines import circuits


def test_a_circuit_is_started_in_the_middle_of_a_pulse() -> None:
    model = fit_equivalent_circuit([circuits.run(6000, 1)], capacity_Ah=circuits.CAPACITY_AH)
    assert memory_s(model) == pytest.approx(4.0 * circuits.TAU2_S, rel=0.2)
    whole = circuits.run(5000, 2)
    loaded = 1000 + int(np.argmax(np.abs(whole.current_A[1000:]) > 2.5))
    assert whole.soc_ref is not None
    kept = slice(loaded + 5, None)
    cut = TimeSeries(
        whole.time_s[kept], whole.current_A[kept], whole.voltage_V[kept], whole.temperature_degC[kept], name="cut"
    )
    run, stated = to_grid(cut, 1.0), Start(float(whole.soc_ref[kept][0]))

    def first_minutes_V(start: Start) -> float:
        return float(np.sqrt(np.mean((run.voltage_V - free_run_from_V(model, run, start))[:300] ** 2)))

    found = start_from_run(model, run, stated)
    assert found.history is not None
    assert first_minutes_V(stated) > 3e-3 and first_minutes_V(found) < 1e-3
    believed = start_from_run(model, run, replace(stated, initial_soc=stated.initial_soc + 0.05, soc_std=0.05))
    assert believed.initial_soc == pytest.approx(stated.initial_soc, abs=0.01)
