"""A hidden effect is drawn once, stays what it is, and is told only when its seal is opened."""

import hashlib
import json
from pathlib import Path

import pytest

from bench_service.campaign.seal import Seal
from bench_service.cli.errors import UsageError
from bench_service.cli.sealed_effect import sealed_effect


def test_a_seal_holds_from_one_start_to_the_next(tmp_path: Path) -> None:
    path = tmp_path / "game.json"
    first = sealed_effect("random", "nmc", 7, path)
    assert sealed_effect("random", "nmc", 7, path) == first
    # Another wish is another seal.
    other = sealed_effect("random", "nmc", 8, path)
    assert other.seal != first.seal and sealed_effect("random", "nmc", 8, path) == other


def test_without_a_file_nothing_is_kept() -> None:
    first, again = (sealed_effect("hysteresis", "nmc", 7, None) for _ in range(2))
    assert (first.name, first.value) == (again.name, again.value) and first.salt != again.salt


def test_it_is_told_when_it_is_opened_and_fits_what_was_said_before(tmp_path: Path) -> None:
    path = tmp_path / "game.json"
    hidden = sealed_effect("hysteresis", "lfp", 3, path)
    closed = Seal.read(path)
    assert closed.to_json() == {"sha256": hidden.seal, "opened": None}
    assert hidden.name not in json.dumps(closed.to_json())
    told = closed.open().opened
    assert told is not None
    assert (told["effect"], told["value"], told["unit"]) == ("hysteresis", hidden.value, "V")
    assert hashlib.sha256(told["contents"].encode()).hexdigest() == closed.sha256
    # Open is open, also after a restart of bench and service.
    sealed_effect("hysteresis", "lfp", 3, path)
    assert Seal.read(path).opened == told == Seal.read(path).open().opened


def test_what_cannot_be_hidden_or_read_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="phlogiston"):
        sealed_effect("phlogiston", "nmc", 1, tmp_path / "game.json")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "game.json").write_text("{}")
    with pytest.raises(UsageError, match=r"game.json: holds no sealed effect"):
        sealed_effect("random", "nmc", 1, tmp_path / "game.json")
