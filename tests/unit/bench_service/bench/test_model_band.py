"""The band along a planned profile is that of the run that is measured then."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bench_service.bench.admission import RefusedError
from bench_service.bench.judging import PlausibilityJudge
from bench_service.bench.limits import Limits
from bench_service.bench.request import BandOrder, RunRequest
from bench_service.bench.run_setup import prepare
from bench_service.bench.safety import Context, Track
from bench_service.bench.settings import BenchSettings
from drivers.cycler import Capabilities, Reading
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.pipeline.fit import fit_network
from tests.unit.models import hand_network, synthetic

LIMITS = Limits((2.0, 4.5), (-20.0, 20.0), (-20.0, 80.0), (0.0, 1.0), None, 1e6)
SETTINGS = BenchSettings("b", "modbus-tcp://h:1", "generic", LIMITS, lock_step=True)
DEVICE = Capabilities("device", "1", (-30.0, 30.0), (0.0, 6.0), (0.1, 60.0), True, True, True, True)
N = 1500
AXES = (PartitionAxis("soc", initial=2, splittable=False, k_sigma=0.7),)
STRUCTURE = Structure(1, (InputChannel("soc", delay=1), InputChannel("current", order=2)), AXES, 1.0)


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    runs = [synthetic.run(1500, seed=s, noise_V=1e-3, drift_A=d) for s, d in ((2, -0.4), (3, 0.4))]
    return fit_network(runs, capacity_Ah=synthetic.CAPACITY_AH, structure=STRUCTURE).network.to_json()


def request(model: dict[str, Any], **changes: Any) -> tuple[RunRequest, Any]:
    """A run that was measured, and the request that would have played it."""
    measured = synthetic.run(N, seed=11, noise_V=1e-3)
    at_rest = {"temperature_degC": float(measured.temperature_degC[0]), "voltage_V": float(measured.voltage_V[0])}
    order = BandOrder(model=model, margin_V=0.02, for_s=5.0, **at_rest)
    current_A = np.append(measured.current_A[1:], 0.0)
    asked = RunRequest("r", 1.0, LIMITS, synthetic.CAPACITY_AH, measured.time_s, current_A, initial_soc=0.6, band=order)
    return replace(asked, **changes), measured


async def trips(asked: RunRequest, measured: Any, offset_V: float) -> tuple[str | None, list[str]]:
    """Codes of what a judge with that band says of the measured voltages with an offset."""
    prepared = await prepare(SETTINGS, DEVICE, asked)
    notes: list[str] = []
    judge = PlausibilityJudge(prepared.plan, lambda _severity, code, _text: notes.append(code))
    for k in range(N):
        values = (float(measured.voltage_V[k]) + offset_V, float(measured.current_A[k]), 20.0)
        reading = Reading(0.0, k, *values, 20.0, values[1], True, frozenset(), frozenset())
        context = Context(prepared.plan.rules, Track(sequence=k, time_s=float(k)), float(k), None, values[1])
        if (trip := judge.judge(reading, context)) is not None:
            return trip.code, notes
    return None, notes


async def test_a_run_as_the_model_expects_it_goes_through(document: dict[str, Any]) -> None:
    trip, notes = await trips(*request(document), offset_V=0.0)
    assert (trip, notes.count("model_band")) == (None, 0)


async def test_a_voltage_beside_it_is_warned_of_and_then_ends_the_run(document: dict[str, Any]) -> None:
    trip, notes = await trips(*request(document), offset_V=0.1)
    assert trip == "model_band" and notes.count("model_band") == 1


async def test_a_request_without_a_band_has_none(document: dict[str, Any]) -> None:
    asked, measured = request(document)
    assert (await trips(replace(asked, band=None), measured, offset_V=0.1))[0] is None


async def test_the_frame_carries_it(document: dict[str, Any]) -> None:
    asked, _ = request(document)
    header, body = asked.to_frame()
    assert RunRequest.from_frame(header, body).band == asked.band


async def test_what_cannot_be_computed_is_refused(document: dict[str, Any]) -> None:
    with pytest.raises(RefusedError, match="needs the state of charge at the start"):
        await prepare(SETTINGS, DEVICE, request(document, initial_soc=None)[0])
    with pytest.raises(RefusedError, match="the model's band cannot be computed"):
        await prepare(SETTINGS, DEVICE, request({"no": "model"})[0])
    with pytest.raises(RefusedError, match="it has no band; fit it again"):
        await prepare(SETTINGS, DEVICE, request(hand_network.everything(1).to_json())[0])
