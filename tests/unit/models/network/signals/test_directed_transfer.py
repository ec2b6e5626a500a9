import numpy as np
import pytest

from models.network.signals import Held, RunSignals, Step, parse_signal

CURRENT_A = np.array([0.0, 2.0, -3.0, 0.0, 1.0, -1.0])
CHARGE, DISCHARGE = "directed_transfer:1/2", "directed_transfer:-1/2"


def values(name: str) -> np.ndarray:
    n = len(CURRENT_A)
    return RunSignals(CURRENT_A, np.full(n, 25.0), np.full(n, 0.5), 1.0, 2.0).values(name)


def test_each_direction_has_its_own() -> None:
    assert values(CHARGE) == pytest.approx(np.arcsinh(np.maximum(CURRENT_A, 0.0) / 2.0))
    assert values(DISCHARGE) == pytest.approx(np.arcsinh(np.minimum(CURRENT_A, 0.0) / 2.0))
    # Both together are what knows no direction.
    assert values(CHARGE) + values(DISCHARGE) == pytest.approx(values("charge_transfer:2"))
    slowed = [values(f"{name}/0/30") for name in (CHARGE, DISCHARGE, "charge_transfer:2")]
    assert slowed[0] + slowed[1] == pytest.approx(slowed[2])


def test_held_points_and_steps_agree_with_it() -> None:
    n = len(CURRENT_A)
    same = np.full(n, 25.0), np.full(n, 0.5), np.ones(n)
    signal = parse_signal(DISCHARGE)
    assert signal.definition.settled(signal, Held(CURRENT_A, *same, 2.0)) == pytest.approx(values(DISCHARGE))
    slow = parse_signal("directed_transfer:-1/2/0/30")
    current_A = np.concatenate([np.full(1, 1.0), np.full(n - 1, -4.0)])
    step = Step(current_A, *same, np.maximum(np.arange(n), 0), 1.0, 2.0)
    after = slow.definition.after_step(slow, step)
    assert after[0] == 0.0 and np.all(np.diff(after) < 0.0)
