"""Neware files, by the package fastnda where it is installed, and by one that stands in for it."""

import shutil
import sys
import types
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from bench_service.exchange.foreign.importing import import_file
from benchmarks.import_variants import record

DATA = Path(__file__).parents[4] / "data" / "neware"


class Frame:
    """What fastnda gives back, as far as it is asked."""

    def __init__(self, columns: dict[str, object]) -> None:
        self.columns = columns

    def to_arrow(self) -> pa.Table:
        return pa.table(self.columns)


def test_names_and_units_of_fastnda(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    truth = record()
    words = ["CC_Chg" if value > 0 else "CC_DChg" if value < 0 else "Rest" for value in truth["current_A"]]
    frame = Frame(
        {
            "index": np.arange(1, 401),
            "voltage_V": truth["voltage_V"].astype(np.float32),
            "current_mA": (1000.0 * truth["current_A"]).astype(np.float32),
            "unix_time_s": 1738836017.85 + truth["time_s"],
            "step_time_s": truth["time_s"],
            "total_time_s": truth["time_s"],
            "cycle_count": truth["cycle_count"].astype(np.uint32),
            "step_count": truth["step_count"].astype(np.uint32),
            "step_index": np.ones(400, dtype=np.uint32),
            "step_type": pa.array(words).dictionary_encode(),
        }
    )
    module = types.ModuleType("fastnda")
    module.read = lambda path: frame  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "fastnda", module)
    with zipfile.ZipFile(tmp_path / "a.ndax", "w") as archive:
        archive.writestr("data.ndc", b"")
    run = import_file(tmp_path / "a.ndax")
    columns = run.columns()
    run.close()
    assert (run.mapping.name, run.name, run.started_unix_s) == ("neware", "a", pytest.approx(1738836017.85))
    np.testing.assert_allclose(columns["current_A"], truth["current_A"], rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(columns["step_count"], truth["step_count"])
    np.testing.assert_array_equal(columns["time_s"], truth["time_s"])


@pytest.mark.parametrize("name", ["rest.ndax", "content"])
def test_a_real_file_of_version_14(tmp_path: Path, name: str) -> None:
    """Ten minutes of rest without a cell; the figures were read off with fastnda 1.3.1. An upload has no suffix."""
    pytest.importorskip("fastnda", reason="the extra 'formats' is not installed")
    shutil.copy(DATA / "rest.ndax", tmp_path / name)
    run = import_file(tmp_path / name)
    columns = run.columns()
    run.close()
    assert run.n == 67
    assert columns["time_s"][-1] == pytest.approx(655.4)
    assert columns["voltage_V"][0] == pytest.approx(0.0033460346)
    assert not columns["current_A"].any() and set(columns["step_count"]) == {1.0}
