"""MDF 4 files: our own, those of other programs, and what is wrong with them."""

import sys
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.exchange import encode_run, read_run_file
from bench_service.exchange.errors import ExchangeError, RunFileError
from bench_service.exchange.foreign.guess import QuestionError
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices
from bench_service.exchange.foreign.mapping import Column
from bench_service.exchange.mdf import read_channels

asammdf = pytest.importorskip("asammdf")

N = 400
TIME_S = np.arange(N, dtype=np.float64)
CURRENT_A = np.where(TIME_S // 40 % 2, -2.0, 0.0)
VOLTAGE_V = 3.7 + 0.03 * CURRENT_A - 1e-4 * TIME_S
COLUMNS = {"time_s": TIME_S, "current_A": CURRENT_A, "voltage_V": VOLTAGE_V}


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A log of another program: names of its own, a text channel, and a group that is logged once in ten seconds."""
    path = tmp_path / "rig.mf4"
    with asammdf.MDF(version="4.10") as file:
        quick = [
            asammdf.Signal(CURRENT_A.astype(np.float32), TIME_S, name="Strom", unit="A"),
            asammdf.Signal(VOLTAGE_V, TIME_S, name="Spannung", unit="V"),
            asammdf.Signal(np.array([b"load"] * N), TIME_S, name="state", encoding="utf-8"),
        ]
        file.append(quick)
        file.append([asammdf.Signal(np.full(40, 25.0), TIME_S[::10], name="chamber", unit="degC")])
        file.save(path, overwrite=True)
    return path


def test_another_program_finds_names_units_times_and_date(tmp_path: Path) -> None:
    path = tmp_path / "run.mf4"
    path.write_bytes(encode_run(COLUMNS, "mdf4", 1_700_000_000.25))
    with asammdf.MDF(str(path)) as file:
        assert file.start_time == datetime.fromtimestamp(1_700_000_000.25, UTC)
        for name in ("current_A", "voltage_V"):
            channel = file.get(name)
            assert channel.unit == name[-1]
            np.testing.assert_array_equal(channel.samples, COLUMNS[name])
            np.testing.assert_array_equal(channel.timestamps, TIME_S)


def test_channels_of_other_times_are_left_out_and_none_is_made_between_two_values(foreign: Path) -> None:
    found = read_channels(foreign)
    assert [(each.name, each.unit) for each in found] == [("time_s", "s"), ("Strom", "A"), ("Spannung", "V")]
    run = import_file(foreign)
    np.testing.assert_array_equal(run.columns()["current_A"], CURRENT_A)
    np.testing.assert_array_equal(run.columns()["voltage_V"], VOLTAGE_V)
    run.close()


def test_what_is_no_measurement_is_refused_in_one_line(foreign: Path, tmp_path: Path) -> None:
    whole = foreign.read_bytes()
    broken = {"cut": whole[: len(whole) // 3], "stub": whole[:64], "noise": whole[:64] + b"\xff" * 400}
    for name, content in broken.items():
        path = tmp_path / f"{name}.mf4"
        path.write_bytes(content)
        with pytest.raises(RunFileError, match=r"MDF|channels") as refused:
            read_run_file(path)
        assert "\n" not in str(refused.value), name


def test_without_the_package_it_is_said_what_to_install(foreign: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(RunFileError, match=r"asammdf is not installed: pip install 'bench-service\[formats\]'"):
        import_file(foreign)
    with pytest.raises(ExchangeError, match=r"needs the package asammdf"):
        encode_run(COLUMNS, "mdf4")


def test_units_are_those_of_the_channels(tmp_path: Path) -> None:
    path = tmp_path / "rig.mf4"
    measured = {"Current": (1e3 * CURRENT_A, "mA"), "Voltage": (1e3 * VOLTAGE_V, "mV")}
    measured["Temperature"] = (np.full(N, 77.0), "degF")
    _save(path, [asammdf.Signal(values, TIME_S, name=name, unit=unit) for name, (values, unit) in measured.items()])
    with closing(import_file(path)) as run:
        columns = run.columns()
        np.testing.assert_allclose(columns["current_A"], CURRENT_A)
        np.testing.assert_allclose(columns["voltage_V"], VOLTAGE_V)
        np.testing.assert_allclose(columns["temperature_degC"], 25.0)
    with closing(import_file(path, Choices(columns={"current_A": Column("Current")}))) as run:
        assert run.mapping.columns["current_A"].unit == "mA"


def test_two_channels_of_one_name_are_asked_about_unless_they_hold_the_same(tmp_path: Path) -> None:
    path = tmp_path / "rig.mf4"
    both = [asammdf.Signal(CURRENT_A, TIME_S, name="Current", unit="A")]
    both += [asammdf.Signal(VOLTAGE_V, TIME_S, name="Voltage", unit="V")] * 2
    _save(path, both)
    import_file(path).close()
    _save(path, [*both[:2], asammdf.Signal(VOLTAGE_V + 1.0, TIME_S, name="Voltage", unit="V")])
    with pytest.raises(QuestionError, match=r"columns 'Voltage' and 'Voltage \(2\)' may all hold voltage_V"):
        import_file(path)
    with closing(import_file(path, Choices(columns={"voltage_V": Column("Voltage (2)")}))) as run:
        np.testing.assert_array_equal(run.columns()["voltage_V"], VOLTAGE_V + 1.0)


def _save(path: Path, signals: list[Any]) -> None:
    with asammdf.MDF(version="4.10") as file:
        file.append(signals)
        file.save(path, overwrite=True)
