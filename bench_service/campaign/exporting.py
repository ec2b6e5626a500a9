"""Runs on their way out of the store: under which name, and with which metadata."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import datetime

from bench_service.exchange.bdf_metadata import bdf_metadata
from bench_service.exchange.naming import run_file_name
from bench_service.store.cells import CellRecord
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import Json, RunRecord

_SHORT = 8  # letters of an id that people see
# Of a run's record: what the metadata file says; the whole record is in a crate.
_TOLD = ("id", "name", "label", "operator", "notes", "bench", "state", "reason", "dt_s", "started_utc", "ended_utc",
         "n_samples", "missed_ticks", "initial_soc", "capacity_Ah", "limits", "code_version")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Export:
    """A run that goes out.

    Attributes
    ----------
    store : MetadataStore
    run : RunRecord
    institution : str
        Whose service it is.
    version : str
        Of this program.
    """

    store: MetadataStore
    run: RunRecord
    institution: str
    version: str

    @property
    def name(self) -> str:
        """Name of its files, without the ends that tell the format; a run of no cell is named by its id."""
        run = self.run
        if run.cell_id is None:
            return f"run-{run.id}"
        day = run.started_utc or run.created_utc
        return run_file_name(self.institution, run.cell_id, day, self.store.runs.nth_of_day(run))

    @property
    def called(self) -> str:
        """What people call it."""
        return f"run {self.run.label or self.run.name or self.run.id[:_SHORT]}"

    @property
    def started_unix_s(self) -> float | None:
        """UTC of its time 0; None where nobody knows."""
        return None if self.run.started_utc is None else datetime.fromisoformat(self.run.started_utc).timestamp()

    @property
    def cell(self) -> CellRecord | None:
        """The cell that it belongs to."""
        return None if self.run.cell_id is None else self.store.cells.get(self.run.cell_id)

    def metadata(self) -> Json:
        """Return the document of the metadata file beside a file of the Battery Data Format."""
        cell = self.cell
        told: Json = {
            "institution": self.institution,
            "cell": None if cell is None else asdict(cell),
            "run": {name: getattr(self.run, name) for name in _TOLD},
            "samples_sha256": self.run.sha256,
        }
        return bdf_metadata(told, f"bench-service {self.version}")
