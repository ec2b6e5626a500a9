"""Where the cell stands after what a bench has played."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from bench_service.bench.limits import Limits
from bench_service.bench.supervisor import BenchSupervisor
from bench_service.campaign.benches import Bench
from bench_service.campaign.standing import last_standing
from bench_service.config import BenchConfig, LimitsConfig, SimulateConfig
from bench_service.jobs.counting import counted_soc
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent, RunRecord
from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.store.samples import SampleReader
from bench_service.streams import SAMPLES, STREAMS


class NamedOnly:
    """As much of a supervisor as is looked at."""

    name = "b"


def bench(runs_before: int = 0, *, real: bool = False) -> Bench:
    stated = LimitsConfig(voltage_V=(2.5, 4.2), current_A=(-10.0, 5.0), temperature_degC=(-20.0, 60.0))
    url = "modbus-tcp://127.0.0.1:1"
    config = BenchConfig(url=url, limits=stated, capacity_Ah=2.0) if real else BenchConfig(simulate=SimulateConfig())
    limits = Limits.from_json(config.limits.model_dump())
    return Bench(config, url, limits, cast(BenchSupervisor, NamedOnly()), runs_before)


class Files:
    """A data directory with runs in it."""

    def __init__(self, data_dir: Path, stack: ExitStack) -> None:
        self.store = stack.enter_context(closing(MetadataStore.open(data_dir)))
        self.writer = stack.enter_context(closing(SampleWriter.open(data_dir)))
        self.samples = stack.enter_context(closing(SampleReader(data_dir)))
        self.profile = self.store.profiles.add("p", np.array([0.0, 3600.0]), np.array([1.0, 0.0]))

    def run(
        self, state: Any, current_A: list[float], first_seq: int = 0, initial_soc: float = 0.5, **more: Any
    ) -> RunRecord:
        """Store a run of the bench with a sample every 900 s."""
        run = self.store.runs.add(
            RunIntent(
                dt_s=900.0,
                initial_soc=initial_soc,
                capacity_Ah=2.0,
                limits={},
                code_version="0",
                **{"bench": "b", "profile_id": self.profile.id} | more,
            ),
        )
        n = len(current_A)
        if n:
            columns = {c.name: np.zeros(n, c.numpy) for c in STREAMS[SAMPLES]}
            columns |= {"time_s": 900.0 * np.arange(first_seq, first_seq + n), "current_A": np.array(current_A)}
            self.writer.commit([Rows(run.id, SAMPLES, first_seq, STREAMS[SAMPLES], columns)])
        if state == "running":
            return self.store.runs.start(run.id)
        return self.store.runs.end(run.id, state, None, n_samples=n)

    def standing(self, on: Bench) -> tuple[float, str] | None:
        found = last_standing(on, self.store, self.samples)
        return None if found is None else (found.soc, found.source)


@pytest.fixture
def files(tmp_path: Path) -> Iterator[Files]:
    with ExitStack() as stack:
        yield Files(tmp_path, stack)


def test_counting_holds_backward_and_a_missing_current_moves_nothing() -> None:
    soc = counted_soc(np.array([0.0, 900.0, 1800.0, 5400.0]), np.array([9.0, -2.0, np.nan, 1.0]), 0.5, 2.0)
    np.testing.assert_allclose(soc, [0.5, 0.25, 0.25, 0.75])


def test_the_last_run_with_samples_counts(files: Files) -> None:
    assert files.standing(bench()) is None
    files.run("completed", [0.0, 0.4])
    last = files.run("completed", [0.0, -1.0, -1.0], initial_soc=0.6)
    files.run("fault", [])  # refused before its first sample
    for on in (bench(), bench(real=True)):
        assert files.standing(on) == (pytest.approx(0.35), f"the end of run {last.id}")


def test_a_real_cell_is_believed_only_after_a_complete_run(files: Files) -> None:
    files.run("completed", [0.0, 0.4])
    stopped = files.run("stopped", [0.0, -0.4])
    assert files.standing(bench(real=True)) is None
    assert files.standing(bench()) == (pytest.approx(0.45), f"the end of run {stopped.id}")


def test_a_real_cell_is_not_believed_where_samples_are_missing(files: Files) -> None:
    files.run("completed", [0.4, 0.4], first_seq=3)
    assert files.standing(bench(real=True)) is None


def test_a_run_that_goes_on_tells_nothing(files: Files) -> None:
    ended = files.run("completed", [0.0, 0.4])
    files.run("running", [0.0, -1.0])
    assert files.standing(bench()) == (pytest.approx(0.55), f"the end of run {ended.id}")


def test_runs_before_the_simulated_cell_was_there_are_another_cells(files: Files) -> None:
    before = files.run("completed", [0.0, 0.4])
    assert files.standing(bench(before.number)) is None
    after = files.run("completed", [0.0, -0.4])
    assert files.standing(bench(before.number)) == (pytest.approx(0.45), f"the end of run {after.id}")


def test_counting_never_leaves_what_a_fraction_can_be(files: Files) -> None:
    files.run("completed", [0.0, -2.0], initial_soc=0.1)
    found = files.standing(bench())
    assert found is not None and found[0] == 0.0


def test_a_real_cell_that_has_a_name_stands_where_its_own_last_run_has_left_it(files: Files) -> None:
    cell = files.store.cells.add()
    on = bench(real=True)
    files.run("completed", [0.0, 0.4])
    on.carry(cell, "2026-01-01")
    assert files.standing(on) is None  # that was another one, or nobody knows
    own = files.run("completed", [0.0, -0.4], bench="elsewhere", cell_id=cell.id)
    files.run("completed", [0.0, 0.8])
    assert files.standing(on) == (pytest.approx(0.45), f"the end of run {own.id}")
    files.run("completed", [0.0, 0.8], bench="import", profile_id=None, cell_id=cell.id)
    assert files.standing(on) is None  # somebody else has had it


def test_a_real_cell_without_a_name_is_not_taken_for_one_that_had_one(files: Files) -> None:
    cell, on = files.store.cells.add(), bench(real=True)
    files.run("completed", [0.0, 0.4])
    on.carry(None, "2999-01-01")  # something was put there and taken off since
    assert files.standing(on) is None
    files.run("completed", [0.0, 0.4], cell_id=cell.id)
    on.carry(None, None)
    assert files.standing(on) is None
