"""What workers do for a diagnosis: plain data in and out, progress on the way, runs in their places."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench_service.jobs import diagnosing, refitting
from bench_service.jobs.series import RunInput
from models.comparison import compare
from models.network.local_model_network import LocalModelNetwork
from models.pipeline.fit import fit_network
from simulators.catalogue import CELLS
from simulators.cell import Cell
from tests.unit.models.simulated_cells import pulses_A, record

SOC = 0.6
CELL = CELLS["nmc"].parameters
RUNS = {"learned": 1, "judged": 2}
LEARNED, JUDGED = RunInput("learned", SOC), RunInput("judged", SOC)


@cache
def series(name: str) -> Any:
    current = pulses_A(2500, CELL.capacity_Ah, RUNS[name], rest=200)
    return replace(record(Cell(CELL, SOC, 22.0), current, RUNS[name]), name=name)


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    fitted = fit_network([series("learned")], capacity_Ah=CELL.capacity_Ah, structure="minimal", initial_soc=[SOC])
    return json.loads(json.dumps(fitted.network.to_json()))


@pytest.fixture(autouse=True)
def stored(monkeypatch: pytest.MonkeyPatch) -> None:
    for jobs in (diagnosing, refitting):
        monkeypatch.setattr(jobs, "read_series", lambda directory, runs: [series(run.run_id) for run in runs])


class Reports:
    """Takes reports, which must never go back."""

    def __init__(self) -> None:
        self.shares = [0.0]
        self.texts: list[str] = []

    def __call__(self, share: float, text: str = "") -> None:
        assert 0.0 <= share <= 1.0
        self.shares.append(share)
        self.texts.append(text)


def test_a_diagnosis_is_plain_json(document: dict[str, Any]) -> None:
    found = diagnosing.diagnose_runs(Reports(), Path(), document, [JUDGED], [LEARNED], "structure")  # pyright: ignore[reportArgumentType]
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["mode"] == "structure" and found["verdict"]
    alone = diagnosing.diagnose_runs(Reports(), Path(), document, [JUDGED], [], "change")  # pyright: ignore[reportArgumentType]
    assert alone["mode"] == "change"


def test_an_effect_is_added_with_its_figures(document: dict[str, Any]) -> None:
    reports = Reports()
    found = diagnosing.add_effect_to(reports, Path(), document, "relaxation", [LEARNED], [JUDGED])  # pyright: ignore[reportArgumentType]
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    network = LocalModelNetwork.from_json(found["document"])
    assert len(network.structure.inputs) > len(document["structure"]["inputs"])
    assert found["structure"] == network.structure.name and found["capacity_Ah"] == CELL.capacity_Ah
    metrics = found["metrics"]
    assert metrics["effect"] == "relaxation" and metrics["parameters"]["time_constant_s"]["unit"] == "s"
    assert 0.3 < metrics["noise_floor_mV"] < 3.0  # the simulated sensor has 1 mV
    assert metrics["error_before_mV"] > 0 and metrics["error_after_mV"] > 0
    # Apart by the trained ranges; the parts of the parent's error are those of a comparison with it.
    compared = compare(LocalModelNetwork.from_json(document), [series("judged")], [SOC])
    for part, figures in (("inside", compared["inside_training"]), ("outside", compared["outside"])):
        assert metrics[part]["before_mV"] == (None if figures is None else pytest.approx(figures["rmse_mV"]))
        assert (metrics[part]["after_mV"] is None) == (figures is None)
    assert max(reports.shares) > 0.9 and "relaxation" in " ".join(reports.texts)


def test_an_error_is_mapped(document: dict[str, Any]) -> None:
    found = diagnosing.map_errors(Reports(), Path(), document, [JUDGED, LEARNED])  # pyright: ignore[reportArgumentType]
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["maps"] and 0.0 <= found["outside_training"] < 1.0


@pytest.mark.proof
def test_an_experiment_between_two_effects_keeps_its_limits(document: dict[str, Any]) -> None:
    request = {
        "capacity_Ah": CELL.capacity_Ah,
        "duration_s": 300.0,
        "dt_s": document["structure"]["dt_s"],
        "criterion": "discriminate",
        "limits": {"current_A": [-3.0, 2.0], "soc": [0.4, 0.8]},
        "rivals": ["relaxation", "hysteresis"],
        "initial_soc": SOC,
        "seed": 0,
    }
    reports = Reports()
    found = diagnosing.design_between(reports, Path(), document, request, [LEARNED], [JUDGED])  # pyright: ignore[reportArgumentType]
    time_s, current_A = np.array(found["time_s"]), np.array(found["current_A"])
    assert time_s[-1] - time_s[0] == pytest.approx(300.0, abs=1.0)
    assert current_A.min() >= -3.0 - 1e-9 and current_A.max() <= 2.0 + 1e-9 and np.ptp(current_A) > 1.0
    soc = SOC + np.concatenate([[0.0], np.cumsum(current_A[:-1] * np.diff(time_s))]) / 3600.0 / CELL.capacity_Ah
    assert 0.4 - 1e-6 <= soc.min() and soc.max() <= 0.8 + 1e-6
    assert min(found["figures"]["separation"]) > 0.0
    assert any("hysteresis" in text for text in reports.texts)


def test_a_refit_keeps_the_structure_and_carries_what_a_model_carries(document: dict[str, Any]) -> None:
    found = refitting.refit_to(Reports(), Path(), document, [JUDGED], [LEARNED])  # pyright: ignore[reportArgumentType]
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    network = LocalModelNetwork.from_json(found["document"])
    assert network.structure == LocalModelNetwork.from_json(document).structure
    assert found["metrics"]["effect"] is None and found["metrics"]["error_after_mV"] > 0
    assert found["metrics"]["inside"]["after_mV"] > 0
    assert {"tables", "sums", "observer", "version"} <= set(network.to_json()["record"])
    assert network.record.sums["n_samples"] > document["record"]["sums"]["n_samples"]
