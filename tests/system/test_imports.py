"""A cycler's file over REST: uploaded in pieces, asked about, stored as a run that everything else can use."""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from service_rig import serving

from bench_service.client import BenchClient, ClientError
from bench_service.exchange import read_run
from benchmarks.import_variants import commas, joined, record, swapped, table_of
from tests.patience import LONG_S

RECORD = record()
# A person's own program: prints what comes behind the first line, or says why not.
READER = """
import sys
head, table = open(sys.argv[1], "rb").read().split(bytes([10]), 1)
sys.stdout.buffer.write(table) if table else sys.exit("no samples in it")
"""


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BenchClient]:
    folder = tmp_path_factory.mktemp("imports")
    (folder / "reader.py").write_text(READER)
    readers = f"[readers]\n'.own' = ['{sys.executable}', '{folder}/reader.py']\n"
    with serving(folder, f"{readers}[bench.sim]\nsimulate = {{ seed = 3 }}\n") as service:
        yield service.client


@pytest.fixture
def path(tmp_path: Path) -> Path:
    target = tmp_path / "cell 7.txt"
    target.write_bytes(joined(commas(swapped(table_of(RECORD))), ";").encode("utf-16"))
    return target


def test_a_file_becomes_a_run(client: BenchClient, path: Path, tmp_path: Path) -> None:
    upload = client.upload_file(path)
    assert upload["n_bytes"] == path.stat().st_size
    seen = client.look_at_import(upload["id"])
    assert (seen["state"], seen["asks"], seen["file"]) == ("question", "current_sign", "cell 7.txt")
    assert seen["question"].startswith("cell 7.txt: the current has the wrong sign")
    assert seen["mapping"]["columns"]["voltage_V"]["column"] == "Voltage (V)"
    with pytest.raises(ClientError, match="--current-sign discharge-positive"):
        client.store_import(upload["id"], 3.0, 0.4)
    assert client.runs() == []
    settled = {"current_sign": "discharge-positive"}
    seen = client.look_at_import(upload["id"], **settled)
    assert seen["state"] == "ok" and seen["samples"] == 400 and len(seen["plot"]["voltage_V"]) == 400
    stored = client.store_import(upload["id"], 3.0, 0.4, choices=settled, timeout_s=LONG_S)
    run = client.run(stored["run"])
    assert (run["bench"], run["state"], run["n_samples"], run["name"]) == ("import", "completed", 400, "cell 7.txt")
    assert "SHA-256" in run["notes"]
    assert (run["started_utc"], run["elapsed_s"]) == (None, 3990.0)
    assert b"Unix Time" not in client.export(run["id"], "bdf")
    (tmp_path / "out.csv").write_bytes(client.export(run["id"], "csv"))
    back = read_run(tmp_path / "out.csv")
    for name in ("time_s", "current_A", "voltage_V", "temperature_degC"):
        np.testing.assert_allclose(getattr(back, name), RECORD[name], atol=1e-12)
    with pytest.raises(ClientError, match="unknown upload"):
        client.look_at_import(upload["id"])


def test_a_file_that_a_persons_own_program_reads(client: BenchClient, tmp_path: Path) -> None:
    good, bad = tmp_path / "good.own", tmp_path / "bad.own"
    good.write_bytes(b"own format\n" + joined(table_of(RECORD), ",").encode())
    bad.write_bytes(b"own format\n")
    upload = client.upload_file(good)
    assert client.look_at_import(upload["id"])["state"] == "ok"
    stored = client.store_import(upload["id"], 3.0, 0.4, timeout_s=LONG_S)
    assert stored["samples"] == 400 and client.run(stored["run"])["name"] == "good.own"
    n_runs = len(client.runs())
    upload = client.upload_file(bad)
    with pytest.raises(ClientError, match=r"^bad\.own: its reader .* fails with exit status 1: no samples in it$"):
        client.store_import(upload["id"], 3.0, 0.4)
    assert len(client.runs()) == n_runs


def test_a_broken_upload_goes_on_where_it_ended(client: BenchClient, path: Path, tmp_path: Path) -> None:
    half = tmp_path / "half" / path.name
    half.parent.mkdir()
    half.write_bytes(path.read_bytes()[:5000])
    upload = client.upload_file(half)
    assert client.upload_file(path, upload["id"])["n_bytes"] == path.stat().st_size
    with pytest.raises(ClientError, match="go on from offset"):
        client._connection.send("PUT", f"/api/v1/imports/{upload['id']}/content", params={"offset": 3}, content=b"x")
    client.drop_import(upload["id"])


def test_what_is_no_table_is_refused_and_nothing_is_stored(client: BenchClient, tmp_path: Path) -> None:
    (tmp_path / "a.mpr").write_bytes(b"BIO-LOGIC MODULAR FILE\x1a  ")
    upload = client.upload_file(tmp_path / "a.mpr")
    before = len(client.runs())
    for attempt in (lambda: client.look_at_import(upload["id"]), lambda: client.store_import(upload["id"], 3.0, 0.5)):
        with pytest.raises(ClientError, match="^a.mpr: is a BioLogic .mpr file"):
            attempt()
    assert len(client.runs()) == before


def test_a_mapping_is_remembered(client: BenchClient, path: Path) -> None:
    upload = client.upload_file(path)
    mapping = client.look_at_import(upload["id"])["mapping"] | {"name": "ours", "current_sign": "discharge-positive"}
    client.save_mapping(mapping)
    assert [each["name"] for each in client.mappings()] == ["ours"]
    assert client.look_at_import(upload["id"], mapping="ours")["state"] == "ok"
    with pytest.raises(ClientError, match="mapping 'theirs' is not known; there is ours"):
        client.look_at_import(upload["id"], mapping="theirs")
    with pytest.raises(ClientError, match="mapping name '../x'"):
        client.save_mapping(mapping | {"name": "../x"})


def test_a_run_bears_the_time_at_which_it_was_measured(client: BenchClient, tmp_path: Path) -> None:
    path = tmp_path / "dated.csv"
    path.write_text(joined(table_of(RECORD, columns={"time_s": [f"{1.7e9 + s:.1f}" for s in RECORD["time_s"]]})))
    choices = {"columns": {"time_s": {"column": ""}, "clock": {"column": "Test Time (s)", "unit": "s"}}}
    stored = client.store_import(client.upload_file(path)["id"], 3.0, 0.4, choices=choices, timeout_s=LONG_S)
    run = client.run(stored["run"])
    assert (run["started_utc"], run["elapsed_s"]) == ("2023-11-14T22:13:20.000000Z", 3990.0)
    assert b"1700000000" in client.export(run["id"], "bdf")
