"""What the REST API offers about models: fits, designs, comparisons, diagnoses, and the jobs that they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Unpack

from bench_service.client.connection import API, ClientError, Connection, Record, part
from bench_service.client.waiting import ENDED_JOB_STATES, LOOK_S, Look, Patience, wait_until


class ModelCalls:
    """Part of a `BenchClient`.

    Parameters
    ----------
    connection : Connection
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def fit(
        self,
        name: str,
        train: Sequence[str],
        capacity_Ah: float,
        *,
        validate: Sequence[str] = (),
        structure: str = "auto",
        without: Sequence[str] = (),
        initial_soc_std: float = 0.0,
        coulombic_efficiency: float = 1.0,
        seed: int = 0,
        module: Record | None = None,
        **patience: Unpack[Patience],
    ) -> Record:
        """Fit a model to runs, wait for it, and give the model's record.

        `initial_soc_std`: how far off the states of charge may be at which the training runs are said to begin; they
        are then estimated with the fit. `without`: effects that are left out of a bounded network. `module`: the runs
        are of a module: ``in_series``, ``parallel``, and ``cell_model_id`` of a cell's model, each where it is known.
        """
        body = {"name": name, "train": list(train), "validate": list(validate)}
        body |= {"capacity_Ah": float(capacity_Ah), "structure": structure, "without": list(without), "seed": seed}
        body |= {"initial_soc_std": float(initial_soc_std), "coulombic_efficiency": float(coulombic_efficiency)}
        body |= {"module": module}
        return self.model(self._worked("models", body, patience)["model_id"])

    def wait_job(
        self, job_id: str, on_progress: Callable[[Record], None] | None = None, *, timeout_s: float | None = None
    ) -> Record:
        """Wait for a job and give its record; raises `ClientError` with the job's own words if it failed."""
        address = f"{API}/jobs/{part(job_id)}"
        look = Look(f"job {job_id}", lambda: self._connection.get(address), ENDED_JOB_STATES, on_progress)
        job = wait_until(look, timeout_s, LOOK_S)
        if job["state"] == "failed":
            raise ClientError(job["error"], code="job_failed")
        return job

    def _worked(self, address: str, body: Record, patience: Patience) -> Record:
        """Have a job done, wait for it, and give its result."""
        job = self._connection.post(f"{API}/{address}", body)
        return self.wait_job(job["id"], **patience)["result"]

    def models(self) -> list[Record]:
        """All models, without their documents."""
        return self._connection.get(f"{API}/models")["models"]

    def model(self, model_id: str) -> Record:
        """One model with its metrics."""
        return self._connection.get(f"{API}/models/{part(model_id)}")

    def model_document(self, model_id: str) -> Record:
        """The model itself, as MODEL.json."""
        return self._connection.get(f"{API}/models/{part(model_id)}/document")

    def model_tables(self, model_id: str) -> Record:
        """Open-circuit voltage, resistance and step responses with bands, heat, and what the model does not know."""
        return self._connection.get(f"{API}/models/{part(model_id)}/tables")

    def import_model(self, document: Record) -> Record:
        """Store a MODEL.json; give its record."""
        return self._connection.post(f"{API}/models/import", document, at_work=True)

    def design(self, name: str, request: Record, **patience: Unpack[Patience]) -> Record:
        """Design a profile, wait for it, and give ``{"profile_id", "name", "figures"}``.

        The keys of `request` are those of a REQUEST file, with the ids of a stored model, profile (as load cycle) and
        runs in place of files.
        """
        return self._worked("designs", {"name": name, "request": request}, patience)

    def learn(
        self, model_id: str, run_ids: Sequence[str], validate: Sequence[str] = (), **patience: Unpack[Patience]
    ) -> Record:
        """Let a model learn from runs in time's order, wait for it, and give the new versions' figures.

        ``model`` of the result is the last version; every run of `validate` judges each of them.
        """
        body = {"run_ids": list(run_ids), "validate_run_ids": list(validate)}
        return self._worked(f"models/{part(model_id)}/learn", body, patience)

    def compare(
        self,
        model_id: str,
        run_ids: Sequence[str],
        initial_soc: float | None = None,
        *,
        baselines: Sequence[str] = (),
        train_run_ids: Sequence[str] | None = None,
    ) -> Record:
        """Compare a model with runs; with `baselines` ("1rc", "2rc", "esc") these are judged beside it.

        They are fitted to `train_run_ids`, by default to the runs that the model was made from; ``baselines`` of the
        record's ``result`` has their figures.
        """
        body = {"model_id": model_id, "run_ids": list(run_ids), "initial_soc": initial_soc}
        named = {"baselines": baselines or None, "train_run_ids": train_run_ids}
        body |= {key: list(value) for key, value in named.items() if value is not None}
        return self._connection.post(f"{API}/comparisons", body, at_work=True)

    def observe(
        self,
        model_id: str,
        run_ids: Sequence[str],
        *,
        initial_soc: float | None = None,
        gain: str | None = None,
        **patience: Unpack[Patience],
    ) -> Record:
        """Replay runs through a model's observer, wait for it, and give what `observe --json` prints.

        `initial_soc`: where the observer begins; by default where each run is said to begin, from where the reference
        is counted. `gain`: "kalman" or "steady"; by default as the model has it.
        """
        body = {"model_id": model_id, "run_ids": list(run_ids), "initial_soc": initial_soc, "gain": gain}
        return self._worked("observations", body, patience)

    def comparison(self, comparison_id: str) -> Record:
        """One comparison."""
        return self._connection.get(f"{API}/comparisons/{part(comparison_id)}")

    def comparison_series(
        self,
        comparison_id: str,
        max_points: int | None = None,
        from_s: float | None = None,
        to_s: float | None = None,
    ) -> list[Record]:
        """Curves behind a comparison: of each run time, measured and modelled voltage, residual; None is missing."""
        address = f"{API}/comparisons/{part(comparison_id)}/series"
        return self._connection.get(address, points=max_points, from_s=from_s, to_s=to_s)["runs"]

    def comparison_table(self, comparison_id: str) -> bytes:
        """Every sample behind a comparison as the bytes of a CSV file: both voltages, band, inside or outside."""
        return self._connection.send("GET", f"{API}/comparisons/{part(comparison_id)}/series.csv").content

    def comparison_where(self, comparison_id: str) -> Record:
        """Where the model of a comparison is off: regions in words, maps, profiles."""
        return self._connection.get(f"{API}/comparisons/{part(comparison_id)}/where")

    def effects(self) -> list[Record]:
        """Every effect that a diagnosis knows."""
        return self._connection.get(f"{API}/effects")["effects"]

    def diagnose(
        self,
        model_id: str,
        run_ids: Sequence[str],
        *,
        mode: str = "structure",
        train_run_ids: Sequence[str] | None = None,
        initial_soc: float | None = None,
        **patience: Unpack[Patience],
    ) -> Record:
        """Diagnose runs with a model, wait for it, and give the record; without `train_run_ids` the model's own."""
        body = {"model_id": model_id, "run_ids": list(run_ids), "mode": mode, "initial_soc": initial_soc}
        body["train_run_ids"] = None if train_run_ids is None else list(train_run_ids)
        made = self._worked("diagnoses", body, patience)
        return self._connection.get(f"{API}/diagnoses/{part(made['diagnosis_id'])}")

    def trend(
        self,
        model_id: str,
        run_ids: Sequence[str] | None = None,
        *,
        cell_id: str | None = None,
        initial_soc: Sequence[float] | None = None,
        at: Sequence[float] | None = None,
        unit: str = "run",
        end: float = 0.8,
        **patience: Unpack[Patience],
    ) -> Record:
        """Follow a cell through runs in time's order, wait for it, and give the ``trend`` object.

        `initial_soc`: one for each run, a fraction of what the cell holds then. `at`: places along the life in `unit`.
        With `cell_id` in place of `run_ids` all that the cell has completed is followed.
        """
        body = {"model_id": model_id, "unit": unit, "end": float(end), "cell_id": cell_id}
        body |= {} if run_ids is None else {"run_ids": list(run_ids)}
        given = {"initial_soc": initial_soc, "at": at}
        body |= {name: [float(each) for each in values] for name, values in given.items() if values is not None}
        return self._worked("trends", body, patience)

    def add_effect(
        self,
        model_id: str,
        effect: str,
        *,
        train_run_ids: Sequence[str] | None = None,
        validate_run_ids: Sequence[str] | None = None,
        **patience: Unpack[Patience],
    ) -> Record:
        """Add an effect to a model, wait for the refit, and give ``{"model", "parent", "error_before_mV", ...}``."""
        named = {"train_run_ids": train_run_ids, "validate_run_ids": validate_run_ids}
        body = {"effect": effect} | {key: list(value) for key, value in named.items() if value is not None}
        return self._worked(f"models/{part(model_id)}/effects", body, patience)

    def refit(
        self,
        model_id: str,
        train_run_ids: Sequence[str],
        *,
        validate_run_ids: Sequence[str] | None = None,
        **patience: Unpack[Patience],
    ) -> Record:
        """Fit a model's parameters again to new runs; give ``{"model", "parent", "error_before_mV", ...}``."""
        body: Record = {"train_run_ids": list(train_run_ids)}
        body |= {} if validate_run_ids is None else {"validate_run_ids": list(validate_run_ids)}
        return self._worked(f"models/{part(model_id)}/refit", body, patience)

    def model_chain(self, model_id: str) -> Record:
        """Versions from the first to this one, everything tried beside them, and the held-out error of each."""
        return self._connection.get(f"{API}/models/{part(model_id)}/chain")
