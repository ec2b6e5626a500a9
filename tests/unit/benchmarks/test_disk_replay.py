"""What a disk holds after a power cut, by a trace of calls."""

import random
from pathlib import Path

from benchmarks.disk_replay import PAGE, Disk, Operation, operations

ROOT = "/disk/data"
FILE, OTHER = f"{ROOT}/a", f"{ROOT}/b"


def left(disk: Disk, folder: Path, torn: random.Random | None = None) -> dict[str, bytes]:
    disk.after_cut(folder, torn)
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def disk_after(*calls: Operation) -> Disk:
    disk = Disk(Path(ROOT))
    for call in calls:
        disk.apply(call)
    return disk


SYNCED = (
    Operation("create", FILE),
    Operation("write", FILE, 0, b"first"),
    Operation("sync", FILE),
    Operation("sync", ROOT),
)


def test_what_was_synced_is_there_and_no_more(tmp_path: Path) -> None:
    disk = disk_after(*SYNCED, Operation("write", FILE, 5, b"second"), Operation("create", OTHER))
    assert left(disk, tmp_path / "cut") == {"a": b"first"}


def test_a_name_needs_its_folder_to_be_synced(tmp_path: Path) -> None:
    assert left(disk_after(*SYNCED[:3]), tmp_path / "cut") == {}


def test_a_renamed_file_has_its_old_name_until_then(tmp_path: Path) -> None:
    disk = disk_after(*SYNCED, Operation("rename", FILE, to=OTHER))
    assert left(disk, tmp_path / "before") == {"a": b"first"}
    disk.apply(Operation("sync", ROOT))
    assert left(disk, tmp_path / "after") == {"b": b"first"}


def test_pages_that_were_not_synced_survive_by_chance(tmp_path: Path) -> None:
    disk = disk_after(*SYNCED, Operation("write", FILE, 0, b"x" * 3 * PAGE))
    found = {left(disk, tmp_path / str(seed), random.Random(seed)).get("a") for seed in range(40)}
    assert b"first" in found and b"x" * 3 * PAGE in found and len(found) == 2**3
    assert all(page is not None and set(page) <= set(b"firstx\0") for page in found)


def test_a_shorter_file(tmp_path: Path) -> None:
    disk = disk_after(*SYNCED, Operation("truncate", FILE, 2), Operation("sync", FILE))
    assert left(disk, tmp_path / "cut") == {"a": b"fi"}


def hexed(text: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in text.encode())


def test_a_trace_is_read_with_calls_that_others_interrupt(tmp_path: Path) -> None:
    path, folder = hexed(FILE), hexed(ROOT)
    trace = tmp_path / "trace"
    trace.write_text(
        f'7  openat(AT_FDCWD<{folder}>, "{path}", O_RDWR|O_CREAT|O_CLOEXEC, 0600) = 5<{path}>\n'
        f'7  pwrite64(5<{path}>, "{hexed("one")}", 3, 4096 <unfinished ...>\n'
        f"8  fsync(6<{folder}>) = 0\n"
        f"7  <... pwrite64 resumed>) = 3\n"
        f'7  openat(AT_FDCWD<{folder}>, "{path}", O_RDONLY) = -1 ENOENT (No such file or directory)\n'
        f'9  write(5<{path}>, "{hexed("ab")}", 2) = 2\n'
        f'9  write(5<{path}>, "{hexed("c")}", 1) = 1\n'
        f"7  fdatasync(5<{path}>) = 0\n"
        f"7  +++ exited with 0 +++\n"
    )
    assert list(operations(trace)) == [
        Operation("create", FILE),
        Operation("sync", ROOT),
        Operation("write", FILE, 4096, b"one"),
        Operation("write", FILE, 0, b"ab"),
        Operation("write", FILE, 2, b"c"),
        Operation("sync", FILE),
    ]
