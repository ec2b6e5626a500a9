"""How far a comparison reaches: the trained domain, gaps, and the bands."""

from dataclasses import replace

import numpy as np
import pytest

from models.comparison.reach import band_figures, bands, expected_rmse_mV, gaps, inside_by
from models.comparison.start import Start
from models.network.structure import InputChannel, PartitionAxis, Structure
from models.uncertainty.bands import NORMAL_95, PredictionBand
from tests.unit.models.hand_network import grid_run, network

# Trained from 0.07 to 0.93, from -7 to 5 A and from 4 to 41 degC.
MODEL = network(Structure(0, (InputChannel("soc", delay=1),), (PartitionAxis("soc"),), 1.0), np.array([[0.7, 3.4]]))


def test_half_a_percent_of_the_range_is_let_pass() -> None:
    current = np.array([-7.07, -7.05, 5.05, 5.07, np.nan])
    run = grid_run(np.zeros(5), 25.0)
    found = inside_by(MODEL, replace(run, current_A=current), np.array([0.07 - 0.005, 0.07 - 0.004, 0.5, 0.934, 0.935]))
    assert found["current_A"].tolist() == [False, True, True, False, True]
    assert found["soc"].tolist() == [False, True, True, True, False]
    assert found["temperature_degC"].all()


def test_a_temperature_that_was_not_measured_is_inside() -> None:
    found = inside_by(MODEL, grid_run(np.zeros(3), np.array([np.nan, 60.0, 20.0])), np.full(3, 0.5))
    assert found["temperature_degC"].tolist() == [True, False, True]


def test_gaps_are_counted_and_the_longest_is_told_in_seconds() -> None:
    measured = np.array([0, 0, 1, 1, 0, 1, 0, 0, 0, 1], dtype=bool)
    run = replace(grid_run(np.zeros(10), 25.0), dt_s=2.0, measured=measured, segment_starts=(0, 6))
    found = gaps(replace(run, without_temperature_s=4.0))
    assert found == {
        "run": "run",
        "missing_share": 0.6,
        "gaps": 3,
        "longest_gap_s": 6.0,
        "parts": 2,
        "without_temperature_s": 4.0,
    }


def test_a_whole_run_has_no_gap_and_a_blind_one_is_one() -> None:
    run = grid_run(np.zeros(4), 25.0)
    whole = gaps(replace(run, measured=np.ones(4, dtype=bool)))
    assert (whole["gaps"], whole["longest_gap_s"], whole["missing_share"]) == (0, 0.0, 0.0)
    assert (gaps(run)["gaps"], gaps(run)["longest_gap_s"]) == (1, 4.0)


def test_a_model_that_does_not_say_what_it_does_not_know_has_no_band() -> None:
    run = grid_run(np.zeros(4), 25.0)
    assert bands(MODEL, [run], [Start(0.5)]) is None
    assert band_figures(None, [run], [np.ones(4, dtype=bool)]) is None


def test_shares_within_the_band_over_all_samples_and_inside_the_domain() -> None:
    std_V = 0.01 / NORMAL_95
    band = PredictionBand(np.full(5, 3.7), np.zeros(5), np.full(5, std_V), np.full(5, std_V))
    voltage = np.array([3.7, 3.7099, 3.7101, 3.6, np.nan])
    run = replace(grid_run(np.zeros(5), 25.0), voltage_V=voltage, measured=~np.isnan(voltage))
    found = band_figures([band], [run], [np.array([True, True, True, False, True])])
    assert found["coverage_95"] == 0.5
    assert found["coverage_95_inside"] == pytest.approx(2.0 / 3.0)
    assert found["mean_half_width_mV"] == pytest.approx(10.0)


def test_what_is_to_be_expected_counts_the_measured_samples() -> None:
    usual_V = np.array([0.003, 0.004, 1.0])
    band = PredictionBand(np.full(3, 3.7), np.zeros(3), np.full(3, 1.0), usual_V)
    run = replace(grid_run(np.zeros(3), 25.0), measured=np.array([True, True, False]))
    assert expected_rmse_mV([band], [run]) == pytest.approx(1e3 * np.sqrt(12.5e-6))
    assert expected_rmse_mV(None, [run]) is None
    assert expected_rmse_mV([band], [replace(run, measured=np.zeros(3, dtype=bool))]) is None


def test_no_figures_of_nothing() -> None:
    band = PredictionBand(np.full(2, 3.7), np.zeros(2), np.full(2, 0.01), np.full(2, 0.01))
    blind = grid_run(np.zeros(2), 25.0)
    found = band_figures([band], [blind], [np.ones(2, dtype=bool)])
    assert found == {"coverage_95": None, "coverage_95_inside": None, "mean_half_width_mV": None}
