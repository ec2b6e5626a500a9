"""Protocols of other programs: read, written back equal, and what they cannot say."""

from __future__ import annotations

from typing import Any

import pytest

from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.errors import ProtocolError
from bench_service.protocol.formats.pybamm import from_pybamm, to_pybamm
from bench_service.protocol.formats.reading import parse_document
from bench_service.protocol.formats.unicycler import from_unicycler
from bench_service.protocol.formats.unicycler_out import to_unicycler
from bench_service.protocol.program import Window
from tests.unit.bench_service.protocol.protocol_rig import document


def cc(rate: float, **until: float) -> dict[str, Any]:
    return {"step": "constant_current", "rate_C": rate, **{f"until_{k}": v for k, v in until.items()}}


def unicycler(*method: dict[str, Any], **more: Any) -> dict[str, Any]:
    base = {"unicycler": {"version": "0.4.6"}, "sample": {"name": "s", "capacity_mAh": 123.0}, "record": {"time_s": 10}}
    return base | {"method": list(method)} | more


def plain(data: Any) -> Any:
    """Without what is null: both forms are written."""
    if isinstance(data, dict):
        return {k: plain(v) for k, v in data.items() if v is not None}
    return [plain(v) for v in data] if isinstance(data, list) else data


NESTED = unicycler(
    {"step": "tag", "tag": "formation"},
    {"step": "open_circuit_voltage", "until_time_s": 3600.0, "id": "a1"},
    cc(0.1, time_s=54000.0, voltage_V=4.9),
    {"step": "constant_voltage", "voltage_V": 4.9, "until_time_s": 21600.0, "until_rate_C": 0.05},
    {"step": "constant_current", "current_mA": -12.3, "until_voltage_V": 3.5},
    {"step": "loop", "loop_to": "formation", "cycle_count": 3},
    cc(0.5, voltage_V=4.9),
    cc(-0.5, voltage_V=3.5),
    {"step": "loop", "loop_to": 7, "cycle_count": 24},
    cc(-0.1, voltage_V=3.5),
    {"step": "loop", "loop_to": 7, "cycle_count": 20},
    safety={"max_voltage_V": 5.0, "min_voltage_V": -0.1, "max_current_mA": 200.0, "max_capacity_mAh": 300.0}
    | {"delay_s": 10.0},
    record={"time_s": 10.0, "voltage_V": 0.1, "current_mA": 0.1},
)  # fmt: skip


def test_a_unicycler_protocol_is_written_back_equal() -> None:
    own = from_unicycler(NESTED)
    assert plain(to_unicycler(own)) == NESTED
    assert [step["step"] for step in own["steps"]] == ["mark", "loop", "loop"]
    assert own["capacity_Ah"] == 0.123 and own["limits"]["current_A"] == [None, 0.2]
    program = compile_protocol(read_protocol(own), 2.5, Window((-1.0, 6.0), (-1.0, 1.0)))
    assert program.n_steps == 7 and program.capacity_Ah == 0.123


def test_numbers_may_be_text_as_older_versions_write_them() -> None:
    old = unicycler({"step": "constant_current", "rate_C": "C/10", "current_mA": None, "until_time_s": "600"})
    assert from_unicycler(old)["steps"] == [
        {"step": "constant_current", "rate_C": 0.1, "until": {"time_s": 600.0}},
    ]


@pytest.mark.parametrize(
    ("bad", "told"),
    [
        ({"step": "impedance_spectroscopy", "amplitude_V": 0.01}, r"step 2 \(impedance_spectroscopy\)"),
        ({"step": "constant_current", "rate_C": 1}, r"step 2 \(constant_current\) has no end"),
        ({"step": "loop", "loop_to": 5, "cycle_count": 2}, r"step 2 \(loop\)"),
        ({"step": "open_circuit_voltage", "until_time": 5}, "unknown key"),
        ({"rate_C": 1}, "step 2 is incomplete"),
    ],
)
def test_what_a_unicycler_protocol_has_wrong_is_told_with_its_step(bad: dict[str, Any], told: str) -> None:
    with pytest.raises(ProtocolError, match=told):
        from_unicycler(unicycler(cc(1, voltage_V=4), bad))


ENDING_LOOP = {
    "step": "loop",
    "count": 2,
    "until": {"cycle": {"above": 3}},
    "steps": [{"step": "rest", "until": {"time_s": 1}}],
}


@pytest.mark.parametrize(
    ("step", "unicycler_says", "pybamm_says"),
    [
        ({"step": "power", "power_W": 3, "until": {"voltage_V": 4}}, r"step 1 \(power\)", None),
        ({"step": "rest", "until": {"dV_dt_V_per_s": 1e-6, "time_s": 9}}, "step 1", "step 1"),
        ({"step": "pulse", "rate_C": 1, "on_s": 1, "off_s": 1}, r"step 1 \(pulse\)", r"step 1 \(pulse\)"),
        ({"step": "constant_current", "rate_C": 1, "until": {"charge_Ah": 1}}, "step 1", "step 1"),
        ({"step": "rest", "until": {"time_s": 9}, "record": {"time_s": 1}}, "step 1", "step 1"),
        (ENDING_LOOP, "step 1", "step 1"),
    ],
)  # fmt: skip
def test_what_other_formats_cannot_say_fails_and_names_the_step(step, unicycler_says, pybamm_says) -> None:
    own = document(step, capacity_Ah=1.0, record={"time_s": 1})
    read_protocol(own)
    with pytest.raises(ProtocolError, match=unicycler_says):
        to_unicycler(own)
    if pybamm_says is None:
        assert to_pybamm(own) == ["Charge at 3 W until 4 V"]
    else:
        with pytest.raises(ProtocolError, match=pybamm_says):
            to_pybamm(own)


STRINGS = [
    "Charge at 0.5C for 10800 seconds or until 4.2 V",
    "Hold at 4.2 V until 0.05 A",
    "Rest for 600 seconds",
    "Discharge at 1.5 A until 2.5 V",
    "Discharge at 3 W for 60 seconds or until 2.5 V",
    "Hold at 4.1 V for 60 seconds or until 0.02C",
]


def test_pybamm_strings_are_written_back_equal() -> None:
    own = from_pybamm(STRINGS)
    assert len(read_protocol(own).steps) == 6
    assert to_pybamm(own) == STRINGS


def test_pybamm_strings_in_their_other_spellings() -> None:
    cycle = ["Discharge at C/5 for 3 hours or until 3300 mV", "Rest for 1 hour"]
    loop, charge = from_pybamm([cycle, "Charge at 20 mA until 4V"])["steps"]
    assert loop["steps"][0]["rate_C"] == -0.2
    assert loop["steps"][0]["until"] == pytest.approx({"time_s": 10800.0, "voltage_V": 3.3})
    assert loop["steps"][1]["until"] == {"time_s": 3600.0} and charge["current_A"] == 0.02


@pytest.mark.parametrize(
    "text", ["Run US06 (A)", "Charge at 1C", "Charge at 1C until 10 degC", "Charge", "Rest at 4 V"]
)
def test_other_strings_are_refused_with_what_they_are(text: str) -> None:
    with pytest.raises(ProtocolError, match="experiment.0"):
        from_pybamm([text])


def test_a_file_is_taken_for_what_it_is() -> None:
    assert parse_document('["Rest for 60 seconds"]')["steps"][0]["step"] == "rest"
    with pytest.raises(ProtocolError, match="no JSON"):
        parse_document('{"schema": ')
    with pytest.raises(ProtocolError, match="no protocol"):
        parse_document("3")
