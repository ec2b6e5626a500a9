"""A text table of any dialect, read block by block."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bench_service.exchange.errors import RunFileError
from bench_service.exchange.foreign.byte_source import Progress, TextBytes, read_head
from bench_service.exchange.foreign.decimals import MISSING, cleaned
from bench_service.exchange.foreign.dialect import Dialect, find_dialect, open_quote

if TYPE_CHECKING:
    import pyarrow as pa

_BLOCK_BYTES = 8 << 20
_COMMENTS = ("~", "#", "%")


class NotPlainNumberError(Exception):
    """A number is not written plainly: read the columns as text and clean them."""


@dataclass(frozen=True, slots=True)
class TextTable:
    """A text table whose dialect is known; `read` gives its rows in blocks."""

    path: Path
    dialect: Dialect
    kind: str = "text"

    @property
    def names(self) -> tuple[str, ...]:
        """Every column's name, in order."""
        return self.dialect.names

    @property
    def units(self) -> tuple[str, ...]:
        """Each column's unit where a row of its own names it."""
        return self.dialect.units

    @property
    def sample(self) -> tuple[tuple[str, ...], ...]:
        """First rows as text."""
        return self.dialect.sample

    @property
    def decimal(self) -> str:
        """Mark of the decimals."""
        return self.dialect.decimal

    @property
    def first_row(self) -> int:
        """Line of the file in which the first row stands, from 1."""
        return self.dialect.first_row

    def read(
        self, numbers: Sequence[int], texts: Sequence[int], plain: bool, remarks: list[str], progress: Progress
    ) -> Iterator[dict[int, pa.Array]]:
        """Give the wanted columns block by block.

        Parameters
        ----------
        numbers, texts : positions of columns that hold numbers, and of such that stay text
        plain : numbers are written plainly; otherwise (slower) signs, groups of thousands and blanks are cleaned off
        remarks : filled with what a person should know
        progress : called with the share done

        Raises
        ------
        NotPlainNumberError
            `plain` was too much to hope.
        RunFileError
            A row that does not fit, a cell that is no number, a damaged file.
        """
        # Lazy: pyarrow takes 30 ms.
        import pyarrow as pa
        import pyarrow.csv as pa_csv

        odd: list[Any] = []
        raw = self._bytes(progress)
        try:
            with io.BufferedReader(raw, 1 << 20) as stream:
                try:
                    reader = pa_csv.open_csv(stream, *self._options(numbers, texts, plain, odd))
                except pa.ArrowInvalid as error:
                    if "Empty CSV" in str(error):
                        raise RunFileError(f"{self.path}: has a header but no rows") from error
                    raise
                held: dict[int, pa.Array] | None = None
                for batch in reader:
                    if held is not None:
                        yield held
                    held = self._columns(batch, numbers, plain)
                if held is not None:
                    yield held
        except pa.ArrowInvalid as error:
            if plain:
                raise NotPlainNumberError from error
            raise RunFileError(f"{self.path}: {self._explain(error, numbers)}") from error
        if raw.n_quotes % 2:
            self._judge_quotes()
        self._judge_odd(odd, remarks)

    def _bytes(self, progress: Progress) -> TextBytes:
        dialect = self.dialect
        return TextBytes(self.path, dialect.encoding, dialect.skip_chars, dialect.separator == " ", progress)

    def _open(self) -> io.TextIOWrapper:
        return io.TextIOWrapper(io.BufferedReader(self._bytes(lambda _share: None), 1 << 20), "utf-8", newline="")

    def _options(self, numbers: Sequence[int], texts: Sequence[int], plain: bool, odd: list[Any]) -> tuple[Any, ...]:
        import pyarrow as pa
        import pyarrow.csv as pa_csv

        number = pa.float64() if plain else pa.string()
        types = {str(k): number for k in numbers} | {str(k): pa.string() for k in texts}

        def handle(row: Any) -> str:
            if not row.text.lstrip().startswith(_COMMENTS):
                odd.append(row)
            if len(odd) > 1000:
                return "error"
            return "skip"

        return (
            pa_csv.ReadOptions(
                column_names=[str(k) for k in range(len(self.names))], use_threads=False, block_size=_BLOCK_BYTES
            ),
            pa_csv.ParseOptions(delimiter=self._separator, invalid_row_handler=handle),
            pa_csv.ConvertOptions(
                column_types=types,
                include_columns=list(types),
                null_values=list(MISSING),
                strings_can_be_null=False,
                quoted_strings_can_be_null=True,
                decimal_point=self.dialect.decimal,
                check_utf8=False,
            ),
        )

    @property
    def _separator(self) -> str:
        return "\t" if self.dialect.separator == " " else self.dialect.separator

    def _columns(self, batch: pa.RecordBatch, numbers: Sequence[int], plain: bool) -> dict[int, pa.Array]:
        columns = {int(name): batch.column(k) for k, name in enumerate(batch.schema.names)}
        if plain:
            return columns
        return {k: cleaned(array, self.dialect.decimal) if k in numbers else array for k, array in columns.items()}

    def _judge_quotes(self) -> None:
        """Refuse a cell that a quotation mark opens and nothing closes, so that all lines behind it are in it."""
        row, more = self.first_row, True
        with self._open() as text:
            rows = csv.reader(text, delimiter=self._separator)
            while more:
                line = rows.line_num
                try:
                    cells = next(rows, None)
                except csv.Error:  # more than a cell can hold
                    cells = ["\n"]
                if cells is not None and any("\n" in cell for cell in cells):
                    raise RunFileError(f"{self.path}: {open_quote(row + line)}")
                more = cells is not None

    def _judge_odd(self, odd: list[Any], remarks: list[str]) -> None:
        """Rows of another width: the last line of a cut file is left out, anything else is refused."""
        if not odd:
            return
        row, text = self._find_odd()
        fields = f"line {row} has {odd[0].actual_columns} fields, the others {odd[0].expected_columns}"
        if len(odd) > 1 or not text:
            raise RunFileError(
                f"{self.path}: {fields} ({len(odd)} such line(s)): the file is damaged, or a second table follows; "
                "export it again or split it there"
            )
        remarks.append(f"{fields}: the file is cut off in its last line, which is left out")

    def _find_odd(self) -> tuple[int, bool]:
        """Line of the first row of another width, and whether it is the last of the file; slow, for odd files only."""
        n = len(self.names)
        first, last = 0, 0
        with self._open() as text:
            for row, cells in enumerate(csv.reader(text, delimiter=self._separator), start=self.first_row):
                if cells:
                    last = row
                if cells and len(cells) != n and not cells[0].lstrip().startswith(_COMMENTS) and not first:
                    first = row
        return first, first == last

    def _explain(self, cause: BaseException, numbers: Sequence[int]) -> str:
        """Find the cell that is no number; slow, for refused files only."""
        import pyarrow as pa

        n = len(self.names)
        with self._open() as text:
            for row, cells in enumerate(csv.reader(text, delimiter=self._separator), start=self.first_row):
                if len(cells) != n:
                    continue
                for k in numbers:
                    try:
                        cleaned(pa.array([cells[k]], pa.string()), self.dialect.decimal)
                    except pa.ArrowInvalid:
                        mark = "comma" if self.dialect.decimal == "," else "point"
                        also = f" with a decimal {mark}, as others are" if re.search("[.,]", cells[k]) else ""
                        return f"line {row}, column {self.names[k]!r}: {cells[k][:40]!r} is not a number{also}"
        return f"cannot be read: {str(cause).splitlines()[0]}"


def open_text(path: Path) -> TextTable:
    """Look at a text file and find its table; raises RunFileError where there is none."""
    text, encoding, whole = read_head(path)
    return TextTable(path, find_dialect(path, text, encoding, whole))
