"""When a token is needed, where it is kept, and that nobody else reads the data."""

import stat
from contextlib import closing
from pathlib import Path

import pytest

from bench_service.config.reading import ConfigError
from bench_service.config.token import TOKEN_FILE, is_loopback, read_token, service_token
from bench_service.store.metadata import MetadataStore
from bench_service.store.private import make_private_directory
from bench_service.store.sample_writer import SampleWriter
from tests.unit.bench_service.store.sample_rig import commit

EVERYWHERE = "0.0.0.0"  # noqa: S104


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize(
    ("host", "own"),
    [("127.0.0.1", True), ("127.1.2.3", True), ("localhost", True), ("::1", True), ("[::1]", True)]
    + [(EVERYWHERE, False), ("::", False), ("", False), ("192.168.1.5", False), ("lab.example", False)],
)
def test_what_is_this_machine_alone(host: str, own: bool) -> None:
    assert is_loopback(host) is own


def test_on_this_machine_none_is_needed_and_beyond_it_one_is_made_and_kept(tmp_path: Path) -> None:
    assert service_token(tmp_path, "127.0.0.1", {}) is None and read_token(tmp_path) is None
    token = service_token(tmp_path, EVERYWHERE, {})
    assert token is not None and len(token) >= 32
    assert service_token(tmp_path, EVERYWHERE, {}) == read_token(tmp_path) == token
    assert mode(tmp_path / TOKEN_FILE) == 0o600


def test_the_environment_names_one_wherever_the_service_listens(tmp_path: Path) -> None:
    assert service_token(tmp_path, "127.0.0.1", {"BENCH_TOKEN": "x" * 20}) == "x" * 20
    for bad in ("", "short", "with space in it, and long"):
        with pytest.raises(ConfigError, match="is no token"):
            service_token(tmp_path, EVERYWHERE, {"BENCH_TOKEN": bad})


def test_without_a_token_it_does_not_listen(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="does not listen on 0.0.0.0"):
        service_token(tmp_path / "not there", EVERYWHERE, {})


def test_data_can_be_read_by_their_owner_alone(tmp_path: Path) -> None:
    data = tmp_path / "deep" / "data"
    with closing(MetadataStore.open(data)) as store, closing(SampleWriter.open(data)) as writer:
        store.events.add("info", "code", "text")
        commit(writer, "r", 0, 10)
        assert mode(data) == 0o700
        files = [path for path in data.iterdir() if path.is_file()]
        assert len(files) >= 6 and {mode(path) for path in files} == {0o600}


def test_what_was_open_to_all_is_closed_and_a_foreign_directory_is_left_alone(tmp_path: Path) -> None:
    old, home = tmp_path / "old", tmp_path / "home"
    for path, name in ((old, "meta.sqlite"), (home, "letters.txt")):
        path.mkdir()
        (path / name).write_bytes(b"")
        (path / name).chmod(0o644)
        path.chmod(0o755)
    MetadataStore.open(old).close()
    assert (mode(old), mode(old / "meta.sqlite")) == (0o700, 0o600)
    make_private_directory(home, "meta.sqlite")
    assert mode(home) == 0o755
