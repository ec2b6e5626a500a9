"""The library: every standard test is made for every simulated cell, and comes to its end on it."""

from __future__ import annotations

import pytest

from bench_service.campaign.protocol_design import with_designs
from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.library import build_test, standard_test, standard_tests
from bench_service.protocol.preview import preview
from simulators.catalogue import CELLS
from tests.unit.bench_service.protocol.protocol_rig import play, window_of

# What makes the long ones short.
SHORT = {
    "ageing": {"blocks": 1, "cycles": 1},
    "cc_cv_cycling": {"cycles": 1},
    "formation": {"first_C": 0.5, "then_C": 1.0, "first_cycles": 1, "then_cycles": 1, "soak_s": 60.0},
    "gitt": {"pulses": 2, "relax_s": 600.0},
    "hppc": {"levels": 2, "relax_s": 300.0, "pulse_record_s": 1.0},
    "pseudo_ocv": {"slow_C": 0.5},
    "rate_test": {"rates_C": [1.0], "charge_C": 1.0},
    "self_discharge": {"long_rest_s": 3600.0},
    "drive_cycle": {"repeats": 1},
}


@pytest.mark.parametrize("name", [test.name for test in standard_tests()])
@pytest.mark.parametrize("cell", ["nmc", "lfp"])
def test_a_standard_test_is_played_to_its_end(cell: str, name: str) -> None:
    capacity_Ah, window = CELLS[cell].parameters.capacity_Ah, window_of(cell)
    document = with_designs(build_test(name, SHORT.get(name, {}), window, capacity_Ah), window, capacity_Ah)
    program = compile_protocol(read_protocol(document), capacity_Ah, window)
    played = play(program, cell, dt_s=10.0)
    assert played.engine.stopped is None and played.ended
    low_V, high_V = window.voltage_V
    assert low_V < played.voltage_V.min() and played.voltage_V.max() < high_V


@pytest.mark.parametrize("test", standard_tests(), ids=lambda test: test.name)
def test_every_standard_test_says_what_it_is_for_and_how_long_it_takes(test) -> None:
    assert test.sentence.endswith(".") and all(each["meaning"] for each in test.parameters.values())
    window = window_of()
    document = with_designs(build_test(test.name, SHORT.get(test.name, {}), window, 2.5), window, 2.5)
    seen = preview(compile_protocol(read_protocol(document), 2.5, window), 0.5, 10.0)
    assert seen.duration_s is not None and len(seen.time_s) == len(seen.current_A) > 2


def test_parameters_are_checked() -> None:
    with pytest.raises(ProtocolError, match="no such parameter"):
        build_test("capacity", {"colour": 1}, window_of(), 2.5)
    with pytest.raises(ProtocolError, match="whole number"):
        build_test("capacity", {"rounds": 1.5}, window_of(), 2.5)
    with pytest.raises(ProtocolError, match="no such standard test"):
        standard_test("alchemy")


def test_there_are_twelve() -> None:
    assert len(standard_tests()) >= 12
