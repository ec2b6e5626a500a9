"""A service that a command runs itself: it must end whenever the command is told to."""

import threading
from pathlib import Path

import pytest

from bench_service.cli.errors import UsageError
from bench_service.cli.service import _OwnService, check_data_dir
from bench_service.config import ServiceConfig
from tests.patience import PATIENCE_S


class InterruptedWait(threading.Event):
    """Ctrl-C comes while the start is waited for."""

    def wait(self, timeout: float | None = None) -> bool:
        raise KeyboardInterrupt


@pytest.mark.timeout(PATIENCE_S)
def test_ctrl_c_before_the_service_has_its_loop_ends_it(tmp_path: Path) -> None:
    service = _OwnService(ServiceConfig(data_dir=tmp_path / "data"))
    stopping = threading.Event()

    def late() -> None:
        """Get to the loop only after the order to end."""
        assert stopping.wait(PATIENCE_S / 2)
        service._main()

    def join(timeout: float | None = None) -> None:
        stopping.set()
        threading.Thread.join(thread, timeout)

    thread = threading.Thread(target=late, daemon=True)
    thread.join = join
    service._thread, service._answered = thread, InterruptedWait()
    with pytest.raises(KeyboardInterrupt):
        service.__enter__()
    assert not thread.is_alive()
    assert not (tmp_path / "data").exists()


def test_a_data_directory_must_be_able_to_be_one(tmp_path: Path) -> None:
    check_data_dir(tmp_path / "new" / "deeper")
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(UsageError, match="is not a directory; choose another"):
            check_data_dir(path)
