import numpy as np
import pytest

from models.data.errors import ModelError
from models.data.timeseries import TimeSeries
from models.design.answer import Material, answer, even_cycle
from models.design.constraints.limits import InfeasibleError
from models.design.request import RequestError, read_request
from tests.unit.models.design.networks import resistive

DOCUMENT = {
    "capacity_Ah": 2.0,
    "initial_soc": 0.5,
    "duration_s": 4000,
    "criterion": "D",
    "signal": "aprbs",
    "limits": {"current_A": [-4, 4], "soc": [0.1, 0.9]},
    "seed": 3,
}


def test_every_key_is_read() -> None:
    written = read_request(DOCUMENT | {"soc_levels": 3, "rest_ratio": 6, "model": "m.json", "load_cycle": "c.csv"})
    assert written.limits.current_A == (-4.0, 4.0) and written.limits.voltage_V is None
    assert written.soc_levels == pytest.approx((0.18, 0.5, 0.82))
    assert (written.rest_ratio, written.seed, written.model, written.load_cycle) == (6.0, 3, "m.json", "c.csv")
    defaults = read_request({"duration_s": 10.0, "limits": {"current_A": [-1.0, 1.0]}})
    assert (defaults.criterion, defaults.signal, defaults.rest_ratio, defaults.seed) == ("D", "optimal", 8.0, 0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"durations": 1.0}, "'durations' is unknown"),
        ({"duration_s": "1 h"}, "duration_s is '1 h'"),
        ({"duration_s": float("nan")}, "duration_s is nan"),
        ({"duration_s": True}, "duration_s is True"),
        ({"limits": None}, "limits are missing"),
        ({"limits": {"soc": [0.1, 0.9]}}, "current_A is missing"),
        ({"limits": {"current_A": [-1.0]}}, "two numbers"),
        ({"limits": {"current_A": [-1.0, 1.0], "power_W": [0, 1]}}, "'power_W' is unknown"),
        ({"criterion": "G"}, "criterion is 'G'"),
        ({"signal": "chirp"}, "signal is 'chirp'"),
        ({"soc_levels": "many"}, "soc_levels"),
        ({"soc_levels": 99}, "soc_levels is 99"),
        ({"dt_s": 0.0}, "dt_s is 0"),
        ({"dt_s": 1e-6}, "at most"),
        ({"capacity_Ah": -1.0}, "capacity_Ah is -1"),
        ({"seed": -1}, "seed is -1"),
        ({"target_std": 0.1}, "target_std.*'aprbs'"),
        ({"rivals": "a"}, "rivals"),
        ({"model": 7}, "model is 7"),
    ],
)
def test_wrong_values_are_named(changes: dict, says: str) -> None:
    with pytest.raises(ModelError, match=says):
        read_request(DOCUMENT | changes)


def test_crossed_limits_are_infeasible() -> None:
    with pytest.raises(InfeasibleError, match=r"current_A is 4..-4"):
        read_request(DOCUMENT | {"limits": {"current_A": [4, -4]}})


def test_an_answer_holds_what_the_contract_names() -> None:
    found = answer(read_request(DOCUMENT), Material(network=resistive()))
    contract = {
        "duration_s",
        "n_samples",
        "log_det_information",
        "parameter_std",
        "constraints_active_share",
        "seconds",
    }
    assert contract <= set(found.figures) and not found.figures["pre_test"]
    assert found.figures["n_samples"] == 400 and found.profile.duration_s == 4000.0
    assert found.figures["net_charge_Ah"] == pytest.approx(
        float(found.profile.current_A[:-1] @ np.diff(found.profile.time_s)) / 3600.0
    )


def test_the_hours_that_an_asked_accuracy_saves_are_in_the_answer() -> None:
    asked = DOCUMENT | {"signal": "optimal", "soc_levels": 2, "duration_s": 20_000}
    whole = answer(read_request(asked), Material(network=resistive()))
    assert whole.design is not None and "accuracy" not in whole.figures
    early = answer(read_request(asked | {"target_std": 2.0 * whole.design.largest_std}), Material(network=resistive()))
    said = early.figures["accuracy"]
    assert said["reached"] and said["saved_h"] > 0.5 and said["visits"] < len(whole.design.blocks)
    assert said["saved_h"] == pytest.approx((said["planned_s"] - early.figures["duration_s"]) / 3600.0)


def test_without_a_model_a_bounded_pre_test_comes_first() -> None:
    found = answer(read_request(DOCUMENT | {"duration_s": 20_000, "dt_s": 1.0}), Material())
    assert found.figures["pre_test"] and found.figures["log_det_information"] is None
    assert np.abs(found.profile.current_A).max() <= 4.0
    soc = found.profile.soc(0.5, 2.0)
    assert soc.min() >= 0.1 - 1e-9 and soc.max() <= 0.9 + 1e-9
    said = found.figures["coverage"]
    assert said["soc"] == pytest.approx([soc.min(), soc.max()], abs=1e-9) and max(said["soc_short"]) < 0.03
    with pytest.raises(InfeasibleError, match="pre-test.*do not suffice"):
        answer(read_request(DOCUMENT | {"duration_s": 300, "dt_s": 1.0}), Material())
    without = {key: value for key, value in DOCUMENT.items() if key != "capacity_Ah"}
    with pytest.raises(RequestError, match="capacity_Ah is missing"):
        answer(read_request(without), Material())


def test_the_pre_tests_run_makes_the_first_reference_model() -> None:
    first = answer(read_request(DOCUMENT | {"duration_s": 20_000, "dt_s": 10.0}), Material()).profile
    time_s = np.arange(0.0, first.duration_s + 1.0, 10.0)
    held = first.current_A[np.searchsorted(first.time_s, time_s[:-1] + 0.5, side="right") - 1]
    current = np.concatenate([[0.0], held])
    soc = 0.5 + np.cumsum(current) / 720.0
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(current))
    run = TimeSeries(time_s, current, 3.3 + 0.5 * soc + 0.03 * current + noise, np.full(len(current), 25.0))
    request = read_request(DOCUMENT | {"duration_s": 3000, "dt_s": 10.0, "signal": "optimal"})
    found = answer(request, Material(runs=(run,), runs_soc=(0.5,)))
    assert found.design is not None and found.asked is not None
    # A bounded network: no output feedback, and its parameters stand at states of charge.
    assert found.asked[0].network.structure.output_order == 0
    assert all(name.startswith("SoC") for name in found.figures["parameter_std"])
    assert found.figures["duration_s"] == 3000.0
    assert {"capacity", "initial_soc"} <= set(found.figures["constants_std"])


def test_a_cell_may_stand_in_a_declared_ambient() -> None:
    found = answer(read_request(DOCUMENT | {"ambient_degC": 5.0}), Material(network=resistive()))
    assert found.asked is not None and found.asked[0].temperature_degC == 5.0
    with pytest.raises(RequestError, match="ambient_degC is 'cold'; a finite number in degC"):
        read_request(DOCUMENT | {"ambient_degC": "cold"})


@pytest.mark.parametrize(
    ("changes", "says"), [({"dt_s": 1.0}, "sampling time is 10 s"), ({"capacity_Ah": 3.0}, "made for 2 Ah")]
)
def test_a_request_for_another_model_is_refused(changes: dict, says: str) -> None:
    with pytest.raises(RequestError, match=says):
        answer(read_request(DOCUMENT | changes), Material(network=resistive()))


def test_rivals_are_told_apart() -> None:
    request = read_request(DOCUMENT | {"criterion": "discriminate", "signal": "optimal", "duration_s": 600})
    found = answer(request, Material(rivals=(resistive(0), resistive(2))))
    assert min(found.figures["separation"]) > 0.0
    with pytest.raises(RequestError, match="names 0"):
        answer(request, Material())


def test_a_load_cycle_is_put_on_an_even_grid() -> None:
    current, dt_s = even_cycle(np.array([0.0, 2.0, 3.0, 5.0]), np.array([1.0, -1.0, 2.0, 0.0]))
    assert dt_s == 1.0
    np.testing.assert_array_equal(current, [1.0, 1.0, -1.0, 2.0, 2.0])
