"""A network, a run and what a comparison says of them: small enough for a test, complete enough for a report."""

import numpy as np

from models.data.timeseries import TimeSeries
from tests.unit.models import hand_network

NETWORK = hand_network.everything(1)
SOC = 0.5


def _run() -> TimeSeries:
    n = 400
    current_A = np.where(np.arange(n) // 40 % 2, 1.0, -1.0)
    voltage_V = 3.6 + 0.03 * current_A + 1e-3 * np.random.default_rng(1).normal(size=n)
    time_s = hand_network_dt_s() * np.arange(n)
    return TimeSeries(time_s, current_A, voltage_V, np.full(n, 25.0), np.full(n, 25.0), name="run one")


def hand_network_dt_s() -> float:
    """Sampling time of the network."""
    return NETWORK.structure.dt_s


RUN = _run()
