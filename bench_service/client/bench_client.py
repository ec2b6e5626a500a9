"""The client: one method for each thing that the REST API offers."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, Unpack

from bench_service.client.campaign_calls import CampaignCalls
from bench_service.client.cell_calls import CellCalls
from bench_service.client.connection import API, Connection, Record, part
from bench_service.client.import_calls import ImportCalls
from bench_service.client.list_calls import ListCalls
from bench_service.client.model_calls import ModelCalls
from bench_service.client.protocol_calls import ProtocolCalls
from bench_service.client.result_calls import ResultCalls
from bench_service.client.run_options import RunOptions
from bench_service.client.stop_ports import StopPorts
from bench_service.client.waiting import ENDED_RUN_STATES, LOOK_S, Look, wait_until

COMMISSION_TIMEOUT_S = 180.0  # proofs take 15 s, on a slow serial line more


class BenchClient:
    """Talks to one service; to be closed, or used in a ``with`` statement.

    Parameters
    ----------
    url : str
        Address that the service printed, for example ``http://127.0.0.1:8000``.
    timeout_s : float
        Longest wait for one answer.
    token : str, optional
        Of a service that listens beyond its own machine; by default what ``BENCH_TOKEN`` says.
    """

    def __init__(self, url: str, timeout_s: float = 30.0, *, token: str | None = None) -> None:
        self.url = url.rstrip("/")
        self._connection = Connection(self.url, timeout_s, token or os.environ.get("BENCH_TOKEN"))
        self._stop_ports = StopPorts(self.url, self._connection)
        # One flat list of calls for whoever writes a script; these are in files of their own.
        self._take_models()
        self._take_others()

    def _take_models(self) -> None:
        models = ModelCalls(self._connection)
        self.fit = models.fit
        self.wait_job = models.wait_job
        self.models = models.models
        self.model = models.model
        self.model_document = models.model_document
        self.model_tables = models.model_tables
        self.import_model = models.import_model
        self.design = models.design
        self.compare = models.compare
        self.observe = models.observe
        self.comparison = models.comparison
        self.comparison_series = models.comparison_series
        self.comparison_table = models.comparison_table
        self.comparison_where = models.comparison_where
        self.effects = models.effects
        self.diagnose = models.diagnose
        self.trend = models.trend
        self.add_effect = models.add_effect
        self.refit = models.refit
        self.learn = models.learn
        self.model_chain = models.model_chain
        results = ResultCalls(self._connection)
        self.comparisons = results.comparisons
        self.diagnoses = results.diagnoses
        self.diagnosis = results.diagnosis
        self.design_experiment = results.design_experiment
        self.trend_table = results.trend_table
        self.run_report = results.run_report
        self.campaign_report = results.campaign_report
        self.comparison_report = results.comparison_report
        self.diagnosis_report = results.diagnosis_report
        self.trend_report = results.trend_report
        self.design_report = results.design_report
        self.job = results.job
        self.cancel_job = results.cancel_job
        self.formats = results.formats

    def _take_others(self) -> None:
        imports = ImportCalls(self._connection)
        self.get_import = imports.get_import
        self.upload_file = imports.upload_file
        self.look_at_import = imports.look_at_import
        self.store_import = imports.store_import
        self.drop_import = imports.drop_import
        self.mappings = imports.mappings
        self.save_mapping = imports.save_mapping
        campaigns = CampaignCalls(self._connection)
        self.start_campaign = campaigns.start_campaign
        self.campaigns = campaigns.campaigns
        self.campaign = campaigns.campaign
        self.stop_campaign = campaigns.stop_campaign
        self.estimate_campaign = campaigns.estimate_campaign
        self.queue = campaigns.queue
        self.start_queue = campaigns.start_queue
        self.resume_campaign = campaigns.resume_campaign
        self.wait_campaign = campaigns.wait_campaign
        lists = ListCalls(self._connection)
        self.every = lists.every
        self.cells = lists.cells
        self.runs = lists.runs
        self.events = lists.events
        cells = CellCalls(self._connection)
        self.add_cell = cells.add_cell
        self.cell = cells.cell
        self.change_cell = cells.change_cell
        self.retire_cell = cells.retire_cell
        self.reuse_cell = cells.reuse_cell
        self.cell_events = cells.cell_events
        self.put_cell = cells.put_cell
        protocols = ProtocolCalls(self._connection)
        self.upload_protocol = protocols.upload_protocol
        self.add_standard_test = protocols.add_standard_test
        self.standard_tests = protocols.standard_tests
        self.preview_protocol = protocols.preview_protocol
        self.protocols = protocols.protocols
        self.protocol = protocols.protocol
        self.run_steps = protocols.run_steps
        self.run_cycles = protocols.run_cycles

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
        return self._connection.get(f"{API}/benches")["benches"]

    def bench(self, name: str) -> Record:
        """One bench: state, capabilities, limits, last live values."""
        return self._connection.get(f"{API}/benches/{part(name)}")

    def standing(self, name: str) -> Record:
        """State of charge at which the cell on a bench stands, and where that is known from."""
        return self._connection.get(f"{API}/benches/{part(name)}/standing")

    def stop_bench(self, name: str) -> Record:
        """Stop the bench's run, if there is one; past the service where this client has started one there."""
        return self._stop_ports.stop(name) or self._connection.post(f"{API}/benches/{part(name)}/stop")

    def pause_bench(self, name: str) -> Record:
        """Hold the bench's run: output off, the profile waits."""
        return self._connection.post(f"{API}/benches/{part(name)}/pause")

    def resume_bench(self, name: str) -> Record:
        """Let the bench's run go on."""
        return self._connection.post(f"{API}/benches/{part(name)}/resume")

    def skip_step(self, name: str) -> Record:
        """End the step of the protocol on a bench, and go on to the next."""
        return self._connection.post(f"{API}/benches/{part(name)}/skip")

    def open_seal(self, name: str) -> Record:
        """Tell which effect is hidden in a bench's simulated cell: ``{"sha256", "opened"}``."""
        return self._connection.post(f"{API}/benches/{part(name)}/seal/open")

    def acknowledge(self, name: str) -> Record:
        """Clear a latched fault."""
        return self._connection.post(f"{API}/benches/{part(name)}/acknowledge")

    def commissioning(self, name: str) -> Record:
        """Whether the bench's hardware is commissioned, why not, and the newest record."""
        return self._connection.get(f"{API}/benches/{part(name)}/commissioning")

    def commission(
        self, name: str, *, confirm: bool = False, current_A: float | None = None, resistor_Ohm: float | None = None
    ) -> Record:
        """Look at the bench's device; with ``confirm`` prove what it does, with small currents, and keep the record."""
        body = {"confirm": confirm, "current_A": current_A, "resistor_Ohm": resistor_Ohm}
        address = f"{API}/benches/{part(name)}/commission"
        return self._connection.send("POST", address, json=body, timeout=COMMISSION_TIMEOUT_S).json()

    # --- profiles and runs ---------------------------------------------------------------------------------

    def upload_profile(self, name: str, time_s: Sequence[float], current_A: Sequence[float]) -> Record:
        """Store a profile (forward hold, positive current charges); give its record."""
        body = {"name": name, "time_s": [float(t) for t in time_s], "current_A": [float(i) for i in current_A]}
        return self._connection.post(f"{API}/profiles", body)

    def profiles(self) -> list[Record]:
        """All profiles."""
        return self._connection.get(f"{API}/profiles")["profiles"]

    def profile(self, profile_id: str, points: bool = False) -> Record:
        """One profile; ``points`` adds ``time_s`` and ``current_A``."""
        return self._connection.get(f"{API}/profiles/{part(profile_id)}", points=points)

    def start_run(
        self, bench: str, profile_id: str | None, dt_s: float, initial_soc: float, **options: Unpack[RunOptions]
    ) -> Record:
        """Start a run of a profile; give its record, with state ``running``. Options are those of `RunOptions`.

        With ``protocol_id`` among them `profile_id` is None.
        """
        stated = {"bench": bench, "dt_s": float(dt_s), "initial_soc": float(initial_soc)}
        stated["profile_id"] = profile_id
        given = {key: value for key, value in options.items() if value is not None}
        run = self._connection.post(f"{API}/runs", stated | given)
        self._stop_ports.learn(bench)
        return run

    def run(self, run_id: str) -> Record:
        """One run."""
        return self._connection.get(f"{API}/runs/{part(run_id)}")

    def stop_run(self, run_id: str) -> Record:
        """Stop a run; its end is waited for with `wait_run`."""
        return self._connection.post(f"{API}/runs/{part(run_id)}/stop")

    def wait_run(
        self,
        run_id: str,
        on_progress: Callable[[Record, Record | None], None] | None = None,
        *,
        timeout_s: float | None = None,
        poll_s: float = LOOK_S,
    ) -> Record:
        """Wait until a run has ended and give its record; after `timeout_s` `ClientError`, and the run goes on.

        `on_progress` is called with the run's record and the bench's live values at each look.
        """

        def tell(run: Record) -> None:
            if on_progress is not None:
                live = self.bench(run["bench"])["live"] if run["state"] not in ENDED_RUN_STATES else None
                on_progress(run, live if live and live["run_id"] == run_id else None)

        look = Look(f"run {run_id}", lambda: self.run(run_id), ENDED_RUN_STATES, tell)
        return wait_until(look, timeout_s, poll_s)

    def samples(
        self,
        run_id: str,
        *,
        stream: str = "samples",
        from_s: float | None = None,
        to_s: float | None = None,
        after_seq: int | None = None,
        points: int | None = None,
        max_points: int | None = None,
        columns: Sequence[str] | None = None,
        damaged: str | None = None,
    ) -> Record:
        """Columns of a run's samples, or with ``stream="observer"`` of its observer; None is a missing value.

        With `points` (`max_points` is its older name) at most so many rows, extremes and steps kept; `after_seq` gives
        what is new since that row. A damaged run is refused, unless ``damaged="include"`` asks for what is left.
        """
        address = f"{API}/runs/{part(run_id)}/{part(stream)}"
        rows = {"from_s": from_s, "to_s": to_s, "after_seq": after_seq, "points": points or max_points}
        names = None if columns is None else ",".join(columns)
        return self._connection.get(address, **rows, columns=names, damaged=damaged)

    def incremental(self, run_id: str, *, from_s: float | None = None, to_s: float | None = None) -> Record:
        """dQ/dV and dV/dQ of a run or a part of it, ``charge`` and ``discharge`` apart."""
        return self._connection.get(f"{API}/runs/{part(run_id)}/incremental", from_s=from_s, to_s=to_s)

    def describe_run(self, run_id: str, **told: str | None) -> Record:
        """Write `label`, `operator`, `notes` or `cell_id` of a run; None takes it away. A change is an event."""
        return self._connection.send("PATCH", f"{API}/runs/{part(run_id)}", json=told).json()

    def export(self, run_id: str, format: str = "bdf") -> bytes:  # noqa: A002  # the option's public name
        """Give the run as the bytes of a file."""
        return self._connection.send("GET", f"{API}/runs/{part(run_id)}/export", params={"format": format}).content

    def export_named(self, run_id: str, format: str = "bdf") -> tuple[str, bytes]:  # noqa: A002
        """Give the run as a file: its name, as Institution__Cell__YYYYMMDD_XXX where it is of a cell, and its bytes."""
        answer = self._connection.send("GET", f"{API}/runs/{part(run_id)}/export", params={"format": format})
        return answer.headers["content-disposition"].partition('filename="')[2].rstrip('"'), answer.content

    def metadata(self, run_id: str) -> Record:
        """What belongs beside the run's file of the Battery Data Format, as `x.bdf.metadata.json`."""
        return self._connection.get(f"{API}/runs/{part(run_id)}/metadata")
