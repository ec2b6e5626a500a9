"""A run through the whole service over each transport: configuration, simulator process, control process, store."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

PROFILE = "time_s,current_A\n0,1.0\n20,-2.0\n40,0\n"
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


@pytest.mark.parametrize("protocol", ["modbus-tcp", "modbus-rtu"])
def test_a_profile_is_played_over_modbus(tmp_path: Path, protocol: str) -> None:
    assert played(tmp_path / "run", protocol).count(b"\n") == 82


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
