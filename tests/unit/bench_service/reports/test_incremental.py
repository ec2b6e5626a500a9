"""dQ/dV and dV/dQ in the report of a comparison."""

from xml.etree import ElementTree

import numpy as np

from bench_service.reports.document import Figure
from bench_service.reports.incremental import incremental_parts
from models.comparison.simulated_runs import RunComparison
from models.data.resampling import to_grid
from models.data.timeseries import TimeSeries

N = 6000


def compared(rate: float) -> RunComparison:
    current = np.full(N, rate * 2.0)
    charge = np.cumsum(current) / 360.0
    voltage = 3.4 + 0.4 * charge + 0.03 * np.tanh((charge - 1.0) / 0.05) - 0.8 * np.exp(-charge / 0.02)
    run = to_grid(TimeSeries(10.0 * np.arange(N), current, voltage, np.full(N, 25.0), None), 10.0)
    return RunComparison(run, voltage + 0.01, charge / 2.0, np.ones(N, dtype=bool))


def test_both_curves_are_drawn_with_their_widths_and_where_they_are_cut() -> None:
    parts = incremental_parts(compared(0.06), 2.0)
    drawings = [each for each in parts if isinstance(each, Figure)]
    text = " ".join(each.caption if isinstance(each, Figure) else str(each) for each in parts)
    assert "longest charge, at 0.060C" in text and "smoothed over 10.0 mV" in text
    assert "smoothed over 0.020 Ah, cut at" in text
    assert len(drawings) == 2
    for each in drawings:
        assert len(list(ElementTree.fromstring(each.svg).iter("polyline"))) == 2
        assert [entry.label for entry in each.legend] == ["measured", "model"]


def test_a_fast_charge_is_not_drawn() -> None:
    assert incremental_parts(compared(3.0), 2.0) == []
