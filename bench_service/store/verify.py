"""Everything that is stored, read once and held against what its records promise."""

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy import select

from bench_service.errors import StoreError
from bench_service.store import engine as engines
from bench_service.store import rows, schema
from bench_service.store.access import FILE as META_FILE
from bench_service.store.integrity import Expected, damage_of
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunRecord
from bench_service.store.samples import FILE, SampleReader
from bench_service.streams import OBSERVER
from models.data.seal import content_sha256

Told = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is not as it should be.

    Attributes
    ----------
    kind : str
        ``"file"``, ``"run"``, ``"observer"``, ``"profile"``, ``"model"`` or ``"commissioning"``.
    name : str
        Which one: file name or id.
    what : str
        What is wrong with it.
    known : bool
        Whether it has been repaired before, as far as it could be: the loss is written down.
    """

    kind: str
    name: str
    what: str
    known: bool = False

    def to_json(self) -> Json:
        """Return a JSON object."""
        return {"kind": self.kind, "name": self.name, "what": self.what, "known": self.known}


@dataclass(slots=True)
class Report:
    """What was looked at, and what was found."""

    n_runs: int = 0
    n_samples: int = 0
    findings: list[Finding] = field(default_factory=list)

    @property
    def damaged(self) -> list[Finding]:
        """What is wrong and has not been written down by a repair."""
        return [finding for finding in self.findings if not finding.known]


def verify(data_dir: Path, told: Told = lambda _done, _all: None) -> Report:
    """Read all that is stored in a data directory; a service may be writing it meanwhile.

    Parameters
    ----------
    data_dir : Path
    told : callable
        Takes how many runs have been read, and of how many.

    Raises
    ------
    StoreError
        There is no store, or its metadata cannot be read at all.
    """
    report = Report(findings=list(_files(data_dir)))
    with closing(MetadataStore.look(data_dir)) as store, closing(SampleReader(data_dir)) as reader:
        runs = store.runs.ended()
        report.n_runs = len(runs)
        for number, run in enumerate(runs, 1):
            report.n_samples += _run(reader, run, report)
            told(number, len(runs))
    report.findings += _documents(data_dir)
    return report


def _files(data_dir: Path) -> Iterator[Finding]:
    for name in (META_FILE, FILE):
        if (data_dir / name).exists():
            for fault in engines.faults_of(data_dir / name):
                yield Finding("file", name, fault)


def _run(reader: SampleReader, run: RunRecord, report: Report) -> int:
    expected = Expected.of(run)
    try:
        data, observer = reader.read(run.id), reader.read(run.id, OBSERVER)
    except StoreError as error:
        report.findings.append(Finding("run", run.id, error.message))
        return 0
    if (damage := damage_of(expected, data)) is not None:
        report.findings.append(Finding("run", run.id, damage, damage == expected.loss))
    if observer.gaps:
        lost = sum(gap.n for gap in observer.gaps)
        text = f"{lost} rows of the live observer cannot be read ({observer.gaps[0].reason})"
        report.findings.append(Finding("observer", run.id, text, expected.loss is not None and not observer.damaged))
    return data.n


def _documents(data_dir: Path) -> list[Finding]:
    """Profiles, models and commissioning records, which have checksums of their own."""
    found: list[Finding] = []
    engine = engines.open_reader(data_dir / META_FILE)
    with closing(_Disposed(engine)), engine.begin() as link:
        for row in link.execute(select(schema.profile)):
            try:
                rows.checked_points(row)
            except StoreError as error:
                found.append(Finding("profile", row.id, error.message))
        for row in link.execute(select(schema.model.c.id, schema.model.c.sha256, schema.model.c.document)):
            if rows.document_hash(row.document) != row.sha256:
                found.append(Finding("model", row.id, "its document is not the one that was stored: another hash"))
        for row in link.execute(select(schema.commissioning)):
            if content_sha256(row.document) != row.sha256:
                found.append(Finding("commissioning", row.id, "it is not the one that was stored: another hash"))
    return found


class _Disposed:
    def __init__(self, engine: engines.Engine) -> None:
        self.close = engine.dispose
