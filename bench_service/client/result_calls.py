"""What the REST API offers about results: lists of comparisons and diagnoses, experiments, jobs, tables."""

from __future__ import annotations

from typing import Unpack

from bench_service.client.connection import API, Connection, Record, part
from bench_service.client.model_calls import ModelCalls
from bench_service.client.waiting import Patience


class ResultCalls:
    """Part of a `BenchClient`.

    Parameters
    ----------
    connection : Connection
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._wait_job = ModelCalls(connection).wait_job

    def comparisons(self, **filters: object) -> list[Record]:
        """Comparisons, newest first; filters are model_id, cell_id, limit, offset."""
        return self._connection.get(f"{API}/comparisons", **filters)["comparisons"]

    def diagnoses(self, **filters: object) -> list[Record]:
        """Diagnoses, newest first; filters are model_id, cell_id, limit, offset."""
        return self._connection.get(f"{API}/diagnoses", **filters)["diagnoses"]

    def diagnosis(self, diagnosis_id: str) -> Record:
        """One diagnosis: verdict, findings with evidence, next experiment."""
        return self._connection.get(f"{API}/diagnoses/{part(diagnosis_id)}")

    def design_experiment(
        self, diagnosis_id: str, bench: str, *, initial_soc: float | None = None, **patience: Unpack[Patience]
    ) -> Record:
        """Design the profile that tells a diagnosis' rivals apart; give ``{"profile_id", "initial_soc", "dt_s"}``."""
        body = {"bench": bench, "initial_soc": initial_soc}
        job = self._connection.post(f"{API}/diagnoses/{part(diagnosis_id)}/experiment", body)
        return self._wait_job(job["id"], **patience)["result"]

    def trend_table(self, job_id: str) -> bytes:
        """What has become of a cell, as `trend` has found it, as the bytes of a CSV file."""
        return self._connection.send("GET", f"{API}/trends/{part(job_id)}/table").content

    def job(self, job_id: str) -> Record:
        """One job: state, progress, result or error."""
        return self._connection.get(f"{API}/jobs/{part(job_id)}")

    def cancel_job(self, job_id: str) -> Record:
        """End a job."""
        return self._connection.post(f"{API}/jobs/{part(job_id)}/cancel")

    def formats(self) -> list[Record]:
        """Formats that a run can be exported in: name, title, suffix, media type."""
        return self._connection.get(f"{API}/formats")["formats"]
