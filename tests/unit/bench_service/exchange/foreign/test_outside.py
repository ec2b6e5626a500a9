"""Programs of a user's own that read what is not read here: a stand-in for each thing that one of them can do."""

from __future__ import annotations

import os
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from bench_service.cli.main import main
from bench_service.config.reading import ConfigError, parse_config
from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.outside import Bounds, readable
from bench_service.exchange.foreign.work import convert, look_at
from tests.patience import PATIENCE_S

MAGIC = b"BIO-LOGIC MODULAR FILE\x1a and what only its reader knows"
GOOD = """
import sys
assert open(sys.argv[-1], "rb").read().startswith(b"BIO-LOGIC")
print("time/s,I/mA,Ewe/V")
for k in range(200):
    I = 500.0 if k // 20 % 2 else -500.0
    print(f"{k},{I},{3.7 + 1e-4 * I}")
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "cell7.MPR"
    path.write_bytes(MAGIC)
    return path


def lives(pid: str) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def reader(tmp_path: Path, text: str) -> dict[str, list[str]]:
    script = tmp_path / "reader.py"
    script.write_text(text)
    return {".mpr": [sys.executable, str(script)]}


def refusal(file: Path, readers: dict[str, list[str]], bounds: Bounds = Bounds()) -> str:  # noqa: B008
    with pytest.raises(RunFileError) as caught, readable(file, file.name, readers, bounds) as source:
        import_file(source).close()
    assert str(caught.value).startswith(f"{file}") and "\n" not in str(caught.value)
    return str(caught.value)


def test_what_it_prints_is_read_as_any_file(tmp_path: Path, file: Path) -> None:
    with readable(file, file.name, reader(tmp_path, GOOD)) as source, closing(import_file(source)) as run:
        assert run.name == "cell7" and run.n == 200
        np.testing.assert_allclose(run.columns()["current_A"][:21], [-0.5] * 20 + [0.5])
    assert not source.exists()
    with readable(file, file.name, {".res": ["x"]}) as same:
        assert same == file


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("import sys; sys.exit('no block of data')", "fails with exit status 1: no block of data"),
        ("raise KeyError('VMP data')", "fails with exit status 1: KeyError: 'VMP data'"),
        ("import sys; sys.exit(3)", "fails with exit status 3 and says nothing"),
        ("import os; os.kill(os.getpid(), 9)", "was ended by signal 9"),
        ("pass", "prints nothing"),
        ("print('nonsense')", "prints it"),
        ("import sys; sys.stdout.buffer.write(bytes(range(256)) * 9)", "prints it"),
        ("print('time/s,I/mA,Ewe/V')", "prints it: holds no numbers"),
    ],
)
def test_one_that_fails_is_told_in_one_line(text: str, said: str, tmp_path: Path, file: Path) -> None:
    assert said in refusal(file, reader(tmp_path, text))


def test_one_that_is_not_there_is_told(file: Path) -> None:
    told = refusal(file, {".mpr": ["/no/such/reader"]})
    assert "'/no/such/reader' cannot be started (No such file or directory): install it, or correct [readers]" in told


def test_one_that_takes_too_long_is_ended_with_what_it_has_started(tmp_path: Path, file: Path) -> None:
    child = "import subprocess, sys, time; p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])"
    noted = tmp_path / "pid"
    text = f"{child}\nopen({str(noted)!r}, 'w').write(str(p.pid))\ntime.sleep(600)"
    assert "took longer than 2 s and was ended" in refusal(file, reader(tmp_path, text), Bounds(timeout_s=2.0))
    end_s = time.monotonic() + PATIENCE_S  # the kernel takes its time with what was killed
    while lives(noted.read_text()):
        assert time.monotonic() < end_s


def test_its_memory_and_its_output_are_bounded(tmp_path: Path, file: Path) -> None:
    greedy = "import sys, time; time.sleep(0.2); x = bytearray(4 << 30); print('time/s')"
    assert "MemoryError" in refusal(file, reader(tmp_path, greedy), Bounds(memory_bytes=1 << 30))
    endless = "import time; time.sleep(0.2)\nwhile True: print('1,2,3' * 1000)"
    assert "reader" in refusal(file, reader(tmp_path, endless), Bounds(output_bytes=1 << 20))


def test_it_does_not_see_the_services_tokens(tmp_path: Path, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BENCH_TOKEN", "secret")
    assert os.environ["BENCH_TOKEN"] == "secret"
    text = "import os, sys; sys.exit(str('BENCH_TOKEN' in os.environ))"
    assert refusal(file, reader(tmp_path, text)).endswith(": False")


def test_a_worker_uses_it_by_the_name_of_what_was_sent(tmp_path: Path) -> None:
    content = tmp_path / "content"
    content.write_bytes(MAGIC)
    readers = reader(tmp_path, GOOD)
    seen = look_at(lambda *_: None, content, "x.mpr", {}, None, readers)
    assert seen["state"] == "ok" and seen["samples"] == 200 and seen["mapping"]["columns"]["current_A"]
    assert convert(lambda *_: None, content, "x.mpr", {}, None, readers)["samples"] == 200
    with pytest.raises(RunFileError, match=r"^x\.mpr: is a BioLogic \.mpr file.*\[readers\]"):
        convert(lambda *_: None, content, "x.mpr", {}, None, {})


def test_the_command_line_uses_it(tmp_path: Path, file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "bench.toml"
    config.write_text(f"[readers]\n'.mpr' = {reader(tmp_path, GOOD)['.mpr']}\n")
    out = tmp_path / "run.csv"
    assert main(["import", str(file), "--out", str(out), "--config", str(config), "--json"]) == 0
    assert '"samples": 200' in capsys.readouterr().out and len(out.read_text().splitlines()) == 201
    assert main(["import", str(file), "--show", "--config", str(config), "--json"]) == 0
    assert f'"file": "{file}"' in capsys.readouterr().out
    config.write_text("[readers]\n'.mpr' = ['/no/such/reader']\n")
    assert main(["import", str(file), "--out", str(out), "--config", str(config)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("text", ["'mpr' = ['x']", "'.mpr' = []", "'.mpr' = ['']", "'.mpr' = 'x'", "'.m/p' = ['x']"])
def test_a_reader_that_is_none_is_refused_with_its_key(text: str) -> None:
    with pytest.raises(ConfigError, match="readers"):
        parse_config(f"[readers]\n{text}\n")
