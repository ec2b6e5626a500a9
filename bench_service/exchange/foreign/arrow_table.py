"""Tables that come as Arrow batches: Parquet, Neware files (by the package fastnda), MAT and MDF files."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.byte_source import Progress, check_growth
from bench_service.exchange.mat import read_vectors
from bench_service.exchange.mdf import read_channels

if TYPE_CHECKING:
    import pyarrow as pa

_BATCH = 1 << 17
_SAMPLE = 200
_LARGEST_PART_BYTES = 8 << 30


@dataclass(frozen=True)
class ArrowTable:
    """A table whose columns have types of their own.

    Attributes
    ----------
    path, kind : the file and what it is
    names : every column's name, in order
    n : rows
    batches : gives record batches of all columns wanted by position
    sample : first rows as text
    """

    path: Path
    kind: str
    names: tuple[str, ...]
    n: int
    batches: Callable[[list[str]], Iterator[pa.RecordBatch]]
    sample: tuple[tuple[str, ...], ...]
    units: tuple[str, ...] = ()
    first_row: int = 1

    def read(
        self, numbers: Sequence[int], texts: Sequence[int], plain: bool, remarks: list[str], progress: Progress
    ) -> Iterator[dict[int, pa.Array]]:
        """Give the wanted columns block by block (arguments as for `TextTable.read`)."""
        import pyarrow as pa

        done = 0
        wanted = sorted({*numbers, *texts})
        for batch in self.batches([self.names[k] for k in wanted]):
            block = {}
            for k in wanted:
                column = batch.column(self.names[k])
                try:
                    block[k] = column.cast(pa.float64() if k in numbers else pa.string())
                except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
                    raise RunFileError(
                        f"{self.path}: column {self.names[k]!r} holds {column.type}, not numbers"
                    ) from error
            done += batch.num_rows
            progress(done / max(self.n, 1))
            yield block


def open_parquet(path: Path) -> ArrowTable:
    """Look at a Parquet file; raises RunFileError where it is damaged."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            names, n = tuple(file.schema_arrow.names), file.metadata.num_rows
            head = next(file.iter_batches(_SAMPLE), None)
    except (pa.ArrowException, OSError) as error:
        raise RunFileError(f"{path}: is not a readable Parquet file: {str(error).splitlines()[0]}") from error

    def batches(wanted: list[str]) -> Iterator[pa.RecordBatch]:
        try:
            with pq.ParquetFile(path) as file:
                yield from file.iter_batches(_BATCH, columns=wanted)
        except (pa.ArrowException, OSError) as error:
            raise RunFileError(f"{path}: is damaged: {str(error).splitlines()[0]}") from error

    return ArrowTable(path, "parquet", names, n, batches, _as_text(head))


def open_neware(path: Path) -> ArrowTable:
    """Read a Neware .ndax or .nda file with the package fastnda (BSD-3-Clause), which is an optional extra.

    Raises
    ------
    RunFileError
        The package is not installed, or cannot read the file.
    """
    _check_zip(path)
    try:
        # An optional extra; it takes 300 ms.
        import fastnda  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise RunFileError(
            f"{path}: is a Neware file, and the package fastnda is not installed: pip install "
            "'bench-service[formats]', or export it as CSV with BTSDA and import that"
        ) from error
    try:
        # It goes by the end of the name, and an upload has none.
        with tempfile.TemporaryDirectory(prefix="neware-") as folder:
            named = Path(folder, "file.ndax" if zipfile.is_zipfile(path) else "file.nda")
            named.symlink_to(path.resolve())
            table: pa.Table = fastnda.read(named).to_arrow()
    except Exception as error:  # noqa: BLE001  # whatever a foreign reader says about a damaged file
        raise RunFileError(
            f"{path}: is damaged, or of a Neware version that fastnda does not know ({str(error).splitlines()[:1]}); "
            "export it as CSV with BTSDA and import that"
        ) from error
    if table.num_rows == 0:
        raise RunFileError(f"{path}: holds no rows")
    return of_table(path, "neware", table)


def open_mat(path: Path) -> ArrowTable:
    """Read the vectors of a MAT file; raises RunFileError where it is damaged or holds none."""
    import pyarrow as pa

    return of_table(path, "mat", pa.table(read_vectors(path)))


def open_mdf(path: Path) -> ArrowTable:
    """Read the channels of an MDF file; raises RunFileError where it is damaged or nothing here reads it."""
    import pyarrow as pa

    return of_table(path, "mdf", pa.table(read_channels(path)))


def of_table(path: Path, kind: str, table: pa.Table) -> ArrowTable:
    """Wrap a table that is in memory."""

    def batches(wanted: list[str]) -> Iterator[pa.RecordBatch]:
        yield from table.select(wanted).to_batches(_BATCH)

    head = table.slice(0, _SAMPLE).combine_chunks().to_batches()
    return ArrowTable(
        path, kind, tuple(table.column_names), table.num_rows, batches, _as_text(head[0] if head else None)
    )


def _as_text(head: pa.RecordBatch | None) -> tuple[tuple[str, ...], ...]:
    if head is None:
        return ()
    columns = [["" if value is None else str(value) for value in column.to_pylist()] for column in head.columns]
    return tuple(zip(*columns, strict=True))


def _check_zip(path: Path) -> None:
    """Refuse a zip that unpacks to far more than it holds; its own list of sizes says so."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        sizes = [part.file_size for part in archive.infolist()]
    check_growth(path, sum(sizes), path.stat().st_size)
    if max(sizes, default=0) > _LARGEST_PART_BYTES:
        raise RunFileError(f"{path}: a part of it unpacks to {max(sizes) / 1e9:.0f} GB; nothing was stored")
