"""Kinds of argument values."""

from argparse import ArgumentTypeError
from collections.abc import Callable

import pytest

from bench_service.cli.arguments import fraction, fractions, named_numbers, names, natural, number, port, positive


def test_values() -> None:
    assert number("-1.5e3") == -1500.0
    assert positive("0.1") == 0.1
    assert fraction("1") == 1.0
    assert fractions("0.5,1") == (0.5, 1.0)
    assert names("hysteresis, relaxation") == ("hysteresis", "relaxation")
    assert natural("7") == 7
    assert port("0") == 0
    assert named_numbers("a=1, b=-0.5,") == {"a": 1.0, "b": -0.5}
    assert named_numbers("") == {}


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (number, "nan"),
        (number, "inf"),
        (number, "1,5"),
        (positive, "0"),
        (positive, "-1"),
        (fraction, "1.01"),
        (fraction, "-0.1"),
        (fractions, "0.5,"),
        (names, "a,,b"),
        (names, ""),
        (natural, "-1"),
        (natural, "1.0"),
        (natural, "²"),
        (port, "65536"),
        (named_numbers, "a"),
        (named_numbers, "=1"),
        (named_numbers, "a=x"),
        (named_numbers, "a=1,a=2"),
    ],
)
def test_refused(kind: Callable[[str], object], text: str) -> None:
    with pytest.raises(ArgumentTypeError):
        kind(text)
