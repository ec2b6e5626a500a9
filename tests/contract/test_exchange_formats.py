"""What every exchange format owes: a run that goes out and comes in again is the same to the bit."""

import gzip
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from bench_service import exchange
from bench_service.api.formats import list_formats
from bench_service.cli.main import main
from bench_service.exchange import encode_run, export_formats, read_run_file
from bench_service.exchange.registry import formats

READABLE = ("time_s", "current_A", "voltage_V", "temperature_degC", "ambient_degC")


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """Awkward numbers, missing values and a step at every tenth sample."""
    rng = np.random.default_rng(7)
    n = 500
    current_A = np.repeat(rng.normal(size=n // 10), 10)
    voltage_V = 3.7 + 0.03 * current_A + 1e-3 * rng.standard_normal(n)
    voltage_V[[5, 17, 300]] = np.nan
    return {
        "time_s": np.cumsum(rng.uniform(0.01, 60.0, n)),
        "current_A": current_A,
        "voltage_V": voltage_V,
        "temperature_degC": 25.0 + rng.standard_normal(n) * 1e-12,
        "ambient_degC": rng.uniform(-20.0, 50.0, n),
        "flags": rng.integers(0, 127, n).astype("<u4"),
    }


@pytest.mark.parametrize("name", sorted(formats()))
def test_describes_itself(name: str) -> None:
    each = formats()[name]
    assert each.name == name
    assert each.title
    assert each.suffix.startswith(".")
    assert "/" in each.media_type
    assert each.read is not None or each.encode is not None
    assert (each.read is None) == (each.recognise is None)


@pytest.mark.parametrize("name", sorted(export_formats()))
@pytest.mark.parametrize("started_unix_s", [None, 1_700_000_000.25])
def test_round_trip(name: str, started_unix_s: float | None, tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    path = tmp_path / f"run{export_formats()[name].suffix}"
    path.write_bytes(encode_run(columns, name, started_unix_s))
    read = read_run_file(path)
    assert read.series.name == "run"
    for own in READABLE:
        np.testing.assert_array_equal(getattr(read.series, own), columns[own], err_msg=own)


@pytest.mark.parametrize("name", sorted(n for n, f in export_formats().items() if f.media_type == "text/csv"))
def test_text_may_be_gzipped(name: str, tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    path = tmp_path / "run.csv.gz"
    path.write_bytes(gzip.compress(encode_run(columns, name)))
    np.testing.assert_array_equal(read_run_file(path).series.voltage_V, columns["voltage_V"])


@pytest.mark.parametrize("name", sorted(export_formats()))
def test_equal_runs_give_equal_bytes(name: str, columns: dict[str, np.ndarray]) -> None:
    assert encode_run(columns, name) == encode_run(columns, name)


MADE_UP = """
from bench_service.exchange.format import Format

FORMAT = Format(
    name="made_up",
    title="A made-up format",
    suffix=".made-up",
    media_type="application/octet-stream",
    encode=lambda run: len(run.columns["time_s"]).to_bytes(4, "big"),
)
"""


@pytest.fixture
def made_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One new file beside the others; the package looks into a second folder as into its own."""
    (tmp_path / "made_up.py").write_text(MADE_UP, encoding="utf-8")
    monkeypatch.setattr(exchange, "__path__", [*exchange.__path__, str(tmp_path)])
    formats.cache_clear()
    yield
    formats.cache_clear()
    sys.modules.pop("bench_service.exchange.made_up", None)


def test_one_new_file_is_a_format_everywhere(made_up: None, tmp_path: Path, columns: dict[str, np.ndarray]) -> None:
    assert encode_run(columns, "made_up") == (500).to_bytes(4, "big")
    # REST, from which the page takes its links.
    titles = {each["name"]: each["title"] for each in list_formats()["formats"]}
    assert titles["made_up"] == "A made-up format"
    run, out = tmp_path / "run.csv", tmp_path / "run.made-up"
    run.write_bytes(encode_run(columns, "csv"))
    words = ["export", str(run), "--format", "made_up", "--out", str(out), "--current-sign", "charge-positive"]
    assert main(words) == 0
    assert out.read_bytes() == (500).to_bytes(4, "big")
