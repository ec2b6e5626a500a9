import numpy as np
import pytest

from models.network.signals import RunSignals


def test_squared_current_keeps_the_sign() -> None:
    n = 4000
    for level in (-3.0, 2.0):
        run = RunSignals(np.full(n, level), np.full(n, 25.0), np.full(n, 0.5), 1.0, 2.0)
        assert run.values("squared_current:60/3000")[-1] == pytest.approx(level * abs(level))
