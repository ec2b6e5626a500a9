"""Findings in words, with the figures that stand in them."""

import numpy as np

from models.diagnosis.answer.explanation import explain, explain_power
from models.diagnosis.evidence.parameters import Value
from models.effects import effect

DROP = effect("series_resistance")
VALUES = {"resistance_Ohm": Value(0.00412, 0.00021, "Ohm")}


def test_a_change_is_told_with_its_value_share_and_rest() -> None:
    words = explain(DROP, 0.873, 1.26, VALUES, (), "change")
    assert words.startswith("Contact or cable resistance has changed: resistance 0.00412 +- 0.0002 Ohm.")
    assert "explains 87 %" in words and "1.3 mV remain" in words
    assert DROP.recognise in words
    assert "cannot tell" not in words and "together with" not in words


def test_what_a_structure_lacks_is_told_so() -> None:
    assert explain(DROP, 0.5, 1.0, VALUES, (), "structure").startswith(
        "Contact or cable resistance is missing in the model:"
    )


def test_a_share_is_never_more_than_all_or_less_than_nothing() -> None:
    assert "explains 100 %" in explain(DROP, 1.7, 1.0, VALUES, (), "change")
    assert "explains 0 %" in explain(DROP, -0.4, 1.0, VALUES, (), "change")


def test_no_more_than_three_rivals_are_named_by_their_titles() -> None:
    words = explain(DROP, 0.5, 1.0, VALUES, ("capacity", "ocv_shape", "hysteresis", "relaxation"), "change")
    assert words.endswith("These data cannot tell it from: capacity, moved open-circuit curve, voltage hysteresis.")


def test_effects_named_before_it_are_told() -> None:
    words = explain(DROP, 0.5, 1.0, VALUES, (), "change", ["hysteresis"])
    assert words.endswith("The error that is left is given together with: voltage hysteresis.")


def test_a_unit_is_told_once_and_none_where_there_is_none() -> None:
    values = {"amplitude_V": Value(0.012, None, "V"), "rate": Value(40.04, 2.0, "1")}
    assert ": amplitude 0.012 V, rate 40 +- 2." in explain(effect("hysteresis"), 0.5, 1.0, values, (), "change")
    entropic = {"dU_dT_V_per_K": Value(3e-4, None, "V/K")}
    assert ": dU dT 0.0003 V/K." in explain(effect("entropic_voltage"), 0.5, 1.0, entropic, (), "change")


def test_what_could_hide_is_told_in_its_own_unit() -> None:
    hidden = [(effect("series_resistance"), 0.00512), (effect("initial_soc"), 0.0131), (effect("dead_time"), np.inf)]
    words = explain_power(hidden)
    assert "contact or cable resistance from 0.0051 Ohm on; " in words
    assert "from 0.013 on; " in words and words.endswith("at no size")


def test_wide_bands_are_plain_numbers() -> None:
    slow = {"time_constant_s": Value(352.0, 12.3, "s")}
    assert "time constant 352 +- 10 s" in explain(effect("relaxation"), 0.5, 1.0, slow, (), "structure")
