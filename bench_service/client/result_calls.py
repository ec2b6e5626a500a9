"""What the REST API offers about results: lists of comparisons and diagnoses, experiments, jobs, tables."""

from __future__ import annotations

from typing import Unpack

from bench_service.client.connection import API, AT_WORK_S, Connection, Record, part
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

    def run_report(self, run_id: str, format: str = "html") -> bytes:  # noqa: A002  # the option's public name
        """Report of a run as a page, or with ``format="pdf"`` as PDF."""
        return self._report("runs", run_id, format)

    def campaign_report(self, campaign_id: str, format: str = "html") -> bytes:  # noqa: A002
        """Report of a campaign, as far as it came."""
        return self._report("campaigns", campaign_id, format)

    def comparison_report(self, comparison_id: str, format: str = "html") -> bytes:  # noqa: A002
        """Report of a comparison, with its curves."""
        return self._report("comparisons", comparison_id, format)

    def diagnosis_report(self, diagnosis_id: str, format: str = "html") -> bytes:  # noqa: A002
        """Report of a diagnosis, with the evidence."""
        return self._report("diagnoses", diagnosis_id, format)

    def trend_report(self, job_id: str, format: str = "html") -> bytes:  # noqa: A002
        """Report of a cell's life, by the job that has followed it."""
        return self._report("trends", job_id, format)

    def design_report(self, job_id: str, format: str = "html") -> bytes:  # noqa: A002
        """Report of a design, by the job that has made it."""
        return self._report("designs", job_id, format)

    def _report(self, kind: str, name: str, format_name: str) -> bytes:
        address = f"{API}/{kind}/{part(name)}/report"
        # Simulated, and for a PDF printed, while the client waits.
        return self._connection.send("GET", address, params={"format": format_name}, timeout=AT_WORK_S).content

    def job(self, job_id: str) -> Record:
        """One job: state, progress, result or error."""
        return self._connection.get(f"{API}/jobs/{part(job_id)}")

    def cancel_job(self, job_id: str) -> Record:
        """End a job."""
        return self._connection.post(f"{API}/jobs/{part(job_id)}/cancel")

    def formats(self) -> list[Record]:
        """Formats that a run can be exported in: name, title, suffix, media type."""
        return self._connection.get(f"{API}/formats")["formats"]
