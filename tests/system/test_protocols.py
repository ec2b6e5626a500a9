"""A run through the whole service over each transport: configuration, simulator process, control process, store."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bench_service.cli.run_tables import stored_cycles
from bench_service.config import load_config
from tests.patience import PATIENCE_S

PROFILE = "time_s,current_A\n0,1.0\n20,-2.0\n40,0\n"
Samples = np.ndarray
MAPS = {"modbus-tcp": "generic", "modbus-rtu": "generic", "can": "generic_can"}


def run_profile(folder: Path, protocol: str, extra: str = "", status: int = 0) -> dict[str, object]:
    (folder / "profile.csv").write_text(PROFILE)
    (folder / "bench.toml").write_text(
        f'[bench.sim]\nmap = "{MAPS[protocol]}"\n[bench.sim.simulate]\nprotocol = "{protocol}"\nseed = 4\n{extra}'
    )
    command = ["run", "profile.csv", "--bench", "sim", "--out", "run.csv", "--initial-soc", "0.5", "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "bench_service.cli", *command, "--config", "bench.toml", "--dt", "0.5"],
        cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, env=dict(os.environ), check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stderr
    return json.loads(done.stdout)


def played(folder: Path, protocol: str) -> bytes:
    """Play the profile to its end and return the samples as they were written."""
    folder.mkdir()
    answer = run_profile(folder, protocol)
    assert (answer["state"], answer["samples"], answer["missed_ticks"]) == ("completed", 81, 0)
    return (folder / "run.csv").read_bytes()


@pytest.mark.parametrize("protocol", [pytest.param("modbus-tcp", marks=pytest.mark.proof), "modbus-rtu"])
def test_a_profile_is_played_over_modbus(tmp_path: Path, protocol: str) -> None:
    assert played(tmp_path / "run", protocol).count(b"\n") == 82


@pytest.mark.proof
def test_two_runs_over_can_are_equal_to_the_bit(tmp_path: Path) -> None:
    first = played(tmp_path / "first", "can")
    assert first == played(tmp_path / "second", "can") and first.count(b"\n") == 82


@pytest.mark.parametrize(
    ("protocol", "faults", "reason"),
    [
        ("modbus-tcp", "exception=6@set_point:20", "device busy"),
        ("modbus-rtu", "late=0.6@sample:40", "no answer within"),
        ("can", "bus_off@sample:40", "bus-off"),
    ],
)
def test_a_fault_in_a_pulse_ends_the_run_with_its_reason(
    tmp_path: Path, protocol: str, faults: str, reason: str
) -> None:
    answer = run_profile(tmp_path, protocol, f'faults = "{faults}"\n', status=1)
    assert answer["state"] == "fault" and reason in str(answer["reason"]), answer
    assert 10 < int(str(answer["samples"])) < 81, "what was measured until then is kept"


STEPS = [
    {"step": "constant_current", "rate_C": 1, "until": {"time_s": 10}},
    {"step": "loop", "count": 2, "steps": [
        {"step": "cc_cv", "rate_C": 0.5, "voltage_V": 3.78, "until": {"time_s": 15}},
        {"step": "pulse", "rate_C": -1, "on_s": 3, "off_s": 2, "count": 2}]},
]  # fmt: skip
SHORT = [
    {"step": "constant_current", "rate_C": 1, "until": {"time_s": 2}},
    {"step": "pulse", "rate_C": -1, "on_s": 1, "off_s": 1, "count": 1},
]


def run_protocol(folder: Path, protocol: str, steps: object, extra: str, dt: str) -> tuple[dict[str, object], Samples]:
    document = {"schema": "bench-protocol-1", "name": "short", "steps": steps}
    (folder / "protocol.json").write_text(json.dumps(document))
    (folder / "bench.toml").write_text(
        f'[bench.sim]\nmap = "{MAPS[protocol]}"\n[bench.sim.simulate]\nprotocol = "{protocol}"\nseed = 4\n{extra}'
    )
    command = ["run", "protocol.json", "--bench", "sim", "--out", "run.csv", "--json", "--initial-soc", "0.5"]
    done = subprocess.run(
        [sys.executable, "-m", "bench_service.cli", *command, "--config", "bench.toml", "--dt", dt],
        cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, env=dict(os.environ), check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), np.genfromtxt(folder / "run.csv", delimiter=",", names=True)


@pytest.mark.parametrize("protocol", ["modbus-tcp", pytest.param("modbus-rtu", marks=pytest.mark.proof), "can"])
def test_a_protocol_is_played_in_lock_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, protocol: str) -> None:
    answer, samples = run_protocol(tmp_path, protocol, STEPS, "", "0.5")
    assert (answer["state"], answer["samples"], answer["missed_ticks"]) == ("completed", 121, 0)
    assert samples["step_count"].max() == 11 and samples["cycle_count"].max() == 3
    charge = samples["step_count"] == 1
    assert np.allclose(samples["current_A"][charge][1:], 2.5, atol=0.01)
    assert samples["voltage_V"].max() < 3.80
    monkeypatch.chdir(tmp_path)
    moved_Ah = np.append(0, np.diff(samples["time_s"])) * samples["current_A"] / 3600
    for cycle in stored_cycles(load_config(Path("bench.toml")), str(answer["run"])):
        here = samples["cycle_count"] == cycle["cycle_count"]
        assert cycle["charged_Ah"] == pytest.approx(np.clip(moved_Ah[here], 0, None).sum(), abs=1e-9)
        assert cycle["discharged_Ah"] == pytest.approx(-np.clip(moved_Ah[here], None, 0).sum(), abs=1e-9)


def test_a_protocol_is_played_by_the_wall_clock(tmp_path: Path) -> None:
    answer, samples = run_protocol(tmp_path, "modbus-tcp", SHORT, "lock_step = false\nspeed = 1.0\n", "0.1")
    assert answer["state"] == "completed"
    ends = [samples["time_s"][samples["step_count"] == k][-1] for k in (1, 2, 3)]
    assert np.abs(np.array(ends) - [2, 3, 4]).max() < 0.3
