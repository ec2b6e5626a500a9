"""The sealed game as a technician plays it: an effect is hidden in the simulated cell, and the campaign finds it."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.patience import LONG_S

pytestmark = pytest.mark.timeout(2 * LONG_S)


def demo(data: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Play the game to its end; coverage is not measured, which would take it twice the time."""
    foreign = ("BENCH_DATA_DIR", "COVERAGE_PROCESS_CONFIG", "COVERAGE_PROCESS_START")
    environment = {name: value for name, value in os.environ.items() if name not in foreign}
    command = [sys.executable, "-m", "bench_service.cli", "demo", "--exit", "--json", "--data", str(data), *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=LONG_S, env=environment, check=False)


def test_a_hidden_contact_resistance_is_named_sized_and_added(tmp_path: Path) -> None:
    ended = demo(tmp_path, "--hidden-effect", "series_resistance", "--seed", "4")
    assert ended.returncode == 0, ended.stderr
    answer: dict[str, Any] = json.loads(ended.stdout)
    assert len(answer["runs"]) == 4
    assert answer["missed_ticks"] == 0
    # The seal was said before; what it closes is shown after.
    assert hashlib.sha256(answer["seal"]["contents"].encode()).hexdigest() == answer["seal"]["sha256"]
    assert answer["seal"]["contents"].startswith(f"series_resistance={answer['hidden_size']['value']!r} ")
    assert answer["verdict"] == "missing"
    assert answer["hidden_effect"] == answer["diagnosed_effect"] == "series_resistance"
    first, second = answer["model_chain"]
    assert second["effect"] == "series_resistance"
    assert second["validation_rmse_mV"] < 0.5 * first["validation_rmse_mV"]
    found = second["parameters"]["resistance_Ohm"]["value"]
    assert found == pytest.approx(answer["hidden_size"]["value"], rel=0.15)


def test_an_effect_that_cannot_be_hidden_is_refused_before_anything_starts(tmp_path: Path) -> None:
    ended = demo(tmp_path / "data", "--hidden-effect", "phlogiston")
    assert ended.returncode == 2
    assert "phlogiston" in ended.stderr
    assert "series_resistance" in ended.stderr
    assert not (tmp_path / "data").exists()
