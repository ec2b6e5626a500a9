"""An option that is given twice adds to what it was given before."""

from argparse import ArgumentParser
from pathlib import Path

import pytest

from bench_service.cli.commands import add_effect, compare, fit, learn, refit


def test_a_state_of_charge_for_each_run() -> None:
    parser = ArgumentParser()
    fit.COMMAND.arguments(parser)
    words = ["a.csv", "b.csv", "--capacity-Ah", "1", "--out", "m.json", "--initial-soc", "0.9", "--initial-soc", "0.5"]
    assert parser.parse_args(words).initial_soc == [0.9, 0.5]


@pytest.mark.parametrize(
    ("module", "words", "name", "found"),
    [
        (fit, ("a.csv", "--capacity-Ah", "1", "--out", "m.json"), "--without", ["x", "y", "z"]),
        (compare, ("m.json", "a.csv"), "--baseline", ["x", "y", "z"]),
        (fit, ("a.csv", "--capacity-Ah", "1", "--out", "m.json"), "--validate", [Path("x,y"), Path("z")]),
        (compare, ("m.json", "a.csv"), "--train", [Path("x,y"), Path("z")]),
        (learn, ("m.json", "a.csv", "--out", "n.json"), "--validate", [Path("x,y"), Path("z")]),
        (refit, ("m.json", "a.csv", "--out", "n.json"), "--validate", [Path("x,y"), Path("z")]),
        (
            add_effect,
            ("m.json", "hysteresis", "--validate", "v.csv", "--out", "n.json"),
            "--train",
            [Path("x,y"), Path("z")],
        ),
    ],
)
def test_it_adds_up(module, words: tuple[str, ...], name: str, found: list) -> None:
    parser = ArgumentParser()
    module.COMMAND.arguments(parser)
    for _ in range(2):  # The defaults are not what is added to.
        given = vars(parser.parse_args([*words, name, "x,y", name, "z"]))
        assert given[name.removeprefix("--").replace("-", "_")] == found
