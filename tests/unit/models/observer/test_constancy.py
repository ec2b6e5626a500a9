"""A constant that moved while it was estimated is told with a band that takes it in."""

import numpy as np
import pytest

from models.observer.constancy import wandered, with_honest_bands
from models.observer.filter import places

STD = np.linspace(0.05, 0.001, 200)


def rows(offset_A: np.ndarray) -> np.ndarray:
    out = np.zeros((len(offset_A), places.N_OUT))
    out[:, places.OFFSET_OUT], out[:, places.OFFSET_OUT + 1] = offset_A, STD
    return out


def test_an_estimate_that_settles_keeps_its_band() -> None:
    settling = 0.03 + 0.5 * STD
    assert wandered(settling, STD) == 0.0
    told = {"current_offset_A": {"value": float(settling[-1]), "std": 0.001}, "capacity_Ah": None}
    assert with_honest_bands(told, rows(settling)) == (told, [])


def test_one_that_moves_away_is_told_with_a_wide_band() -> None:
    moving = np.where(np.arange(200) < 150, -0.1, 0.1)
    told = {"current_offset_A": {"value": 0.1, "std": 0.001}, "capacity_Ah": None}
    found, remarks = with_honest_bands(told, rows(moving))
    offset = found["current_offset_A"]
    assert offset is not None
    assert offset["value"] == 0.1
    assert offset["std"] == pytest.approx(0.08, abs=0.02)
    assert "did not stand still" in remarks[0]
    assert "mA" in remarks[0]
