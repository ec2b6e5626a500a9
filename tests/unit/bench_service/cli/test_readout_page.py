"""Drawings of a model's read-outs: well formed, complete, and honest about what is missing."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from bench_service.cli.readout_page import Line, plot, readout_parts, round_values
from bench_service.cli.tables import readout_lines
from tests.unit.models import hand_network

SOC = np.linspace(0.0, 1.0, 11)


def points(svg: str, tag: str) -> list[np.ndarray]:
    found = [node.attrib["points"] for node in ElementTree.fromstring(svg).iter(tag)]
    return [np.array([[float(v) for v in pair.split(",")] for pair in text.split()]) for text in found]


def test_a_curve_rises_where_its_values_do_and_its_band_surrounds_it() -> None:
    svg = plot([Line("a", SOC, 3.0 + SOC, np.full(11, 0.1), "#000")], "SoC", "V")
    (curve,), (band,) = points(svg, "polyline"), points(svg, "polygon")
    assert (np.diff(curve[:, 0]) > 0).all() and (np.diff(curve[:, 1]) < 0).all()
    assert band[:11, 1].max() < curve[0, 1] + 0.1 and len(band) == 22
    assert ">3" in svg and ">4" in svg


def test_a_band_far_wider_than_the_curve_does_not_flatten_it() -> None:
    svg = plot([Line("a", SOC, SOC, np.full(11, 100.0), "#000")], "SoC", "V")
    (curve,) = points(svg, "polyline")
    assert np.ptp(curve[:, 1]) > 50.0


def test_missing_points_are_left_out_and_nothing_at_all_is_said() -> None:
    y = SOC.copy()
    y[3] = np.nan
    assert len(points(plot([Line("a", SOC, y, None, "#000")], "SoC", "V"), "polyline")[0]) == 10
    assert "does not settle" in plot([Line("a", SOC, np.full(11, np.nan), None, "#000")], "SoC", "V")


def test_labels_are_escaped() -> None:
    assert "<b>" not in plot([Line("<b>", SOC, SOC, None, "#000")], "SoC", "V")


def test_a_network_is_drawn_over_soc_and_temperature_in_both_directions() -> None:
    parts = "".join(readout_parts(hand_network.everything(1)))
    assert parts.count("<svg") == 4
    assert "discharge with" in parts and "charge with" in parts
    for svg in re.findall(r"<svg.*?</svg>", parts):
        ElementTree.fromstring(svg)


def test_lines_for_a_person_leave_out_what_is_not_known() -> None:
    lines = readout_lines(
        {
            "resistance": [
                {"soc": 0.5, "temperature_degC": 25.0, "current_A": -2.5, "resistance_Ohm": 0.03, "std_Ohm": 0.001},
                {"soc": 0.5, "temperature_degC": 25.0, "current_A": 2.5, "resistance_Ohm": None, "std_Ohm": None},
            ],
            "ocv_V": [3.0, 4.1],
            "hysteresis_V": 0.004,
            "ocv_std_V": None,
            "thermal": {"heat_capacity_J_per_K": 45.0, "heat_transfer_W_per_K": 0.1, "std": {}},
            "reservations": ["resistance is not positive"],
        }
    )
    assert len(lines) == 4
    assert "30.00 ± 2 mΩ" in lines[0] and "4.0 mV" in lines[1]
    assert "45.0 J/K" in lines[2] and lines[3] == "note: resistance is not positive"


@pytest.mark.parametrize(
    ("low", "high", "marks"),
    [
        (0.0, 3.89, [0.0, 1.0, 2.0, 3.0]),
        (-4.16, 4.16, [-4.0, -2.0, 0.0, 2.0, 4.0]),
        (2.464, 4.336, [2.5, 3.0, 3.5, 4.0]),
        (7.0, 7.0, [7.0]),
    ],
)
def test_an_axis_is_marked_at_round_values(low: float, high: float, marks: list[float]) -> None:
    assert round_values(low, high) == pytest.approx(marks)
