import numpy as np
import pytest

from models.data.errors import ModelError
from models.design.test_signals import family, find_families
from models.design.test_signals.family import FamilyRequest, sweep_A

CYCLE_A = np.random.default_rng(0).normal(-1.0, 2.0, 600)
NAMES = {"aprbs", "asymmetric_steps", "discharge_pulses", "drive_cycle", "hppc", "multisine", "prbs"}


def request(**changes: object) -> FamilyRequest:
    fields: dict[str, object] = {
        "current_A": (-5.0, 2.5),
        "soc": (0.1, 0.9),
        "capacity_Ah": 2.5,
        "initial_soc": 0.5,
        "duration_s": 14_000.0,
        "dt_s": 1.0,
        "cycle_A": CYCLE_A,
    }
    return FamilyRequest(**(fields | changes))  # type: ignore[arg-type]


def test_all_are_found_by_their_file() -> None:
    assert set(find_families()) == NAMES
    assert all(found.name == name and found.title for name, found in find_families().items())


@pytest.mark.parametrize("name", sorted(NAMES))
@pytest.mark.parametrize("duration_s", [1.0, 600.0, 14_000.0])
def test_currents_have_the_asked_length_and_stay_within_their_limits(name: str, duration_s: float) -> None:
    current = family(name).build(request(duration_s=duration_s), np.random.default_rng(1))
    assert len(current) == int(duration_s) and np.isfinite(current).all()
    assert current.min() >= -5.0 - 1e-12 and current.max() <= 2.5 + 1e-12
    again = family(name).build(request(duration_s=duration_s), np.random.default_rng(1))
    np.testing.assert_array_equal(current, again)


@pytest.mark.parametrize("name", sorted(NAMES))
def test_they_go_through_the_window_as_far_as_the_time_allows(name: str) -> None:
    current = family(name).build(request(duration_s=30_000.0), np.random.default_rng(1))
    soc = 0.5 + np.cumsum(current) / 9000.0
    assert np.ptp(soc) > 0.6


def test_pulse_families_keep_the_window_by_themselves() -> None:
    for name in ("discharge_pulses", "hppc", "asymmetric_steps", "drive_cycle"):
        soc = 0.5 + np.cumsum(family(name).build(request(), np.random.default_rng(1))) / 9000.0
        assert soc.min() >= 0.1 - 1e-9 and soc.max() <= 0.9 + 1e-9


def test_binary_sequences_have_a_spectrum_without_gaps() -> None:
    """A register of maximum length repeats after 2^n - 1 clocks only."""
    current = family("prbs").build(request(), np.random.default_rng(3))
    signs = np.sign(current - sweep_A(request()))[::5][:1023]
    assert np.abs(signs).min() == 1.0 and abs(signs.sum()) < 200
    for lag in (1, 2, 3, 100, 341):
        assert abs(np.mean(signs[lag:] * signs[:-lag])) < 0.15


@pytest.mark.parametrize(
    ("changes", "says"),
    [({"duration_s": 0.0}, "no sample"), ({"current_A": (1.0, 2.0)}, "0 must lie"), ({"dt_s": 0.0}, "positive")],
)
def test_bad_requests_are_refused(changes: dict, says: str) -> None:
    with pytest.raises(ModelError, match=says):
        request(**changes)


def test_unknown_names_and_a_missing_cycle_are_named() -> None:
    with pytest.raises(ModelError, match="use optimal or one of aprbs"):
        family("chirp")
    with pytest.raises(ModelError, match="load_cycle"):
        family("drive_cycle").build(request(cycle_A=None), np.random.default_rng(0))
