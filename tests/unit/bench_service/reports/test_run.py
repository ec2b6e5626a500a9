"""The report of a run: what was decided, measured and noted; and what is missing is said."""

from typing import Any

import numpy as np

from bench_service.reports.document import Heading, render
from bench_service.reports.run import Measured, run_report
from bench_service.store.records import EventRecord
from tests.unit.bench_service.api.route_rig import MOMENT, run_record

N = 3601
LIMITS = {"voltage_V": [2.5, 4.2], "current_A": [-5.0, 5.0], "temperature_degC": None, "soc": [0.1, 0.9],
          "ramp_A_per_s": 2.0, "duration_s": 7200.0}  # fmt: skip


def columns() -> dict[str, np.ndarray]:
    flat = np.ones(N)
    return {"time_s": np.arange(float(N)), "current_A": flat, "voltage_V": 3.7 * flat, "temperature_degC": 25.0 * flat,
            "ambient_degC": np.full(N, np.nan)}  # fmt: skip


def page(measured: Measured, **changes: Any) -> str:
    run = run_record(n_samples=N, limits=LIMITS, **changes)
    return render(run_report(Heading("Run", "first <run>"), run, measured)).decode()


def test_what_was_moved_is_counted_and_what_was_noted_is_told() -> None:
    event = EventRecord(id=1, created_utc=MOMENT, severity="warning", code="x", text="the fan of 'rig_2' stopped",
                        bench="sim", run_id="r1", campaign_id=None)  # fmt: skip
    observer = {"time_s": np.arange(0.0, N), "soc": np.linspace(0.5, 0.9, N), "soc_std": np.full(N, 0.01)}
    measured = Measured(columns(), observer, events=[event])
    text = page(measured, notes="warm to the hand", commissioning={"state": "simulated"}, missed_ticks=2)
    for said in ("1.00 Ah", "3.70 Wh", "first &lt;run&gt;", "warm to the hand", "The bench was simulated.",
                 "2 samples were not taken in time", "&#39;rig_2&#39; stopped", "live observer", "2.50 to 4.20 V",
                 "10 to 90 %"):  # fmt: skip
        assert said in text, said
    assert text.count("<figure>") == 4 and "ambient" not in text


def test_cycles_are_drawn_and_told() -> None:
    cycle = {"cycle_count": 1, "duration_s": 3600.0, "charged_Ah": 1.0, "discharged_Ah": 0.99,
             "coulombic_efficiency": 0.99, "energy_efficiency": None, "begun_part_charged": False}  # fmt: skip
    text = page(Measured(columns(), cycles=[cycle, cycle | {"cycle_count": 2}]))
    assert "Charge of each cycle" in text and "99.00 %" in text


def test_a_run_without_samples_and_a_damaged_one_say_so() -> None:
    empty = page(Measured({}), state="fault", reason="voltage_V above 4.2 V")
    assert "No sample is stored." in empty and "Ended by a fault: voltage above 4.2 V." in empty
    assert "Stored samples are missing: 10 of 20." in page(Measured(columns(), damage="10 of 20"))


def test_a_run_from_a_file_was_held_to_nothing_that_is_known() -> None:
    text = page(Measured(columns()), bench="import")
    assert "limit " not in text and "Limits it was held to" not in text and "4.20" not in text
    assert "State of charge at the start, as stated" in text
