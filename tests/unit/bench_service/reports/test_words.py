"""Words and rounded figures: what a reader sees of numbers, ranges, times and names."""

from datetime import UTC, datetime

import pytest

from bench_service.reports import words


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "–"), (float("nan"), "–"), (0.0, "0"), (1234.5, "1234"), (0.01234, "0.0123"), (-2.5, "−2.50"),
     (8.333e-08, "8.33 · 10⁻⁸"), (-1.5e9, "−1.50 · 10⁹")],
)  # fmt: skip
def test_a_number_has_no_e(value: float | None, text: str) -> None:
    assert words.number(value) == text


@pytest.mark.parametrize(
    ("value", "unit", "std", "text"),
    [(0.018, "V", 0.001, "18.0 ± 1.0 mV"), (2.33267, "Ah", 0.0096, "2.3327 ± 0.0096 Ah"),
     (0.0043, "Ohm", None, "4.30 mΩ"),
     (8.3e-8, "Ah", None, "83.0 nAh"), (3.06, "K/W", None, "3.06 K/W"), (0.02, "1", None, "0.0200"),
     (-0.0064, "A", None, "−6.40 mA"), (None, "V", None, "–"), (31.2, "degC", None, "31.2 °C")],
)  # fmt: skip
def test_a_quantity_has_its_unit_and_no_more_digits_than_are_known(
    value: float | None, unit: str, std: float | None, text: str
) -> None:
    assert words.quantity(value, unit, std) == text


@pytest.mark.parametrize(
    ("name", "ends", "unit", "text"),
    [("soc", (0.2, 0.4), "1", "20 to 40 %"), ("soc", (0.2171, 0.2234), "1", "21.7 to 22.3 %"),
     ("soc", (0.22, 0.22), "1", "22 to 22 %"), ("direction", (-1.0, -1.0), "sign", "after a discharge"),
     ("throughput_Ah", (8.333e-08, 0.9508), "Ah", "0.000 to 0.951 Ah"),
     ("current_A", (-0.0039, 0.004), "A", "−3.90 to 4.00 mA"),
     ("since_step_s", (0.0, 9.0), "s", "0 s to 9 s"), ("temperature_degC", (-5.0, 25.0), "degC", "−5.0 to 25.0 °C")],
)  # fmt: skip
def test_a_range_is_rounded_to_what_tells_its_ends_apart(
    name: str, ends: tuple[float, float], unit: str, text: str
) -> None:
    assert words.between(name, ends, unit) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.06, "0.06 s"), (1.0, "1 s"), (65.0, "65 s"), (1800.0, "30 min"), (15000.0, "4 h 10 min"), (10800.0, "3 h"),
     (1209600.0, "14 days"), (302400.0, "3.5 days"), (None, "–")],
)  # fmt: skip
def test_a_time_is_as_a_person_says_it(seconds: float | None, text: str) -> None:
    assert words.duration(seconds) == text


def test_dates_are_told_once_where_they_are_of_one_day() -> None:
    first, later, next_day = "2026-01-02T03:04:05.0Z", "2026-01-02T13:04:05.0Z", "2026-01-03T00:00:00.0Z"
    assert words.span([None, later, first]) == "2026-01-02 03:04 to 13:04 UTC"
    assert words.span([first, next_day]) == "2026-01-02 03:04 UTC to 2026-01-03 00:00 UTC"
    assert words.span([first]) == "2026-01-02 03:04 UTC" and words.span([None]) is None
    made = words.made_by("1.2", datetime(2026, 1, 2, 3, 4, tzinfo=UTC))
    assert made == "Made 2026-01-02 03:04 UTC by bench-service 1.2."


def test_a_sentence_loses_the_names_of_the_program_but_not_those_that_people_gave() -> None:
    text = "series_resistance of 'bench_a' at 25 degC is the model's, +- 3 mOhm; the cell's own_part"
    assert words.told(text) == "series resistance of 'bench_a' at 25 °C is the model's, ± 3 mΩ; the cell's own part"


def test_effects_have_their_titles_and_unknown_ones_words() -> None:
    assert words.effect("series_resistance") == "Contact or cable resistance"
    assert words.effect("new_thing") == "New thing"


def test_errors_and_shares() -> None:
    assert (words.millivolts(12.345), words.millivolts(-0.001), words.millivolts(None)) == ("12.3 mV", "0.00 mV", "–")
    assert (words.percent(0.123), words.percent(0.12345, 2), words.count(15001)) == ("12 %", "12.35 %", "15\u202f001")
    assert words.listed(["a", "b", "c"]) == "a, b and c" and words.listed([]) == "" and words.listed(["a"]) == "a"
