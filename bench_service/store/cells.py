"""Cells of one data directory: what each is, whose it is, and on which bench it stands."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from sqlalchemy import Row, func, select, update

from bench_service.errors import ConflictError, NotFoundError
from bench_service.store import rows, schema
from bench_service.store.access import MetadataFile
from bench_service.store.belonging import give_run
from bench_service.store.records import Json

_PREFIX = "C"  # of an id that nobody has chosen: C1, C2, ...


@dataclass(frozen=True, slots=True, kw_only=True)
class CellRecord:
    """One cell that can be held in the hand.

    Attributes
    ----------
    id : str
        Short enough to be typed; large and small letters are the same.
    label, owner : str or None
    type : dict or None
        What its data sheet says, with the keys of `config.CellTypeConfig`; None where nobody knows.
    capacity_Ah : float or None
        What it was measured to hold; None: what its type says.
    metadata : dict
        Whatever its owner keeps with it: text, numbers, true or false, by name.
    retired_utc : str or None
        Since when it is not used any more.
    """

    id: str
    label: str | None = None
    owner: str | None = None
    type: Json | None = None
    capacity_Ah: float | None = None
    metadata: Json = field(default_factory=dict)
    created_utc: str
    retired_utc: str | None = None

    @property
    def called(self) -> str:
        """What people call it: its id, and its label where it has one."""
        return self.id if self.label is None else f"{self.id} ({self.label})"


@dataclass(frozen=True, slots=True)
class Place:
    """A cell on a bench, or, with None, that nobody has said which is there."""

    bench: str
    cell_id: str | None
    since_utc: str


class CellTable:
    """Stores cells and finds them; see `MetadataStore`."""

    def __init__(self, file: MetadataFile, now: Callable[[], str]) -> None:
        self._file = file
        self._now = now

    def add(self, cell_id: str | None = None, **told: Any) -> CellRecord:
        """Store a new cell; `told` are fields of `CellRecord`. Without an id it gets the next free one.

        Raises
        ------
        ConflictError
            There is one with this id.
        """
        record = CellRecord(id=cell_id or self._free_id(), created_utc=self._now(), **told)
        if self._row(record.id) is not None:
            raise ConflictError(f"there is a cell {record.id} already; choose another id", ("id", record.id))
        self._file.insert(schema.cell, asdict(record) | {"words": _words(record)})
        return record

    def get(self, cell_id: str) -> CellRecord:
        """Return a cell, by its id in large or small letters."""
        row = self._row(cell_id)
        if row is None:
            raise NotFoundError.of("cell", cell_id)
        return _cell(row)

    def page(
        self,
        words: str | None = None,
        limit: int = 100,
        offset: int = 0,
        *,
        retired: bool = True,
        after: int | None = None,
    ) -> list[CellRecord]:
        """Return cells in whose texts each of `words` occurs; `retired`: those too that are not used any more."""
        table = schema.cell
        query = select(table)
        for word in (words or "").lower().split():
            query = query.where(table.c.words.contains(word, autoescape=True))
        if not retired:
            query = query.where(table.c.retired_utc.is_(None))
        return [_cell(row) for row in self._file.page(table, query, limit, offset, after)]

    def change(self, cell_id: str, told: Json) -> tuple[CellRecord, CellRecord]:
        """Write other values of a cell's fields down; return it before and after."""
        before = self.get(cell_id)
        after = CellRecord(**(asdict(before) | told))
        table = schema.cell
        with self._file.write() as link:
            link.execute(update(table).where(table.c.id == before.id).values(told | {"words": _words(after)}))
        return before, self.get(cell_id)

    def retire(self, cell_id: str, *, used_again: bool = False) -> CellRecord:
        """Note that a cell is not used any more, or is again; one that stands on a bench is refused.

        Raises
        ------
        ConflictError
            It stands on a bench.
        """
        cell = self.get(cell_id)
        if not used_again and (bench := self.bench_of(cell.id)) is not None:
            raise ConflictError(f"cell {cell.id} is on bench {bench!r}; take it off first", ("cell_id", cell.id))
        retired_utc = None if used_again else cell.retired_utc or self._now()
        return self.change(cell.id, {"retired_utc": retired_utc})[1]

    # --- benches and runs ------------------------------------------------------------------------------------

    def put(self, bench: str, cell_id: str | None) -> Place:
        """Note which cell is on a bench from now on.

        Raises
        ------
        ConflictError
            It is on another bench, or not used any more.
        """
        if cell_id is not None:
            cell = self.get(cell_id)
            if cell.retired_utc is not None:
                raise ConflictError(f"cell {cell.id} is retired; take it into use again first", ("cell_id", cell.id))
            if (other := self.bench_of(cell.id)) not in (None, bench):
                raise ConflictError(f"cell {cell.id} is on bench {other!r}; take it off there", ("cell_id", cell.id))
            cell_id = cell.id
        place = Place(bench, cell_id, self._now())
        self._file.insert(schema.cell_place, asdict(place))
        return place

    def place(self, bench: str) -> Place | None:
        """Return which cell is on a bench, and since when; None where nobody has ever said."""
        table = schema.cell_place
        query = select(table).where(table.c.bench == bench).order_by(table.c.id.desc()).limit(1)
        with self._file.read() as link:
            row = link.execute(query).one_or_none()
        return None if row is None else Place(row.bench, row.cell_id, row.since_utc)

    def places(self, cell_id: str) -> list[Place]:
        """Return the benches on which a cell was put, newest first."""
        table = schema.cell_place
        with self._file.read() as link:
            found = link.execute(select(table).where(table.c.cell_id == cell_id).order_by(table.c.id.desc())).all()
        return [Place(row.bench, row.cell_id, row.since_utc) for row in found]

    def bench_of(self, cell_id: str) -> str | None:
        """Return the bench on which a cell is; None where it is on none."""
        return self.benches([cell_id]).get(cell_id)

    def benches(self, cell_ids: Sequence[str]) -> dict[str, str]:
        """Return the benches on which cells are, by cell; those that are on none are left out."""
        table = schema.cell_place
        newest = select(func.max(table.c.id)).group_by(table.c.bench)
        query = select(table.c.cell_id, table.c.bench).where(table.c.id.in_(newest), table.c.cell_id.in_(cell_ids))
        with self._file.read() as link:
            return {str(row.cell_id): str(row.bench) for row in link.execute(query)}

    def give_run(self, run_id: str, cell_id: str | None) -> None:
        """Let a run belong to a cell or to none, and what was made from it; raises `NotFoundError`."""
        give_run(self._file, run_id, None if cell_id is None else self.get(cell_id).id)

    def counts(self, cell_ids: Sequence[str]) -> dict[str, Json]:
        """Return how many runs, models, comparisons and diagnoses belong to each of some cells."""
        counted: dict[str, Json] = {cell_id: {} for cell_id in cell_ids}
        with self._file.read() as link:
            for table in (schema.run, schema.model, schema.comparison, schema.diagnosis):
                column = table.c.cell_id
                query = select(column, func.count()).where(column.in_(cell_ids)).group_by(column)
                found = {str(cell_id): int(n) for cell_id, n in link.execute(query)}
                for cell_id in cell_ids:
                    counted[cell_id][f"n_{table.name}"] = found.get(cell_id, 0)
        return counted

    def _row(self, cell_id: str) -> Row[Any] | None:
        table = schema.cell
        with self._file.read() as link:
            return link.execute(select(table).where(func.lower(table.c.id) == cell_id.lower())).one_or_none()

    def _free_id(self) -> str:
        table = schema.cell
        with self._file.read() as link:
            n = int(link.execute(select(func.count()).select_from(table)).scalar_one())
        while self._row(f"{_PREFIX}{n + 1}") is not None:
            n += 1
        return f"{_PREFIX}{n + 1}"


def _cell(row: Row[Any]) -> CellRecord:
    fields = rows.fields(row)
    fields.pop("words")
    return CellRecord(**fields)


def _words(cell: CellRecord) -> str:
    """All that a cell is found by."""
    kind = cell.type or {}
    told = [cell.id, cell.label, cell.owner, *(kind.get(key) for key in ("maker", "model", "chemistry"))]
    told += [f"{name} {value}" for name, value in cell.metadata.items()]
    return "\n".join(str(each) for each in told if each is not None).lower()
