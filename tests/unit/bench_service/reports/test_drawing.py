"""Drawings: well formed, to scale, complete, and honest about what is missing."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from bench_service.reports.document import Figure
from bench_service.reports.drawing import Axis, Bar, Line, Piece, bars, curves, cut_bars, heat_map, level, round_values
from bench_service.reports.readouts import readout_section
from models.readouts import tables
from tests.unit.models import hand_network

SOC = np.linspace(0.0, 1.0, 11)
X, Y = Axis("state of charge"), Axis("voltage", "V")


def drawn(*lines: Line) -> ElementTree.Element:
    figure = curves("caption", lines, X, Y)
    assert isinstance(figure, Figure)
    return ElementTree.fromstring(figure.svg)


def points(svg: ElementTree.Element, tag: str) -> list[np.ndarray]:
    found = [node.attrib["points"] for node in svg.iter(tag)]
    return [np.array([[float(v) for v in pair.split(",")] for pair in text.split()]) for text in found]


def test_a_curve_rises_where_its_values_do_and_its_band_surrounds_it() -> None:
    svg = drawn(Line("a", SOC, 3.0 + SOC, np.full(11, 0.1)))
    (curve,), (band,) = points(svg, "polyline"), points(svg, "polygon")
    assert (np.diff(curve[:, 0]) > 0).all() and (np.diff(curve[:, 1]) < 0).all()
    assert band[:11, 1].max() < curve[0, 1] + 0.1 and len(band) == 22
    texts = {node.text for node in svg.iter("text")}
    assert {"3.0", "4.0", "voltage / V", "state of charge"} <= texts


def test_a_band_ends_where_nothing_can_be_lower() -> None:
    x, y = np.arange(3.0), np.array([1.0, 1.0, 4.0])
    line = Line("", x, y, np.full(3, 2.0), least=0.0)
    assert line.low is not None and line.high is not None
    np.testing.assert_array_equal(line.low, [0.0, 0.0, 2.0])
    np.testing.assert_array_equal(line.high, [3.0, 3.0, 6.0])


def test_a_band_far_wider_than_the_curve_does_not_flatten_it() -> None:
    (curve,) = points(drawn(Line("a", SOC, SOC, np.full(11, 100.0))), "polyline")
    assert np.ptp(curve[:, 1]) > 50.0


def test_what_stands_still_is_a_level_line_and_not_its_last_digit() -> None:
    (curve,) = points(drawn(Line("a", SOC, 3.7 + 1e-12 * np.sin(SOC))), "polyline")
    assert np.ptp(curve[:, 1]) < 0.2


def test_a_curve_is_cut_where_nothing_was_measured() -> None:
    y = SOC.copy()
    y[3] = np.nan
    assert [len(each) for each in points(drawn(Line("a", SOC, y)), "polyline")] == [3, 7]
    nothing = curves("resistance", [Line("a", SOC, np.full(11, np.nan))], X, Y)
    assert isinstance(nothing, str) and "nothing to draw" in nothing


def test_a_long_curve_is_thinned_and_keeps_its_peak() -> None:
    y = np.zeros(100_000)
    y[54_321] = 5.0
    (curve,) = points(drawn(Line("a", np.arange(1e5), y)), "polyline")
    assert len(curve) < 2000 and np.ptp(curve[:, 1]) > 150.0


def test_labels_are_escaped_and_a_legend_stands_where_there_is_a_choice() -> None:
    figure = curves("<b>", [Line("<b>", SOC, SOC), level("limit", SOC, 0.5)], Axis("<i>"), Y)
    assert isinstance(figure, Figure)
    assert "<b>" not in figure.svg and "<i>" not in figure.svg
    assert [(each.label, each.dashed) for each in figure.legend] == [("<b>", False), ("limit", True)]
    single = curves("c", [Line("a", SOC, SOC)], X, Y)
    assert isinstance(single, Figure) and single.legend == ()


def test_bars_are_as_long_as_their_values() -> None:
    svg = ElementTree.fromstring(bars("c", [Bar("before", 10.0, "10 mV"), Bar("after", 2.5, "2.5 mV")], 1.0).svg)
    before, after = (float(bar.attrib["width"]) for bar in svg.iter("rect"))
    assert after / before == pytest.approx(0.25, abs=0.01)
    line, first = next(svg.iter("line")), next(svg.iter("rect"))
    assert (float(line.attrib["x1"]) - float(first.attrib["x"])) / before == pytest.approx(0.1, abs=0.01)


def test_bars_are_cut_to_scale_and_what_is_left_stands_last() -> None:
    columns = [[Piece("capacity", 40.0, 10.0), Piece("left", 10.0, 0.0)], [Piece("left", 20.0, 0.0)]]
    figure = cut_bars("c", columns, (Axis("run"), Axis("error", "mV")))
    heights = [float(each.attrib["height"]) for each in ElementTree.fromstring(figure.svg).iter("rect")]
    assert [each / heights[0] for each in heights] == pytest.approx([1.0, 1.0 / 3.0, 2.0 / 3.0], abs=0.01)
    assert [each.label for each in figure.legend] == ["capacity", "left"]


def test_a_map_has_a_field_for_each_share() -> None:
    figure = heat_map("c", np.array([[0.5, 0.0], [0.25, 0.25]]), ([0.0, 0.5, 1.0], [-1.0, 0.0, 1.0]), ("x", "y"))
    fields = list(ElementTree.fromstring(figure.svg).iter("rect"))
    assert [float(each.attrib["fill-opacity"]) for each in fields] == pytest.approx([1.0, 0.0, 0.707, 0.707], abs=1e-3)


def test_a_network_is_drawn_over_soc_and_temperature_in_both_directions() -> None:
    figures = [part for part in readout_section(hand_network.everything(1)).parts if isinstance(part, Figure)]
    captions = " ".join(each.caption for each in figures)
    assert len(figures) == 4 and "discharge with" in captions and ", charge with" in captions
    for each in figures:
        ElementTree.fromstring(each.svg)


def test_branches_that_do_not_differ_are_told_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    ocv, resistance = tables.tables_of(hand_network.everything(1))
    same = replace(ocv, voltage_V=np.stack([ocv.mean_V, ocv.mean_V]))
    monkeypatch.setattr(tables, "tables_of", lambda _: (same, resistance))
    parts = readout_section(hand_network.everything(1)).parts
    assert any("one open-circuit voltage" in str(each) for each in parts)
    assert not any(isinstance(each, Figure) and "branch" in each.caption for each in parts)


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
