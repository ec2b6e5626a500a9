"""The scripts of docs/scripts.md, run as they stand there against a service, with a measured cell's files."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from service_rig import Service, serving

from tests.patience import LONG_S

pytestmark = pytest.mark.timeout(2 * LONG_S)

ROOT = Path(__file__).parents[2]
CELL = ROOT / "tests" / "data" / "panasonic_18650pf"
FILES = {
    "train_25degC.csv.gz": "drive_25degC_Cycle_1.csv.gz",
    "train_10degC.csv.gz": "drive_10degC_Cycle_1.csv.gz",
    "judge.csv.gz": "drive_10degC_US06.csv.gz",
}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with serving(tmp_path_factory.mktemp("scripts"), "[bench.sim.simulate]\n") as found:
        yield found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, source in FILES.items():
        shutil.copy(CELL / source, tmp_path / name)
    return tmp_path


def script(language: str) -> str:
    text = (ROOT / "docs" / "scripts.md").read_text(encoding="utf-8")
    (found,) = re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)
    return found


def played(folder: Path, program: list[str], **environment: str) -> str:
    ended = subprocess.run(
        program, cwd=folder, env=os.environ | environment, capture_output=True, text=True, timeout=LONG_S, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "missing" in (folder / "report.html").read_text(encoding="utf-8").lower()
    return ended.stdout


@pytest.mark.needs_program("curl")
def test_the_path_by_curl(service: Service, folder: Path) -> None:
    before_mV, after_mV = map(float, played(folder, ["bash", "-c", script("sh")], api=f"{service.url}/api/v1").split())
    assert after_mV < before_mV
    assert (folder / "where.json").stat().st_size > 0


@pytest.mark.proof
def test_the_path_by_the_client(service: Service, folder: Path) -> None:
    said = played(folder, [sys.executable, "-c", script("python")], BENCH_URL=service.url)
    effect, before_mV, after_mV = re.findall(r"(\w+) added: ([0-9.]+) -> ([0-9.]+) mV", said)[0]
    assert float(after_mV) < float(before_mV), effect
