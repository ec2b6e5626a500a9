import numpy as np
import pytest

from models.data.errors import ModelError
from models.design.constraints.limits import Limits
from models.design.sequence.excitation_sequence import build_sequence
from models.design.sequence.repeatability import repeatability
from models.design.sequence.sequence_plan import SequencePlan

PLAN = SequencePlan(Limits((-4.0, 2.0), (0.1, 0.9)), 2.0, 0.5, 1.0, (0.3, 0.6), 400.0, 100.0)


def block(soc: float, number: int, change: float) -> np.ndarray:
    current = np.random.default_rng(number).choice([-1.0, 1.0], 399)
    return np.append(current - current.mean(), 0.0)


def test_a_cell_without_memory_repeats_itself_to_its_noise() -> None:
    sequence = build_sequence(PLAN, block)
    current = sequence.current_A
    soc = 0.5 + np.cumsum(current) / 7200.0
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(current))
    found = repeatability(sequence.blocks, current, 3.3 + 0.5 * soc + 0.03 * current + noise)
    assert found.over_noise == pytest.approx(1.0, abs=0.1) and abs(found.bias_V) < 3e-4
    drifting = 3.3 + 0.5 * soc + 0.03 * current + noise + 5e-3 * np.arange(len(current)) / len(current)
    assert repeatability(sequence.blocks, current, drifting).bias_V > 3e-4


def test_without_a_repetition_nothing_can_be_said() -> None:
    sequence = build_sequence(PLAN, block)
    with pytest.raises(ModelError, match="no block"):
        repeatability(sequence.blocks[:-1], sequence.current_A, sequence.current_A)
    with pytest.raises(ModelError, match="both times"):
        repeatability(sequence.blocks, sequence.current_A, np.full(len(sequence.current_A), np.nan))
