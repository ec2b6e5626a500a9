import math

import pytest

from drivers.expression import ExpressionError, parse_expression

CONSTANTS = {"i_nom": 40.0, "v_nom": 80.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.001", 0.001),
        ("-i_nom", -40.0),
        ("i_nom / 52428", 40.0 / 52428),
        ("(v_nom - 3) * 2 + 1e-3", 154.001),
        ("+i_nom/-2", -20.0),
    ],
)
def test_arithmetic(text, value):
    assert parse_expression(text).evaluate(CONSTANTS) == value


def test_names_are_collected():
    assert parse_expression("v_nom*i_nom/2").names == {"v_nom", "i_nom"}


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "i_nom.real",
        "[1][0]",
        "2**9999",
        "1 if i_nom else 2",
        "lambda: 1",
        "True",
        "'a'*9",
        "1j",
        "i_nom < 3",
        "1 // 2",
        "(x := 3)",
        "",
        "1 +",
        "1; 2",
        "\0",
        "1+" * 150 + "1",
        "(" * 199,
    ],
)
def test_everything_else_is_refused(text):
    with pytest.raises(ExpressionError):
        parse_expression(text)


@pytest.mark.parametrize(
    ("text", "constants", "says"),
    [
        ("1/i_nom", {"i_nom": 0.0}, "divides by zero"),
        ("p_nom", {}, "p_nom"),
        ("i_nom", {"i_nom": math.nan}, "not a finite number"),
        ("1e308*10", {}, "not a finite number"),
        ("9" * 199 + "*" + "1", {}, "longer"),
    ],
)
def test_no_finite_value_is_told(text, constants, says):
    with pytest.raises(ExpressionError, match=says):
        parse_expression(text).evaluate(constants)
