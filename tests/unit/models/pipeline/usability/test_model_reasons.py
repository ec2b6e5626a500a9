"""What a model itself says: resistances that cannot be, and errors that are too large."""

import numpy as np

from models.data.metrics import metrics
from models.pipeline.usability.error import misses_runs
from models.pipeline.usability.reason import Verdict
from models.pipeline.usability.resistance import judged_table
from models.readouts.resistance import ResistanceTable

SOC = np.linspace(0.0, 1.0, 21)


def table(resistance_Ohm: np.ndarray, std_Ohm: float | None = 1e-3) -> ResistanceTable:
    values = np.broadcast_to(resistance_Ohm, (2, 1, len(SOC))).copy()
    std = None if std_Ohm is None else np.full_like(values, std_Ohm)
    return ResistanceTable(np.array([-1.0, 1.0]), np.array([25.0]), SOC, values, std)


def test_a_resistance_that_is_negative_nearly_everywhere_cannot_be_used() -> None:
    (found,) = judged_table(table(np.where(SOC < 0.8, -0.02, 0.02)))
    assert found.verdict == Verdict.UNUSABLE
    assert "wrong direction" in found.text


def test_a_resistance_that_is_negative_in_part_is_limited_there() -> None:
    (found,) = judged_table(table(np.where(SOC < 0.2, -0.02, 0.02)))
    assert found.verdict == Verdict.LIMITED
    assert "negative" in found.text
    assert "0.00 to 0.20" in found.text
    (missing,) = judged_table(table(np.where(SOC > 0.8, np.nan, 0.02)))
    assert "negative" in missing.text


def test_a_resistance_within_its_own_band_is_not_known() -> None:
    (found,) = judged_table(table(np.where(SOC < 0.2, 1e-3, 0.02)))
    assert "not known" in found.text
    assert judged_table(table(np.full(21, 0.02))) == []
    assert judged_table(table(np.full(21, 0.02), None)) == []


def test_a_model_that_misses_its_runs() -> None:
    measured = np.linspace(3.0, 4.0, 101)
    good, poor, useless = (metrics(measured, measured + off) for off in (0.01, 0.08, 0.3))
    assert misses_runs(good, None) == []
    (found,) = misses_runs(good, poor)
    assert found.verdict == Verdict.LIMITED
    assert "the runs that judge it by 80 mV" in found.text
    (found,) = misses_runs(useless, good)
    assert found.verdict == Verdict.UNUSABLE
