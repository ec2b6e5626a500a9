"""Stored runs as series, and the noise floor of several."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench_service.errors import DamagedError
from bench_service.jobs.series import RunInput, noise_floor_mV, read_logs, read_series
from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.streams import CELLS, cells_layout
from models.data.timeseries import TimeSeries
from tests.unit.bench_service.store.sample_rig import commit


def still(n: int, noise_V: float, seed: int = 0) -> TimeSeries:
    """A cell at rest, measured with noise."""
    voltage_V = 3.7 + noise_V * np.random.default_rng(seed).standard_normal(n)
    return TimeSeries(np.arange(float(n)), np.zeros(n), voltage_V, np.full(n, 25.0))


def test_it_is_the_middle_one_in_millivolts() -> None:
    runs = [still(5000, noise_V, seed) for seed, noise_V in enumerate((1e-3, 3e-3, 9e-3))]
    assert noise_floor_mV(runs, 1.0) == pytest.approx(3.0, rel=0.05)


def test_runs_that_cannot_tell_do_not_count() -> None:
    assert noise_floor_mV([still(10, 5e-3), still(5000, 1e-3)], 1.0) == pytest.approx(1.0, rel=0.05)
    assert noise_floor_mV([still(10, 5e-3)], 1.0) is None
    assert noise_floor_mV([], 1.0) is None


@pytest.mark.parametrize(("n_samples", "sha256"), [(51, None), (50, "0" * 64)])
def test_a_run_that_is_not_what_it_claims_is_no_input(tmp_path: Path, n_samples: int, sha256: str | None) -> None:
    with closing(SampleWriter.open(tmp_path)) as writer:
        commit(writer, "r1", 0, 50)
        closed = writer.close_run("r1", "completed", None)
    whole = RunInput("r1", 0.5, closed.n_samples, closed.sha256)
    assert [len(each) for each in read_series(tmp_path, [whole])] == [50]
    with pytest.raises(DamagedError, match="run r1 is damaged"):
        read_series(tmp_path, [RunInput("r1", 0.5, n_samples, sha256)])


def test_voltages_of_a_modules_cells_are_read_with_its_run(tmp_path: Path) -> None:
    with closing(SampleWriter.open(tmp_path)) as writer:
        for run_id, n in (("plain", 0), ("whole", 50), ("torn", 40)):
            commit(writer, run_id, 0, 50)
            columns = {"time_s": np.arange(float(n)), "v_cell1_V": np.full(n, 3.1), "v_cell2_V": np.full(n, 3.2)}
            writer.commit([Rows(run_id, CELLS, 0, cells_layout(["v_cell1_V", "v_cell2_V"]), columns)])
            writer.close_run(run_id, "completed", None)
    plain, whole = read_logs(tmp_path, [RunInput("plain", 0.5), RunInput("whole", 0.5)])
    assert plain.groups_V is None
    assert whole.groups_V is not None and whole.groups_V.shape == (50, 2) and whole.groups_V[7].tolist() == [3.1, 3.2]
    with pytest.raises(DamagedError, match="40 voltages of its cells for 50 samples"):
        read_logs(tmp_path, [RunInput("torn", 0.5)])
