"""What flowed while samples were lost is told by the voltage after them; a log that lost none is left alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from models.data.lost_samples import lost_spans, with_lost_samples
from models.data.timeseries import FloatArray, TimeSeries
from models.network.free_run import free_run_V
from models.network.local_model_network import LocalModelNetwork
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.plans import HeldOutError
from models.pipeline.request.lost_current import with_lost_currents
from models.pipeline.training import Training, training
from tests.unit.models.hand_network import CAPACITY_AH, SCALING, grid_run, network

# A pulse of six samples out of a rest, all of which are lost.
PULSE = slice(1500, 1506)


@dataclass(frozen=True)
class Known:
    """A network that needs no fit, with its error on data."""

    network: LocalModelNetwork
    data: Training

    def held_out(self) -> HeldOutError:
        (run,) = self.data.grid
        error_V = run.voltage_V - free_run_V(self.network, run, 0.5)
        return HeldOutError(np.array([np.nanmean(error_V**2)]), np.ones(1))


def cell() -> LocalModelNetwork:
    inputs = (InputChannel("soc", delay=1), InputChannel("current"), InputChannel("low_pass:15"))
    structure = Structure(0, inputs, (PartitionAxis("soc", initial=3, k_sigma=0.5),), 1.0)
    rows = [[slope, 0.014, 0.02, offset] for slope, offset in ((0.9, 3.1), (0.4, 3.25), (0.8, 3.1))]
    return network(structure, np.array(rows), scaling={**SCALING, "low_pass:15": (-3, 3)})


def log() -> TimeSeries:
    rng = np.random.default_rng(1)
    current_A = np.repeat(rng.uniform(-3.0, 3.0, 100), 40)
    current_A[1400:1600] = 0.0
    current_A[PULSE] = -3.0
    run = grid_run(current_A, 25.0)
    voltage_V = free_run_V(cell(), run, 0.5) + 1e-3 * rng.standard_normal(len(run))
    soc_ref = np.where(run.time_s == 0.0, 0.5, np.nan)
    return TimeSeries(run.time_s, run.current_A, voltage_V, np.full(len(run), 25.0), None, soc_ref, "log")


def half(run: TimeSeries) -> TimeSeries:
    kept = np.random.default_rng(3).random(len(run)) < 0.5
    kept[[0, -1]] = True
    kept[PULSE] = False
    columns = ("time_s", "current_A", "voltage_V", "temperature_degC", "soc_ref")
    return replace(run, **{name: getattr(run, name)[kept] for name in columns})


def build(data: Training) -> Known:
    return Known(cell(), data)


def placed(run: TimeSeries) -> tuple[Training, Training]:
    data = training([run], CAPACITY_AH, dt_s=1.0)
    found, _ = with_lost_currents(data, build(data), build)  # pyright: ignore[reportArgumentType]
    return data, found


def charge_off_As(data: Training) -> FloatArray:
    """By how much the charge of each second is wrong."""
    return data.grid[0].current_A - log().current_A


def test_changes_and_whole_pulses_are_put_where_the_voltage_says() -> None:
    data, found = placed(half(log()))
    off_As, left_As = charge_off_As(data), charge_off_As(found)
    assert abs(off_As[PULSE].sum()) > 17.0
    assert abs(left_As[PULSE].sum()) < 2.0
    off_As[PULSE], left_As[PULSE] = 0.0, 0.0
    assert np.sum(left_As**2) < 0.25 * np.sum(off_As**2)
    assert found.fit_grid[0] is found.grid[0]
    assert np.array_equal(found.grid[0].measured, data.grid[0].measured)


def test_a_log_that_lost_nothing_is_left_alone() -> None:
    data, found = placed(log())
    assert found is data


def test_gaps_stand_where_samples_were_put_back() -> None:
    gone = half(log())
    back, spans = with_lost_samples(gone), lost_spans(gone)
    assert sum(span.lost for span in spans) == len(back) - len(gone)
    for span in spans:
        assert np.isnan(back.voltage_V[span.before + 1 : span.after]).all()
        assert np.isfinite(back.voltage_V[[span.before, span.after]]).all()
    assert lost_spans(log()) == []
