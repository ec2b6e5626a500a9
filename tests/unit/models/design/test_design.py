import numpy as np
import pytest

from models.data.errors import ModelError
from models.design.constraints.limits import InfeasibleError, Limits
from models.design.design import design
from models.design.optimise.block_design import DesignRequest, longest_time_constant_s
from models.design.sequence.sequence_plan import REST_RATIO
from tests.unit.models.design.networks import experiment, resistive

LIMITS = Limits((-6.0, 4.0), (0.1, 0.9), voltage_V=(3.1, 4.0))
LEVELS = (0.3, 0.7)
DT_S = 10.0


def request(**changes: object) -> DesignRequest:
    fields: dict[str, object] = {
        "limits": LIMITS,
        "duration_s": 20_000.0,
        "soc_levels": LEVELS,
        "n_starts": 2,
        "rest_ratio": REST_RATIO,
    }
    return DesignRequest(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize("signal", ["optimal", "aprbs", "hppc"])
@pytest.mark.parametrize("levels", [LEVELS, ()])
def test_every_signal_keeps_the_limits_and_is_judged_alike(signal: str, levels: tuple[float, ...]) -> None:
    found = design(experiment(), request(signal=signal, soc_levels=levels, duration_s=9000.0))
    assert LIMITS.current_A[0] - 1e-9 <= found.current_A.min() and found.current_A.max() <= LIMITS.current_A[1] + 1e-9
    assert 0.1 - 1e-9 <= found.soc.min() and found.soc.max() <= 0.9 + 1e-9
    assert found.band_low_V.min() >= 3.1 and found.band_high_V.max() <= 4.0
    assert len(found.parameter_std) == resistive().theta.size
    assert found.log_det == pytest.approx(np.linalg.slogdet(found.information)[1])
    assert found.profile().duration_s == found.duration_s == pytest.approx(9000.0, rel=0.02)


def test_a_designed_sequence_tells_more_than_a_family_of_the_same_duration() -> None:
    designed = design(experiment(), request())
    for signal in ("aprbs", "hppc", "discharge_pulses"):
        assert designed.log_det > design(experiment(), request(signal=signal)).log_det


def test_blocks_lie_at_their_levels_and_complement_each_other() -> None:
    found = design(experiment(), request(limits=Limits((-6.0, 4.0), (0.1, 0.9))))
    np.testing.assert_allclose([block.soc for block in found.blocks], [0.7, 0.3, 0.7, 0.7], atol=1e-6)
    counted = 0.5 + np.concatenate([[0.0], np.cumsum(found.current_A)]) * DT_S / 7200.0
    np.testing.assert_allclose(counted[[block.first for block in found.blocks]], [0.7, 0.3, 0.7, 0.7], atol=1e-6)
    # One optimisation for each block but the repeated one, each knowing more than the one before.
    values = [optimum.value for optimum in found.optima]
    assert len(values) == 3 and values == sorted(values)


def test_the_seed_decides_all() -> None:
    one, two, other = (design(experiment(), request(seed=seed, duration_s=12_000.0)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.current_A, two.current_A)
    assert not np.array_equal(one.current_A, other.current_A)


def test_a_load_cycle_bounds_the_blocks() -> None:
    cycle = np.concatenate([np.zeros(50), np.repeat([-2.0, 1.5, -1.0, 0.5], 20)])
    found = design(experiment(), request(cycle_A=cycle, limits=Limits((-6.0, 4.0), (0.1, 0.9))))
    for block in found.blocks:
        inside = found.current_A[block.first : block.last]
        assert inside.min() >= -2.0 - 1e-9 and inside.max() <= 1.5 + 1e-9
    # Blocks within a cycle can move little charge: the plan knows that before, and keeps the duration.
    assert 0.97 * 20_000.0 <= found.duration_s <= 20_000.0


def test_it_ends_after_the_visit_that_reaches_the_accuracy_asked_for() -> None:
    whole = design(experiment(), request())
    assert whole.saved_h < 0.1
    early = design(experiment(), request(target_std=2.0 * whole.largest_std))
    assert early.largest_std <= 2.0 * whole.largest_std
    assert 1 <= len(early.blocks) < len(whole.blocks)
    assert early.saved_h == pytest.approx((whole.duration_s - early.duration_s) / 3600.0, abs=0.1)
    # Up to there it is the same test, and it ends with its rest as well.
    same = early.blocks[-1].last
    np.testing.assert_array_equal(early.current_A[:same], whole.current_A[:same])
    assert not early.current_A[-120:].any()
    never = design(experiment(), request(target_std=1e-3 * whole.largest_std))
    np.testing.assert_array_equal(never.current_A, whole.current_A)


@pytest.mark.parametrize(
    ("changes", "says"), [({"target_std": 0.0}, "target_std is 0"), ({"soc_levels": ()}, "visits")]
)
def test_an_accuracy_that_cannot_end_a_test_is_refused(changes: dict, says: str) -> None:
    with pytest.raises(InfeasibleError, match=says):
        request(**{"target_std": 0.1} | changes)


def test_a_sequence_ends_with_a_rest() -> None:
    found, asked = design(experiment(), request()), design(experiment(), request(final_rest_s=4000.0))
    assert request().rest_s == 1200.0 and request(duration_s=40_000.0).rest_s == 1800.0
    assert not found.current_A[-120:].any()
    assert not asked.current_A[-400:].any() and asked.duration_s == pytest.approx(20_000.0, rel=0.02)
    assert request(signal="aprbs").rest_s == 0.0 and request(soc_levels=()).rest_s == 0.0
    with pytest.raises(InfeasibleError, match="final_rest_s is 11000 s"):
        request(final_rest_s=11_000.0)


@pytest.mark.parametrize(
    ("changes", "error", "says"),
    [
        ({"duration_s": 0.0}, InfeasibleError, "duration is 0 s"),
        ({"duration_s": 500.0}, InfeasibleError, "alone take"),
        ({"criterion": "G"}, ModelError, "criterion"),
        ({"signal": "chirp"}, ModelError, "use optimal or"),
        ({"limits": Limits((-6.0, 4.0), (0.1, 0.9), voltage_V=(3.1, 3.2))}, InfeasibleError, "voltage_V"),
        (
            {"limits": Limits((-6.0, 4.0), (0.1, 0.9), temperature_degC=(0.0, 50.0)), "soc_levels": ()},
            InfeasibleError,
            "temperature_degC.*no thermal model",
        ),
    ],
)
def test_what_stands_against_a_request_is_named(changes: dict, error: type[Exception], says: str) -> None:
    with pytest.raises(error, match=says):
        design(experiment(), request(**changes))


def test_the_longest_time_constant_is_that_of_the_slowest_pole() -> None:
    network = resistive(order=1, dt_s=100.0)
    assert longest_time_constant_s(network) == pytest.approx(-100.0 / np.log(0.8))
