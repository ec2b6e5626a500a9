"""Files that are no table, bombs, half files: one clear line each."""

import gzip
import zipfile
from contextlib import closing
from pathlib import Path

import pytest

from bench_service.exchange import RunFileError
from bench_service.exchange.foreign import byte_source
from bench_service.exchange.foreign.importing import import_file
from bench_service.exchange.foreign.looking import Choices


def refused(path: Path) -> str:
    with pytest.raises(RunFileError) as caught:
        import_file(path)
    message = str(caught.value)
    assert "\n" not in message and str(path) in message
    return message


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"BIO-LOGIC MODULAR FILE\x1a   ", "Export as Text"),
        (b"\x00\x01\x00\x00Standard Jet DB\x00", "mdb-export"),
        (b"%PDF-1.7 ...", "a PDF"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "save its table of samples as CSV"),
        (b"SQLite format 3\x00", "SQLite"),
        (b"PAR1 and nothing that follows", "not a readable Parquet file"),
        (b"PK\x03\x04 and nothing", "damaged or cut zip"),
        (b'{"steps": []}', "is JSON"),
        (b"", "is empty"),
        (b"   \n \n", "is empty"),
        (b"just a few words\nand more of them\n", "holds no numbers"),
        (bytes(range(256)) * 20, "neither a table"),
    ],
)
def test_what_it_is_and_what_to_do(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    assert says in refused(path)
    if len(content) > 8 and content[:1] not in b" jP":
        path.write_bytes(gzip.compress(content))
        refused(path)


def test_an_excel_file_and_another_archive(tmp_path: Path) -> None:
    for name, says in (("[Content_Types].xml", "Excel"), ("a.txt", "unpack it")):
        with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
            archive.writestr(name, "x")
        assert says in refused(tmp_path / "a.zip")


def test_a_gzip_bomb_ends_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(byte_source, "_NEVER_A_BOMB_BYTES", 3 << 20)
    path = tmp_path / "a.csv.gz"
    head = b"time_s,current_A,voltage_V\n0,0,3.7\n1,0,3.7\n"
    path.write_bytes(gzip.compress(head + b"1,0,3.7\n" * 2_000_000, 9))
    assert "no table of samples does" in refused(path)


def test_a_zip_bomb_is_seen_in_its_list_of_sizes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(byte_source, "_NEVER_A_BOMB_BYTES", 1 << 20)
    with zipfile.ZipFile(tmp_path / "a.ndax", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.ndc", b"\0" * (4 << 20))
    assert "no table of samples does" in refused(tmp_path / "a.ndax")


def test_a_neware_file_that_cannot_be_read_names_the_export(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.ndax", "w") as archive:
        archive.writestr("data.ndc", b"nothing of the kind")
    assert "export it as CSV with BTSDA" in refused(tmp_path / "a.ndax")


def test_a_column_of_text_in_parquet(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"time_s": [0.0, 1.0], "current_A": ["a", "b"], "voltage_V": [3.7, 3.7]})
    pq.write_table(table, tmp_path / "a.parquet")
    assert "current_A" in refused(tmp_path / "a.parquet")


@pytest.mark.parametrize("at", [1, 2, 3])
@pytest.mark.parametrize("n", [40, 40_000])
def test_a_quotation_mark_that_is_never_closed(tmp_path: Path, at: int, n: int) -> None:
    """In whatever column, read or not: what stands behind it would be left out."""
    path = tmp_path / "a.csv"
    rows = [[f"{k}.0", "1.5", "3.7", "note"] for k in range(n)]
    rows[6][at] = '"' + rows[6][at]
    path.write_text("\n".join(",".join(row) for row in [["time_s", "current_A", "voltage_V", "what"], *rows]) + "\n")
    assert "line 8: a quotation mark opens a cell" in refused(path)
    rows[6][at] = rows[6][at][1:]
    rows[6][3] = 'at 5"'  # inches
    path.write_text("\n".join(",".join(row) for row in [["time_s", "current_A", "voltage_V", "what"], *rows]) + "\n")
    with closing(import_file(path, Choices(current_sign="charge-positive"))) as run:
        assert run.n == n
