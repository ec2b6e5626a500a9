"""What is kept of a run in memory is what is on the disk."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench_service.errors import StoreError
from bench_service.store.records import RunRecord
from bench_service.store.sample_writer import SampleWriter
from bench_service.store.samples import FILE, SampleReader
from bench_service.store.views import COUNTED, View, Views
from bench_service.streams import SAMPLES
from tests.unit.bench_service.api.route_rig import run_record
from tests.unit.bench_service.store.sample_rig import commit, flip_bit


class Rig:
    """A data directory that is written and looked at."""

    def __init__(self, data_dir: Path, stack: ExitStack) -> None:
        self.data_dir = data_dir
        self.writer = stack.enter_context(closing(SampleWriter.open(data_dir)))
        self.reader = stack.enter_context(closing(SampleReader(data_dir)))
        self.views = Views(self.reader)
        self.run: RunRecord = run_record(state="running")

    def end(self) -> None:
        closed = self.writer.close_run("r1", "completed", None)
        self.run = replace(self.run, state="completed", n_samples=closed.n_samples, sha256=closed.sha256)


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    with ExitStack() as stack:
        yield Rig(tmp_path / "data", stack)


def counted(view: View) -> None:
    """Charge and energy are those of all samples counted at once, however they came in."""
    columns = view.data.columns
    hours = np.diff(columns["time_s"]) / 3600.0
    for name, rate in (("charge_Ah", columns["current_A"]), ("energy_Wh", columns["current_A"] * columns["voltage_V"])):
        assert columns[name] == pytest.approx(np.concatenate([[0.0], np.cumsum(rate[1:] * hours)]), abs=1e-12)


def test_a_run_that_goes_on_grows_in_the_view_and_what_was_given_out_stays(rig: Rig) -> None:
    assert rig.views.view(rig.run).data.n == 0
    commit(rig.writer, "r1", 0, 3)
    first = rig.views.view(rig.run)
    for seq0, n in ((3, 2), (5, 300), (305, 1)):
        commit(rig.writer, "r1", seq0, n)
        view = rig.views.view(rig.run)
        assert view.data.seq.tolist() == list(range(seq0 + n))
        counted(view)
    stored = rig.reader.read("r1")
    for name, values in stored.columns.items():
        assert np.array_equal(rig.views.view(rig.run).data.columns[name], values)
    assert first.data.n == 3 and first.data.columns["time_s"].tolist() == [0.0, 1.0, 2.0]


def test_a_part_has_its_ends_and_only_what_is_new(rig: Rig) -> None:
    commit(rig.writer, "r1", 0, 100)
    view = rig.views.view(rig.run)
    assert view.part(10.0, 20.0, None).seq.tolist() == list(range(10, 21))
    assert view.part(None, None, 97).seq.tolist() == [98, 99]
    assert view.part(10.0, 20.0, 18).columns["time_s"].tolist() == [19.0, 20.0]
    assert view.part(300.0, None, None).n == view.part(20.0, 10.0, None).n == 0


def test_an_ended_run_is_held_against_its_record_and_then_read_from_memory(rig: Rig) -> None:
    commit(rig.writer, "r1", 0, 50)
    rig.views.view(rig.run)
    rig.end()
    view = rig.views.view(rig.run)
    assert (view.data.n, view.damage) == (50, None)
    assert rig.views.view(rig.run) is view
    counted(view)
    assert not set(COUNTED) & {column.name for column in view.data.layout}, "what is counted is not what is stored"


def test_damage_is_told_each_time_and_ends_with_its_repair(rig: Rig) -> None:
    commit(rig.writer, "r1", 0, 50)
    rig.end()
    flip_bit(rig.data_dir, "data")
    for _ in range(2):
        assert "checksum" in (rig.views.view(rig.run).damage or "")
    flip_bit(rig.data_dir, "data")
    assert rig.views.view(rig.run).damage is None


def test_a_file_that_is_gone_is_no_memory(rig: Rig) -> None:
    commit(rig.writer, "r1", 0, 50)
    rig.end()
    rig.views.view(rig.run)
    (rig.data_dir / FILE).unlink()
    with pytest.raises(StoreError, match="is gone"):
        rig.views.view(rig.run)


def test_what_was_not_looked_at_for_longest_makes_room(rig: Rig) -> None:
    views = Views(rig.reader, most_rows=100)
    for k, n in enumerate((60, 30, 60)):
        commit(rig.writer, f"r{k}", 0, n)
    runs = [run_record(id=f"r{k}") for k in range(3)]
    seen = [views.view(run) for run in runs]
    assert views.view(runs[1]) is seen[1] and views.view(runs[2]) is seen[2]
    assert views.view(runs[0]) is not seen[0]
    commit(rig.writer, "big", 0, 200)
    assert views.view(run_record(id="big"), SAMPLES).data.n == 200
