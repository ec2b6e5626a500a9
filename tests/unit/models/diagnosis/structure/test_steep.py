import numpy as np
import pytest

from models.data.resampling import GridRun, to_grid
from models.data.timeseries import FloatArray
from models.diagnosis.reference.record import Record
from models.diagnosis.structure import steep
from models.network.local_model_network import LocalModelNetwork
from tests.unit.models.diagnosis.cells import SOC, bare, measured

RUN = to_grid(measured(bare(), 1), 1.0)
KNEE_V, USUAL_V = 8.0, 1.0


def without_steep(n_steep: int, monkeypatch: pytest.MonkeyPatch, network: LocalModelNetwork | None = None) -> GridRun:
    def slope(_network: object, _run: GridRun, _soc: float, index: np.ndarray) -> FloatArray:
        return np.where(index < n_steep, KNEE_V, USUAL_V)

    monkeypatch.setattr(steep, "slope_V", slope)
    return steep.without_steep(network, [RUN], [SOC])[0]  # pyright: ignore[reportArgumentType]


def test_voltages_that_half_a_point_of_charge_decides_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    left = without_steep(500, monkeypatch)
    assert np.isnan(left.voltage_V[:500]).all()
    assert not left.measured[:500].any()
    assert np.array_equal(left.voltage_V[500:], RUN.voltage_V[500:], equal_nan=True)
    assert np.array_equal(left.charge_Ah, RUN.charge_Ah)


def test_a_record_that_stays_there_is_judged_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert without_steep(len(RUN) - 10, monkeypatch) is RUN


def test_a_record_says_its_error_of_what_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    error_V = np.where(np.arange(len(RUN)) < 500, 0.3, 0.01)
    whole = Record([RUN], [SOC], [error_V])
    left = whole.of([without_steep(500, monkeypatch)])
    assert left.rms_mV == pytest.approx(10.0)
    assert whole.n_measured - left.n_measured == 500
