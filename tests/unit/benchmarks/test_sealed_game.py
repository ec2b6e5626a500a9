"""Sealed games meet each mode with each chemistry, and are judged by their bars."""

from benchmarks.sealed_game import CELLS, MODES, summary, turn

ROW = {
    "state": "completed",
    "opened": True,
    "truth": "capacity",
    "named": "capacity",
    "parameters": {"capacity_Ah": 2.0},
}
GOOD = ROW | {"after_mV": 1.1, "truth_mV": 1.1}


def test_each_mode_meets_each_chemistry() -> None:
    games = [turn(number, 100, list(MODES)) for number in range(6)]
    assert {game[:2] for game in games} == {(mode, cell) for mode in MODES for cell in CELLS}
    assert [game[2] for game in games] == list(range(100, 106))
    assert turn(1, 7, ["change"]) == ("change", "lfp", 8)


def test_one_of_ten_may_be_named_wrongly_if_it_leaves_no_more_than_the_truth() -> None:
    other = GOOD | {"named": "ocv_shape", "after_mV": 1.2}
    assert summary([GOOD] * 9 + [other]) == {
        "games": 10,
        "completed": 10,
        "right": 9,
        "named": 10,
        "added": 10,
        "worth": 10,
        "held": True,
    }
    assert not summary([GOOD] * 8 + [other] * 2)["held"]
    assert not summary([GOOD] * 9 + [other | {"after_mV": 1.3}])["held"]


def test_a_game_that_did_not_end_or_whose_seal_is_wrong_is_seen() -> None:
    for bad in ({"state": "failed"}, {"opened": False}, {"parameters": {}}, {"named": None, "truth_mV": None}):
        assert not summary([GOOD] * 19 + [GOOD | bad])["held"]
    assert summary([GOOD, {"state": "not within 1800 s"}])["completed"] == 1
