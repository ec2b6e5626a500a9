"""Files of other programs become stored runs: uploaded piece by piece, looked at and read by workers, then stored."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import socket
import time
import uuid
from collections.abc import AsyncIterator, Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

from bench_service.campaign.cell_of_run import known_cell
from bench_service.campaign.storage import Storage
from bench_service.errors import BadRequestError, ConflictError, NotFoundError, ServiceError
from bench_service.exchange.foreign.mapping import FOLDER, Mapping, load_mapping, mapping_names, save_mapping
from bench_service.exchange.foreign.outside import Readers
from bench_service.exchange.foreign.work import convert, look_at, stored_blocks
from bench_service.jobs.runner import Job, JobRunner
from bench_service.recorder.feeding import feed
from bench_service.store.metadata import MetadataStore
from bench_service.store.records import IMPORTED, Json, RunIntent, utc_text

MOST_BYTES = 20 * 2**30
_UPLOADS, _CONTENT, _META = "uploads", "content", "upload.json"
_KEPT_S = 7 * 86400.0
_ID = re.compile(r"[0-9a-f]{32}")
_SAMPLE_BYTES = 60  # of text, about: what a row takes in a cycler's file


class Importing:
    """Takes files in.

    Parameters
    ----------
    store : MetadataStore
    jobs : JobRunner
    storage : Storage
        Asked whether a run could be stored.
    attach : callable
        Gives a sample link to the recorder.
    data_dir, code_version : where uploads and mappings are kept; noted with each run
    readers : programs of the user's own that read what is not read here
    """

    def __init__(
        self,
        store: MetadataStore,
        jobs: JobRunner,
        storage: Storage,
        attach: Callable[[str], socket.socket],
        made: tuple[Path, str],
        readers: Readers,
    ) -> None:
        self._store, self._jobs, self._storage, self._attach = store, jobs, storage, attach
        self._folder, self._mappings = made[0] / _UPLOADS, made[0] / FOLDER
        self._code_version, self._readers = made[1], readers
        # Of each upload: the request that writes to it, the latest.
        self._writing: dict[str, object] = {}

    def add(self, name: str) -> Json:
        """Begin an upload; old ones that nobody stored are forgotten."""
        self._forget_old()
        upload_id = uuid.uuid4().hex
        folder = self._folder / upload_id
        folder.mkdir(parents=True, mode=0o700)
        (folder / _CONTENT).touch(mode=0o600)
        (folder / _META).write_text(json.dumps({"name": name}))
        return self.get(upload_id)

    def get(self, upload_id: str) -> Json:
        """Tell how much of an upload is there; raises NotFoundError."""
        folder = self._of(upload_id)
        name = json.loads((folder / _META).read_text())["name"]
        return {"id": upload_id, "name": name, "n_bytes": (folder / _CONTENT).stat().st_size}

    async def append(self, upload_id: str, offset: int, pieces: AsyncIterator[bytes]) -> Json:
        """Add to an upload from `offset` on, which must be where it ends; what has come of a broken one stays.

        Raises
        ------
        ConflictError
            It ends elsewhere: go on from there. Or a later request has gone on with it while this one was waiting for
            its next piece: a client that took this connection for lost.
        """
        content = self._of(upload_id) / _CONTENT
        there = content.stat().st_size
        if offset != there:
            raise ConflictError(f"the upload has {there} bytes: go on from offset {there}, not {offset}")
        mine = self._writing[upload_id] = object()
        try:
            with content.open("ab") as stream:
                async for piece in pieces:
                    if self._writing.get(upload_id) is not mine:
                        raise ConflictError("a later request goes on with this upload: this one has ended")
                    there += len(piece)
                    if there > MOST_BYTES:
                        raise BadRequestError("the file is too large", value=there, unit="bytes", limit=MOST_BYTES)
                    stream.write(piece)
                    stream.flush()  # what a later request goes on from is all there is
        finally:
            if self._writing.get(upload_id) is mine:
                del self._writing[upload_id]
        return self.get(upload_id)

    def drop(self, upload_id: str) -> None:
        """Forget an upload."""
        shutil.rmtree(self._of(upload_id), ignore_errors=True)

    def look(self, upload_id: str, choices: Json) -> Job:
        """Queue a look at an upload; the job's result is that of `exchange.foreign.work.look_at`."""
        path, name, mapping = self._asked(upload_id, choices)
        return self._jobs.submit("import", look_at, path, name, choices, mapping, self._readers)

    def store(self, upload_id: str, choices: Json, told: Json) -> Job:
        """Queue the reading and storing of an upload; the job's result has the run's id in ``run``.

        Parameters
        ----------
        told : mapping
            ``capacity_Ah`` and ``initial_soc``; ``name``, or None for that of the file; ``cell_id``, or None.

        Raises
        ------
        NotFoundError
            There is no such upload, or no such cell.
        """
        told = told | {"cell_id": known_cell(self._store, told.get("cell_id"))}
        path, name, mapping = self._asked(upload_id, choices)
        self._storage.refuse(path.stat().st_size // _SAMPLE_BYTES)

        def keep(result: Json) -> Json:
            return self._keep(upload_id, path, result, told)

        return self._jobs.submit("import", convert, path, name, choices, mapping, self._readers, store=keep)

    def mappings(self) -> list[Json]:
        """Return the mappings that are remembered."""
        return [load_mapping(self._mappings, name).to_json() for name in mapping_names(self._mappings)]

    def save_mapping(self, document: Json) -> Json:
        """Remember a mapping by the name in it; raises RunFileError where it is none."""
        mapping = Mapping.from_json(document, "mapping")
        save_mapping(self._mappings, mapping)
        return mapping.to_json()

    def _asked(self, upload_id: str, choices: Json) -> tuple[Path, str, Json | None]:
        path, name = self._of(upload_id) / _CONTENT, choices.pop("mapping", None)
        mapping = None if name is None else load_mapping(self._mappings, name).to_json()
        return path, str(self.get(upload_id)["name"]), mapping

    def _keep(self, upload_id: str, path: Path, result: Json, told: Json) -> Json:
        """Store what a worker has read, as a run; in a thread."""
        intent = RunIntent(
            bench=IMPORTED,
            profile_id=None,
            dt_s=result["dt_s"] or 1.0,
            initial_soc=told["initial_soc"],
            capacity_Ah=told["capacity_Ah"],
            limits={"current_A": result["current_A"], "voltage_V": result["voltage_V"]},
            code_version=self._code_version,
            name=told.get("name") or result["name"],
            cell_id=told["cell_id"],
        )
        digest = _sha256(path)
        run = self._store.runs.add(intent)
        self._store.runs.start(run.id)
        try:
            sealed = feed(self._attach(IMPORTED), run.id, stored_blocks(path.parent / "run.parquet"))
        except ServiceError as error:
            self._store.runs.end(run.id, "interrupted", str(error))
            raise
        self._store.runs.end(
            run.id, "completed", None, n_samples=sealed.n_samples, missed_ticks=0, sha256=sealed.sha256
        )
        self._date(run.id, result)
        self._store.runs.describe(run.id, {"notes": _notes(result, digest)})
        self.drop(upload_id)
        return {"run": run.id, "state": "completed", "samples": sealed.n_samples} | {
            key: result[key] for key in ("mapping", "remarks", "ignored_columns")
        }

    def _date(self, run_id: str, result: Json) -> None:
        """Give a run the time at which it was measured in place of that at which it came in."""
        began_s = result["started_unix_s"]
        began = None if began_s is None else datetime.fromtimestamp(began_s, UTC)
        ended = datetime.now(UTC) if began is None else began + timedelta(seconds=result["duration_s"])
        self._store.runs.date(run_id, began and utc_text(began), utc_text(ended), result["duration_s"])

    def _of(self, upload_id: str) -> Path:
        folder = self._folder / upload_id
        if not _ID.fullmatch(upload_id) or not (folder / _META).is_file():
            raise NotFoundError.of("upload", upload_id)
        return folder

    def _forget_old(self) -> None:
        if not self._folder.is_dir():
            return
        for folder in self._folder.iterdir():
            if time.time() - folder.stat().st_mtime > _KEPT_S:
                shutil.rmtree(folder, ignore_errors=True)


def _notes(result: Json, digest: str) -> str:
    """Where a run is from, for its record; at most what notes may hold."""
    lines = [f"Imported from {result['name']} (SHA-256 {digest}), read as {result['mapping']['title']}."]
    return "\n".join([*lines, *result["remarks"]])[:4000]


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
