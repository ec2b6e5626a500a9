"""Tables that come as Arrow batches: Parquet, Neware files (by the package fastnda), MAT and MDF files."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bench_service.exchange.columns import unique_names
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
    names : every column's name, in order; "x (2)" for the second x
    n : rows
    batches : gives the columns at the wanted positions, block by block
    sample : first rows as text
    units : each column's unit where the file names it apart from the name
    """

    path: Path
    kind: str
    names: tuple[str, ...]
    n: int
    batches: Callable[[list[int]], Iterator[list[pa.Array]]]
    sample: tuple[tuple[str, ...], ...]
    units: tuple[str, ...] = ()
    first_row: int = 1
    decimal: str = "."

    def read(
        self, numbers: Sequence[int], texts: Sequence[int], plain: bool, remarks: list[str], progress: Progress
    ) -> Iterator[dict[int, pa.Array]]:
        """Give the wanted columns block by block (arguments as for `TextTable.read`)."""
        import pyarrow as pa

        done = 0
        wanted = sorted({*numbers, *texts})
        for columns in self.batches(wanted):
            block = {}
            for k, column in zip(wanted, columns, strict=True):
                try:
                    block[k] = column.cast(pa.float64() if k in numbers else pa.string())
                except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
                    raise RunFileError(
                        f"{self.path}: column {self.names[k]!r} holds {column.type}, not numbers"
                    ) from error
            done += len(columns[0])
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

    def batches(wanted: list[int]) -> Iterator[list[pa.Array]]:
        # Columns of one name are read together: of these, each is told by its place.
        places = [(names[k], names[:k].count(names[k])) for k in wanted]
        try:
            with pq.ParquetFile(path) as file:
                for batch in file.iter_batches(_BATCH, columns=list({name: None for name, _ in places})):
                    yield [batch.column(batch.schema.get_all_field_indices(name)[k]) for name, k in places]
        except (pa.ArrowException, OSError) as error:
            raise RunFileError(f"{path}: is damaged: {str(error).splitlines()[0]}") from error

    return ArrowTable(path, "parquet", unique_names(names), n, batches, _as_text(head))


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

    channels = read_channels(path)
    table = pa.Table.from_arrays([pa.array(each.values) for each in channels], [each.name for each in channels])
    return of_table(path, "mdf", table, tuple(each.unit for each in channels))


def of_table(path: Path, kind: str, table: pa.Table, units: tuple[str, ...] = ()) -> ArrowTable:
    """Wrap a table that is in memory."""

    def batches(wanted: list[int]) -> Iterator[list[pa.Array]]:
        for batch in table.select(wanted).to_batches(_BATCH):
            yield batch.columns

    head = table.slice(0, _SAMPLE).combine_chunks().to_batches()
    names, sample = unique_names(table.column_names), _as_text(head[0] if head else None)
    return ArrowTable(path, kind, names, table.num_rows, batches, sample, units)


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
