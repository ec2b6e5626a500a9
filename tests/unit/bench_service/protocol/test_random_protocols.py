"""Any protocol that is admitted stays inside the limits and comes to an end."""

from __future__ import annotations

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench_service.protocol.compiling import compile_protocol
from bench_service.protocol.document import read_protocol
from bench_service.protocol.errors import ProtocolError
from simulators.catalogue import CELLS
from tests.unit.bench_service.protocol.protocol_rig import document, play, window_of

SECONDS = st.floats(20, 1500)
RATE = st.floats(0.1, 2.0).flatmap(lambda size: st.sampled_from([size, -size]))
VOLTAGE = st.floats(2.52, 4.18)
END = st.fixed_dictionaries(
    {"time_s": SECONDS},
    optional={
        "voltage_V": VOLTAGE,
        "charge_share": st.floats(0.01, 0.5),
        "soc": st.fixed_dictionaries({"above": st.floats(0.1, 0.9)}),
        "temperature_degC": st.fixed_dictionaries({"above": st.floats(25.5, 40)}),
    },
)
REST = st.builds(lambda s: {"step": "rest", "until": {"time_s": s}}, SECONDS)
CURRENT = st.builds(lambda r, e: {"step": "constant_current", "rate_C": r, "until": e}, RATE, END)
HELD = st.fixed_dictionaries({"time_s": SECONDS}, optional={"rate_C": st.floats(0.02, 0.5)})
CC_CV = st.builds(lambda r, v, e: {"step": "cc_cv", "rate_C": r, "voltage_V": v, "until": e}, RATE, VOLTAGE, HELD)
CV = st.builds(lambda v, e: {"step": "constant_voltage", "voltage_V": v, "until": e}, VOLTAGE, HELD)
POWER = st.builds(lambda p, e: {"step": "power", "power_W": p, "until": e}, st.floats(-15, 15).filter(lambda p: p), END)
PULSE = st.builds(
    lambda r, on, off, n: {"step": "pulse", "rate_C": r, "on_s": on, "off_s": off, "count": n},
    RATE, st.floats(10, 60), st.floats(0, 60), st.integers(1, 5),
)  # fmt: skip
PROFILE = st.builds(
    lambda values, clip: {
        "step": "profile", "time_s": [30.0 * k for k in range(len(values))], "rate_C": values, "clip_voltage_V": clip
    },
    st.lists(st.floats(-2, 2), min_size=2, max_size=8), st.sampled_from([None, [2.6, 4.15]]),
)  # fmt: skip
PLAYED = st.one_of(REST, CURRENT, CC_CV, CV, POWER, PULSE, PROFILE)
LOOP = st.builds(
    lambda n, steps: {"step": "loop", "count": n, "steps": steps},
    st.integers(1, 3), st.lists(PLAYED, min_size=1, max_size=3),
)  # fmt: skip
GROUP = st.builds(
    lambda steps, low: {"step": "group", "until": {"soc": {"below": low}}, "steps": steps},
    st.lists(PLAYED, min_size=1, max_size=3), st.floats(0.1, 0.6),
)  # fmt: skip
PROTOCOL = st.lists(st.one_of(PLAYED, LOOP, GROUP), min_size=1, max_size=5)


SLOW = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


@settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=SLOW)
@given(steps=PROTOCOL, soc=st.floats(0.05, 0.95), cell=st.sampled_from(["nmc", "nmc", "lfp"]))
def test_random_protocols_stay_inside_and_end(steps, soc: float, cell: str) -> None:
    window = window_of(cell, duration_s=20_000.0, soc=(0.0, 1.0))
    capacity_Ah = CELLS[cell].parameters.capacity_Ah
    try:
        program = compile_protocol(read_protocol(document(*steps)), capacity_Ah, window)
    except ProtocolError:
        return  # refused before the start
    played = play(program, cell, dt_s=2.0, soc=soc, most=20_000)
    assert played.time_s[-1] <= window.duration_s and len(played.time_s) < 20_000
    (low_V, high_V), (low_A, high_A) = window.voltage_V, window.current_A
    assert low_V <= played.voltage_V.min() and played.voltage_V.max() <= high_V, played.engine.stopped
    assert low_A - 0.01 <= played.current_A.min() and played.current_A.max() <= high_A + 0.01
