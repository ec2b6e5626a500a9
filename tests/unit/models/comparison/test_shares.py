"""How error and time are shared out over a variable."""

from dataclasses import replace

import numpy as np
import pytest

from models.comparison.samples import ErrorSamples
from models.comparison.shares import error_shares, telling
from tests.unit.models.comparison.hand_samples import samples


def rows_of(found: list[dict], variable: str) -> list[dict]:
    return sorted((row for row in found if row["variable"] == variable), key=lambda row: row["from"])


@pytest.fixture
def at_the_bottom() -> ErrorSamples:
    """3 mV below a state of charge of 0.1, which is a tenth of the time, and 1 mV elsewhere."""
    soc = np.linspace(0.0, 0.999, 1000)
    return replace(samples(1000), soc=soc, error_V=np.where(soc < 0.1, 3e-3, -1e-3))


def test_shares_of_each_variable_add_up_to_one(at_the_bottom: ErrorSamples) -> None:
    found = error_shares(at_the_bottom)
    for variable in {row["variable"] for row in found}:
        rows = rows_of(found, variable)
        assert sum(row["share_of_squared_error"] for row in rows) == pytest.approx(1.0)
        assert sum(row["share_of_time"] for row in rows) == pytest.approx(1.0)


def test_the_most_telling_range_comes_first(at_the_bottom: ErrorSamples) -> None:
    first = error_shares(at_the_bottom)[0]
    assert first["variable"] == "soc"
    assert first["from"] == 0.0 and first["to"] == pytest.approx(0.099)
    assert first["rmse_mV"] == pytest.approx(3.0)
    # Measured lies above the model.
    assert first["bias_mV"] == pytest.approx(3.0)
    assert first["share_of_time"] == pytest.approx(0.1)
    assert first["share_of_squared_error"] == pytest.approx(100 * 9.0 / (100 * 9.0 + 900 * 1.0))


def test_ranges_with_less_error_than_time_come_last(at_the_bottom: ErrorSamples) -> None:
    found = error_shares(at_the_bottom)
    more = [row["share_of_squared_error"] > row["share_of_time"] for row in found]
    assert more == sorted(more, reverse=True)


def test_currents_are_told_in_ampere_and_split_at_half_a_percent_of_1c() -> None:
    c_rate = np.repeat([-0.01, -0.004, 0.004, 0.01], 250)
    found = rows_of(error_shares(replace(samples(1000), c_rate=c_rate)), "current_A")
    # Of 2 Ah: at rest below 10 mA.
    assert [(row["from"], row["to"]) for row in found] == [(-0.02, -0.02), (-0.008, 0.008), (0.02, 0.02)]
    assert [row["share_of_time"] for row in found] == [0.25, 0.5, 0.25]


def test_what_does_not_move_or_was_not_measured_has_no_ranges() -> None:
    still = replace(samples(100), throughput_Ah=np.zeros(100), temperature_degC=np.full(100, np.nan))
    found = {row["variable"] for row in error_shares(still)}
    assert "throughput_Ah" not in found and "temperature_degC" not in found
    assert {"soc", "current_A", "direction", "since_step_s", "time_h"} <= found


def test_temperatures_are_ranges_of_five_degrees() -> None:
    warm = replace(samples(400), temperature_degC=np.repeat([9.0, 11.0, 14.9, 21.0], 100))
    found = rows_of(error_shares(warm), "temperature_degC")
    assert [(row["from"], row["to"], row["share_of_time"]) for row in found] == [
        (9.0, 9.0, 0.25),
        (11.0, 14.9, 0.5),
        (21.0, 21.0, 0.25),
    ]


def test_no_error_at_all_is_shared_out_as_nothing() -> None:
    found = error_shares(replace(samples(100), error_V=np.zeros(100)))
    assert all(row["share_of_squared_error"] == 0.0 for row in found)


def test_telling_weighs_error_against_time() -> None:
    assert telling(0.3, 0.3) == pytest.approx(0.0, abs=1e-12)
    expected = 0.5 * np.log(0.5 / 0.1) + 0.5 * np.log(0.5 / 0.9)
    assert telling(0.5, 0.1) == pytest.approx(expected)
    # Much error in much time tells less than the same in little; shares of 0 and 1 stay finite.
    assert telling(0.5, 0.05) > telling(0.5, 0.1)
    assert np.isfinite([telling(0.0, 0.5), telling(1.0, 0.5), telling(1.0, 0.0)]).all()
    # In single precision, as regions have their shares, all of the time is no more than that either.
    single = np.array([0.0, 0.5, 1.0], dtype=np.float32)
    with np.errstate(all="raise"):
        assert np.isfinite(telling(single[:, None], single)).all()
