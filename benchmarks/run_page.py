"""A long run in its page: how long it takes until it is drawn, from its first opening to each zoom.

``python benchmarks/run_page.py [--rows 1000000] [--openings 5] [--zooms 10] [--json]``

Stores a run of pulses as the recorder does, serves it, and opens its page in Chromium. An opening is the first after
the service has started: nothing of the run is in memory. A zoom shows ten minutes at a random place; each must draw the
edges of the pulse where they were stored. Milliseconds are the page's own: from its question until everything is drawn.
Ends with 1 where an edge was drawn elsewhere.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Page, sync_playwright

from bench_service.store.metadata import MetadataStore
from bench_service.store.records import RunIntent
from bench_service.store.sample_writer import Rows, SampleWriter
from bench_service.streams import SAMPLES, STREAMS, Columns

DT_S, EVERY_S, PULSE_S = 0.1, 600.0, (200.0, 300.0)
_BATCH = 1000
_PATIENCE_MS = 120_000
_LIMITS = {"voltage_V": [2.5, 4.2], "current_A": [-10.0, 10.0], "temperature_degC": [0.0, 60.0], "soc": [0, 1]}
_EDGES = """() => {
  const all = echarts.getInstanceByDom(document.querySelector('.run-plot')).getOption().series;
  const points = all.find((each) => each.name === 'Current').data;
  return points.slice(1).filter((point, k) => Math.abs(point[1] - points[k][1]) > 1).map((point) => point[0]);
}"""


def main() -> int:
    """Store, serve, open, zoom, and show the times."""
    arguments = _arguments()
    with tempfile.TemporaryDirectory() as scratch:
        run_id = store(Path(scratch), arguments.rows)
        opened_ms, zooms_ms, wrong = [], [], 0
        for opening in range(arguments.openings):
            with served(Path(scratch)) as address, a_page() as page:
                opened_ms.append(opened(page, f"{address}/runs/{run_id}"))
                if opening == 0:
                    zooms_ms, wrong = zoomed(page, arguments.rows * DT_S, arguments.zooms)
    found = {"rows": arguments.rows, "openings_ms": opened_ms, "zooms_ms": zooms_ms, "edges_elsewhere": wrong,
             "load": os.getloadavg()[0]}  # fmt: skip
    print(json.dumps(found) if arguments.json else _words(found))
    return int(wrong > 0)


def store(data_dir: Path, n: int) -> str:
    """Store a completed run of `n` samples in batches; give its id."""
    columns = pulses(n)
    with closing(MetadataStore.open(data_dir)) as records, closing(SampleWriter.open(data_dir)) as writer:
        profile = records.profiles.add("pulses", np.array([0.0, 200.0, 300.0, 600.0]), np.array([0.0, 5.0, 0.0, 0.0]))
        run = records.runs.add(
            RunIntent(
                bench="sim",
                profile_id=profile.id,
                dt_s=DT_S,
                initial_soc=0.5,
                capacity_Ah=2.5,
                limits=_LIMITS,
                code_version="1",
                name="pulses",
            )  # fmt: skip
        )
        records.runs.start(run.id)
        for first in range(0, n, _BATCH):
            part = {name: values[first : first + _BATCH] for name, values in columns.items()}
            writer.commit([Rows(run.id, SAMPLES, first, STREAMS[SAMPLES], part)])
            writer.seal_due()
        closed = writer.close_run(run.id, "completed", None)
        records.runs.end(run.id, "completed", None, n_samples=n, missed_ticks=0, sha256=closed.sha256)
    return run.id


def pulses(n: int) -> Columns:
    """Every ten minutes 5 A for 100 s, into the cell and out of it in turn; noise on voltage and temperature."""
    random = np.random.default_rng(1)
    time_s = np.arange(n) * DT_S
    phase_s = time_s % EVERY_S
    way = np.where(time_s // EVERY_S % 2 < 1, 5.0, -5.0)
    current_A = np.where((phase_s >= PULSE_S[0]) & (phase_s < PULSE_S[1]), way, 0.0)
    charge_Ah = np.cumsum(current_A) * DT_S / 3600.0
    columns = {column.name: np.zeros(n, column.numpy) for column in STREAMS[SAMPLES]}
    return columns | {
        "time_s": time_s,
        "current_A": current_A,
        "setpoint_A": current_A,
        "voltage_V": 3.6 + 0.5 * charge_Ah + 0.02 * current_A + 1e-3 * random.standard_normal(n),
        "temperature_degC": 25.0 + 0.1 * random.standard_normal(n),
    }


@contextmanager
def served(data_dir: Path) -> Iterator[str]:
    """Give the address of a service on the folder."""
    command = [sys.executable, "-m", "bench_service.cli", "serve", "--port", "0", "--json"]
    environment = os.environ | {"BENCH_DATA_DIR": str(data_dir)}
    process = subprocess.Popen(command, cwd=data_dir, env=environment, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield json.loads(process.stdout.readline())["address"]
    finally:
        process.terminate()
        process.wait()
        process.stdout.close()


@contextmanager
def a_page() -> Iterator[Page]:
    """Give an empty page of Chromium."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.set_default_timeout(_PATIENCE_MS)
        yield page
        browser.close()


def opened(page: Page, address: str) -> int:
    """Open the run; give the milliseconds until it was drawn."""
    page.goto(address)
    return _drawn_ms(page)


def zoomed(page: Page, end_s: float, times: int) -> tuple[list[int], int]:
    """Zoom to ten minutes here and there; give the milliseconds of each, and in how many an edge was elsewhere."""
    took_ms, wrong = [], 0
    # From left to right, so that the end can always be moved before the start.
    for start_s in np.sort(np.random.default_rng(2).uniform(0.0, end_s - EVERY_S, times).round(1)):
        ends_s = {"to": start_s + EVERY_S, "from": start_s}
        took_ms.append([_moved_ms(page, f"#view-{end}", at_s) for end, at_s in ends_s.items()][-1])
        wrong += not _edges_stand(page.evaluate(_EDGES), start_s)
    return took_ms, wrong


def _edges_stand(drawn_s: list[float], start_s: float) -> bool:
    """Whether each edge within the ten minutes is drawn where it was stored."""
    first = int(start_s // EVERY_S)
    stored_s = [EVERY_S * k + edge_s for k in (first, first + 1) for edge_s in PULSE_S]
    shown_s = [edge_s for edge_s in stored_s if start_s < edge_s < start_s + EVERY_S]
    return all(any(abs(edge_s - found_s) <= DT_S for found_s in drawn_s) for edge_s in shown_s)


def _moved_ms(page: Page, field: str, at_s: float) -> int:
    page.evaluate("delete document.body.dataset.loadMs")
    page.locator(field).fill(str(at_s))
    page.locator(field).press("Enter")
    return _drawn_ms(page)


def _drawn_ms(page: Page) -> int:
    page.wait_for_function("() => document.querySelector('.run-plot canvas') && document.body.dataset.loadMs")
    return int(page.evaluate("document.body.dataset.loadMs"))


def _words(found: dict[str, Any]) -> str:
    spans = {name: found[f"{name}_ms"] for name in ("openings", "zooms")}
    told = [f"{name}: median {np.median(ms):.0f} ms, longest {max(ms)} ms" for name, ms in spans.items() if ms]
    edges = f"edges drawn elsewhere: {found['edges_elsewhere']} of {len(spans['zooms'])} zooms"
    return "\n".join([f"{found['rows']} samples, load {found['load']:.1f}", *told, edges])


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--openings", type=int, default=5)
    parser.add_argument("--zooms", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
