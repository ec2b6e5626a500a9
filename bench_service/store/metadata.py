"""The metadata of a data directory, table by table: the API process writes them, and it alone."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from bench_service.store import engine as engines
from bench_service.store import schema
from bench_service.store.access import LOCK_FILE, MetadataFile
from bench_service.store.campaigns import CampaignTable
from bench_service.store.cells import CellTable
from bench_service.store.commissionings import CommissioningTable
from bench_service.store.comparisons import ComparisonTable
from bench_service.store.devices import DeviceTable
from bench_service.store.diagnoses import DiagnosisTable
from bench_service.store.engine import LockHolder
from bench_service.store.events import EventTable
from bench_service.store.models import ModelTable
from bench_service.store.profiles import ProfileTable
from bench_service.store.protocols import ProtocolTable
from bench_service.store.records import utc_text
from bench_service.store.runs import RunTable


class MetadataStore:
    """The metadata of one data directory; methods, and those of its tables, may be called from several threads.

    Pages come newest first. Every method that looks for one thing raises `NotFoundError` where it is not there, and
    every method raises `StoreError` where the database fails.

    Attributes
    ----------
    profiles, protocols, runs, models, comparisons, diagnoses, campaigns, events, commissionings, cells, devices
        The tables; each is a file of its own.
    """

    def __init__(self, file: MetadataFile, clock: Callable[[], datetime]) -> None:
        self._file = file

        def now() -> str:
            return utc_text(clock())

        self.profiles = ProfileTable(file, now)
        self.protocols = ProtocolTable(file, now)
        self.runs = RunTable(file, now)
        self.models = ModelTable(file, now)
        self.comparisons = ComparisonTable(file, now)
        self.diagnoses = DiagnosisTable(file, now)
        self.campaigns = CampaignTable(file, now)
        self.events = EventTable(file, now)
        self.commissionings = CommissioningTable(file, now)
        self.cells = CellTable(file, now)
        self.devices = DeviceTable(file, now)

    @classmethod
    def open(
        cls,
        data_dir: Path,
        *,
        url: str | None = None,
        lock_timeout_s: float = 0.0,
        clock: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> "MetadataStore":
        """Open, or create, the metadata of a data directory for reading and writing.

        Parameters
        ----------
        data_dir : Path
        url : str, optional
            Address at which this service answers, for others that find the store taken.
        lock_timeout_s : float
            How long to wait for the present writer to go.
        clock : callable
            Returns the present time, with its zone.

        Raises
        ------
        StoreError
            Another process writes them (the message names it), or the file cannot be opened.
        """
        store = cls(MetadataFile.open(data_dir, lock_timeout_s), clock)
        store.announce(url)
        return store

    @classmethod
    def look(cls, data_dir: Path) -> "MetadataStore":
        """Open the metadata for reading alone, also while a service writes them; raises `StoreError`."""
        return cls(MetadataFile.look(data_dir), lambda: datetime.now(UTC))

    @staticmethod
    def holder(data_dir: Path) -> LockHolder | None:
        """Return which process has the metadata open for writing, and its address; None where none has."""
        return engines.lock_holder(data_dir / LOCK_FILE)

    def place(self, table: str, record_id: str | int) -> int:
        """Return where a record stands in the order of its table, which nothing moves; raises `NotFoundError`."""
        return self._file.place(schema.META.tables[table], record_id)

    def announce(self, url: str | None) -> None:
        """Tell other processes the address at which this service answers."""
        if self._file.lock is not None:
            self._file.lock.announce(url)

    def close(self) -> None:
        """Close the file and give the lock back."""
        self._file.close()
