"""Python client of the REST API, for campaigns and for the command line."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self

from bench_service.connection import ClientError, Connection, Record, part, wait_until

__all__ = ["ENDED_CAMPAIGN_STATES", "ENDED_RUN_STATES", "BenchClient", "ClientError"]

ENDED_RUN_STATES = frozenset({"completed", "stopped", "fault", "interrupted"})
ENDED_CAMPAIGN_STATES = frozenset({"completed", "failed", "stopped", "interrupted"})
_API = "/api/v1"


class BenchClient:
    """Talks to one service; to be closed, or used in a ``with`` statement.

    Parameters
    ----------
    url : str
        Address that the service printed, for example ``http://127.0.0.1:8000``.
    timeout_s : float
        Longest wait for one answer.
    """

    def __init__(self, url: str, timeout_s: float = 30.0) -> None:
        self.url = url.rstrip("/")
        self._connection = Connection(self.url, timeout_s)

    def __enter__(self) -> Self:
        """Give itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._connection.close()

    # --- service and benches -------------------------------------------------------------------------------

    def health(self) -> Record:
        """Version of the service, state of recorder and benches."""
        return self._connection.get("/healthz")

    def benches(self) -> list[Record]:
        """All benches."""
        return self._connection.get(f"{_API}/benches")["benches"]

    def bench(self, name: str) -> Record:
        """One bench: state, capabilities, limits, last live values."""
        return self._connection.get(f"{_API}/benches/{part(name)}")

    def stop_bench(self, name: str) -> Record:
        """Stop the bench's run, if there is one."""
        return self._connection.post(f"{_API}/benches/{part(name)}/stop")

    def open_seal(self, name: str) -> Record:
        """Tell which effect is hidden in a bench's simulated cell: ``{"sha256", "opened"}``."""
        return self._connection.post(f"{_API}/benches/{part(name)}/seal/open")

    def acknowledge(self, name: str) -> Record:
        """Clear a latched fault."""
        return self._connection.post(f"{_API}/benches/{part(name)}/acknowledge")

    # --- profiles and runs ---------------------------------------------------------------------------------

    def upload_profile(self, name: str, time_s: Sequence[float], current_A: Sequence[float]) -> Record:
        """Store a profile (forward hold, positive current charges); give its record."""
        body = {"name": name, "time_s": [float(t) for t in time_s], "current_A": [float(i) for i in current_A]}
        return self._connection.post(f"{_API}/profiles", body)

    def profiles(self) -> list[Record]:
        """All profiles."""
        return self._connection.get(f"{_API}/profiles")["profiles"]

    def profile(self, profile_id: str, points: bool = False) -> Record:
        """One profile; ``points`` adds ``time_s`` and ``current_A``."""
        return self._connection.get(f"{_API}/profiles/{part(profile_id)}", points=points)

    def start_run(
        self,
        bench: str,
        profile_id: str,
        dt_s: float,
        initial_soc: float,
        *,
        limits: Record | None = None,
        model_id: str | None = None,
        observer_initial_soc: float | None = None,
        name: str | None = None,
        seed: int | None = None,
    ) -> Record:
        """Start a run; give its record, with state ``running``."""
        body = {
            "bench": bench,
            "profile_id": profile_id,
            "dt_s": float(dt_s),
            "initial_soc": float(initial_soc),
            "limits": limits,
            "model_id": model_id,
            "observer_initial_soc": observer_initial_soc,
            "name": name,
            "seed": seed,
        }
        return self._connection.post(f"{_API}/runs", {key: value for key, value in body.items() if value is not None})

    def runs(self, **filters: object) -> list[Record]:
        """Runs, newest first; filters are bench, state, campaign_id, limit, offset."""
        return self._connection.get(f"{_API}/runs", **filters)["runs"]

    def run(self, run_id: str) -> Record:
        """One run."""
        return self._connection.get(f"{_API}/runs/{part(run_id)}")

    def stop_run(self, run_id: str) -> Record:
        """Stop a run; its end is waited for with `wait_run`."""
        return self._connection.post(f"{_API}/runs/{part(run_id)}/stop")

    def wait_run(
        self,
        run_id: str,
        on_progress: Callable[[Record, Record | None], None] | None = None,
        *,
        timeout_s: float | None = None,
        poll_s: float = 0.2,
    ) -> Record:
        """Wait until a run has ended and give its record.

        Parameters
        ----------
        run_id : str
            The run.
        on_progress : callable or None
            Called with the run's record and the bench's live values at each look.
        timeout_s : float or None
            Longest wait; then `ClientError`. The run goes on.
        poll_s : float
            Time between looks.
        """

        def look() -> Record:
            run = self.run(run_id)
            if on_progress is not None:
                live = self.bench(run["bench"])["live"] if run["state"] not in ENDED_RUN_STATES else None
                on_progress(run, live if live and live["run_id"] == run_id else None)
            return run

        return wait_until(look, lambda run: run["state"] in ENDED_RUN_STATES, f"run {run_id}", timeout_s, poll_s)

    def samples(
        self,
        run_id: str,
        *,
        stream: str = "samples",
        from_s: float | None = None,
        to_s: float | None = None,
        max_points: int | None = None,
    ) -> Record:
        """Columns of a run's samples, or with ``stream="observer"`` of its observer; None is a missing value."""
        address = f"{_API}/runs/{part(run_id)}/{part(stream)}"
        return self._connection.get(address, from_s=from_s, to_s=to_s, max_points=max_points)

    def export(self, run_id: str, format: str = "bdf") -> bytes:  # noqa: A002  # the option's public name
        """Give the run as the bytes of a file."""
        return self._connection.send("GET", f"{_API}/runs/{part(run_id)}/export", params={"format": format}).content

    def events(self, run_id: str | None = None, limit: int | None = None) -> list[Record]:
        """Events of a run, or the latest of all."""
        address = f"{_API}/events" if run_id is None else f"{_API}/runs/{part(run_id)}/events"
        return self._connection.get(address, limit=limit)["events"]

    # --- models, comparisons, campaigns --------------------------------------------------------------------

    def fit(
        self,
        name: str,
        train: Sequence[str],
        capacity_Ah: float,
        *,
        validate: Sequence[str] = (),
        structure: str = "full",
        seed: int = 0,
        on_progress: Callable[[Record], None] | None = None,
        timeout_s: float | None = None,
    ) -> Record:
        """Fit a model to runs, wait for it, and give the model's record."""
        body = {
            "name": name,
            "train": list(train),
            "validate": list(validate),
            "capacity_Ah": float(capacity_Ah),
            "structure": structure,
            "seed": seed,
        }
        job = self.wait_job(self._connection.post(f"{_API}/models", body)["id"], on_progress, timeout_s=timeout_s)
        return self.model(job["result"]["model_id"])

    def wait_job(
        self, job_id: str, on_progress: Callable[[Record], None] | None = None, *, timeout_s: float | None = None
    ) -> Record:
        """Wait for a job and give its record; raises `ClientError` with the job's own words if it failed."""

        def look() -> Record:
            job = self._connection.get(f"{_API}/jobs/{part(job_id)}")
            if on_progress is not None:
                on_progress(job)
            return job

        job = wait_until(look, lambda job: job["state"] in ("done", "failed"), f"job {job_id}", timeout_s, 0.2)
        if job["state"] == "failed":
            raise ClientError(job["error"], code="job_failed")
        return job

    def models(self) -> list[Record]:
        """All models, without their documents."""
        return self._connection.get(f"{_API}/models")["models"]

    def model(self, model_id: str) -> Record:
        """One model with its metrics."""
        return self._connection.get(f"{_API}/models/{part(model_id)}")

    def model_document(self, model_id: str) -> Record:
        """The model itself, as MODEL.json."""
        return self._connection.get(f"{_API}/models/{part(model_id)}/document")

    def model_tables(self, model_id: str) -> Record:
        """Open-circuit voltage, resistance and step responses with bands, heat, and what the model does not know."""
        return self._connection.get(f"{_API}/models/{part(model_id)}/tables")

    def import_model(self, document: Record) -> Record:
        """Store a MODEL.json; give its record."""
        return self._connection.post(f"{_API}/models/import", document)

    def design(
        self,
        name: str,
        request: Record,
        *,
        on_progress: Callable[[Record], None] | None = None,
        timeout_s: float | None = None,
    ) -> Record:
        """Design a profile, wait for it, and give ``{"profile_id", "name", "figures"}``.

        The keys of `request` are those of a REQUEST file, with the ids of a stored model, profile (as load cycle) and
        runs in place of files.
        """
        job = self._connection.post(f"{_API}/designs", {"name": name, "request": request})
        return self.wait_job(job["id"], on_progress, timeout_s=timeout_s)["result"]

    def compare(self, model_id: str, run_ids: Sequence[str], initial_soc: float | None = None) -> Record:
        """Compare a model with runs."""
        body = {"model_id": model_id, "run_ids": list(run_ids), "initial_soc": initial_soc}
        return self._connection.post(f"{_API}/comparisons", body)

    def comparison(self, comparison_id: str) -> Record:
        """One comparison."""
        return self._connection.get(f"{_API}/comparisons/{part(comparison_id)}")

    def comparison_series(self, comparison_id: str, max_points: int | None = None) -> list[Record]:
        """Curves behind a comparison: of each run time, measured and modelled voltage, residual; None is missing."""
        address = f"{_API}/comparisons/{part(comparison_id)}/series"
        return self._connection.get(address, max_points=max_points)["runs"]

    def comparison_where(self, comparison_id: str) -> Record:
        """Where the model of a comparison is off: regions in words, maps, profiles."""
        return self._connection.get(f"{_API}/comparisons/{part(comparison_id)}/where")

    def effects(self) -> list[Record]:
        """Every effect that a diagnosis knows."""
        return self._connection.get(f"{_API}/effects")["effects"]

    def diagnose(
        self,
        model_id: str,
        run_ids: Sequence[str],
        *,
        mode: str = "structure",
        train_run_ids: Sequence[str] | None = None,
        initial_soc: float | None = None,
        on_progress: Callable[[Record], None] | None = None,
        timeout_s: float | None = None,
    ) -> Record:
        """Diagnose runs with a model, wait for it, and give the record; without `train_run_ids` the model's own."""
        body = {"model_id": model_id, "run_ids": list(run_ids), "mode": mode, "initial_soc": initial_soc}
        body["train_run_ids"] = None if train_run_ids is None else list(train_run_ids)
        job = self.wait_job(self._connection.post(f"{_API}/diagnoses", body)["id"], on_progress, timeout_s=timeout_s)
        return self._connection.get(f"{_API}/diagnoses/{part(job['result']['diagnosis_id'])}")

    def add_effect(
        self,
        model_id: str,
        effect: str,
        *,
        train_run_ids: Sequence[str] | None = None,
        validate_run_ids: Sequence[str] | None = None,
        on_progress: Callable[[Record], None] | None = None,
        timeout_s: float | None = None,
    ) -> Record:
        """Add an effect to a model, wait for the refit, and give ``{"model", "parent", "error_before_mV", ...}``."""
        named = {"train_run_ids": train_run_ids, "validate_run_ids": validate_run_ids}
        body = {"effect": effect} | {key: list(value) for key, value in named.items() if value is not None}
        job = self._connection.post(f"{_API}/models/{part(model_id)}/effects", body)
        return self.wait_job(job["id"], on_progress, timeout_s=timeout_s)["result"]

    def refit(
        self,
        model_id: str,
        train_run_ids: Sequence[str],
        *,
        validate_run_ids: Sequence[str] | None = None,
        on_progress: Callable[[Record], None] | None = None,
        timeout_s: float | None = None,
    ) -> Record:
        """Fit a model's parameters again to new runs; give ``{"model", "parent", "error_before_mV", ...}``."""
        body: Record = {"train_run_ids": list(train_run_ids)}
        body |= {} if validate_run_ids is None else {"validate_run_ids": list(validate_run_ids)}
        job = self._connection.post(f"{_API}/models/{part(model_id)}/refit", body)
        return self.wait_job(job["id"], on_progress, timeout_s=timeout_s)["result"]

    def model_chain(self, model_id: str) -> Record:
        """Versions from the first to this one, everything tried beside them, and the held-out error of each."""
        return self._connection.get(f"{_API}/models/{part(model_id)}/chain")

    def start_campaign(self, request: Record) -> Record:
        """Start a campaign; give its record."""
        return self._connection.post(f"{_API}/campaigns", request)

    def campaigns(self) -> list[Record]:
        """All campaigns."""
        return self._connection.get(f"{_API}/campaigns")["campaigns"]

    def campaign(self, campaign_id: str) -> Record:
        """One campaign."""
        return self._connection.get(f"{_API}/campaigns/{part(campaign_id)}")

    def stop_campaign(self, campaign_id: str) -> Record:
        """Stop a campaign and the run that it has started."""
        return self._connection.post(f"{_API}/campaigns/{part(campaign_id)}/stop")

    def wait_campaign(
        self,
        campaign_id: str,
        on_progress: Callable[[Record], None] | None = None,
        *,
        timeout_s: float | None = None,
        poll_s: float = 0.2,
    ) -> Record:
        """Wait until a campaign has ended and give its record, whatever its end."""

        def look() -> Record:
            campaign = self.campaign(campaign_id)
            if on_progress is not None:
                on_progress(campaign)
            return campaign

        what = f"campaign {campaign_id}"
        return wait_until(look, lambda found: found["state"] in ENDED_CAMPAIGN_STATES, what, timeout_s, poll_s)
