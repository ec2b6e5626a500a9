"""A run that was stored before the service starts: pulses of 100 s, a gap and a pause."""

from contextlib import closing
from pathlib import Path

import numpy as np

from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent
from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.streams import SAMPLES, STREAMS, Columns, Flag

N, DT_S, EVERY_S, PULSE_S = 60_000, 0.1, 600.0, (200.0, 300.0)
GAP_S, PAUSE_S = 1000.0, (1500.0, 1560.0)


def made() -> Columns:
    """Samples at 10 Hz over 100 minutes; each ten minutes 5 A for 100 s, into the cell and out of it in turn."""
    time_s = np.arange(N) * DT_S
    # Ticks were missed before this sample.
    time_s[time_s >= GAP_S] += 20.0
    phase_s = time_s % EVERY_S
    way = np.where(time_s // EVERY_S % 2 < 1, 5.0, -5.0)
    current_A = np.where((phase_s >= PULSE_S[0]) & (phase_s < PULSE_S[1]), way, 0.0)
    noise_V = 1e-3 * np.sin(np.arange(N) * 1.7)
    flags = np.zeros(N, "u4")
    flags[np.searchsorted(time_s, GAP_S)] = Flag.GAP_BEFORE
    flags[(time_s >= PAUSE_S[0]) & (time_s < PAUSE_S[1])] = Flag.PAUSED
    columns = {column.name: np.zeros(N, column.numpy) for column in STREAMS[SAMPLES]}
    charge_Ah = np.cumsum(current_A) * DT_S / 3600.0
    return columns | {
        "time_s": time_s,
        "current_A": current_A,
        "setpoint_A": current_A,
        "voltage_V": 3.6 + 0.5 * charge_Ah + 0.02 * current_A + noise_V,
        "temperature_degC": 25.0 + 0.1 * np.abs(current_A),
        "flags": flags,
    }


def store_run(data_dir: Path, name: str) -> str:
    """Store it as completed; give its id."""
    columns = made()
    with closing(MetadataStore.open(data_dir)) as store, closing(SampleWriter.open(data_dir)) as writer:
        profile = store.profiles.add("pulses", np.array([0.0, 200.0, 300.0, 600.0]), np.array([0.0, 1.0, 0.0, 0.0]))
        limits = {"voltage_V": [2.5, 4.2], "current_A": [-10.0, 10.0], "temperature_degC": [0.0, 60.0], "soc": [0, 1]}
        intent = RunIntent(bench="fast", profile_id=profile.id, dt_s=DT_S, initial_soc=0.5, capacity_Ah=2.5,
                           limits=limits, code_version="1", name=name)  # fmt: skip
        run = store.runs.add(intent)
        store.runs.start(run.id)
        writer.commit([Rows(run.id, SAMPLES, 0, STREAMS[SAMPLES], columns)])
        closed = writer.close_run(run.id, "completed", None)
        store.runs.end(run.id, "completed", None, n_samples=N, missed_ticks=200, sha256=closed.sha256)
        store.events.add("warning", "gap", "200 ticks were missed", bench="fast", run_id=run.id)
    return run.id
