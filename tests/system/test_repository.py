"""What the repository says of itself, held against what is there: commands, options, files, addresses, versions."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from argparse import ArgumentParser
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

from bench_service.app.application import create_app
from bench_service.cli.command import find_commands
from bench_service.config import ServiceConfig
from tests.patience import PATIENCE_S

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
README = (ROOT / "README.md").read_text(encoding="utf-8")
FOLDERS = ("bench_service", "drivers", "models", "simulators", "tests", "benchmarks", "docs", ".ci")
TEXT = {".py", ".md", ".toml", ".js", ".css", ".html", ".svg", ".yaml", ".lock", ".json", ""}
# Where the lines of a shell block begin that are ours; "make" and "bench-service" may stand behind other commands.
COMMAND = re.compile(r"bench-service +([a-z][a-z-]*)((?: +[^\s`|#]+)*)")
# A folder of one machine. Written in parts, so that this file does not find itself.
MACHINE = re.compile(
    r"(?<![\w./~-])/(?:"
    + "|".join(("ro" + "ot", "ho" + "me", "Us" + "ers", "wo" + "rk", "tm" + "p", "op" + "t"))
    + r")/"
)


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.fixture(scope="module")
def lock() -> dict[str, list[Requirement]]:
    """Pinned packages by normalised name; one may have several pins with markers."""
    found: dict[str, list[Requirement]] = {}
    for entry in _entries():
        requirement = Requirement(entry.split(" --hash")[0])
        found.setdefault(_normalised(requirement.name), []).append(requirement)
    return found


def _entries() -> list[str]:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    lines = [line.split("#")[0].rstrip() for line in text.replace("\\\n", " ").splitlines()]
    return [re.sub(r"\s+", " ", line) for line in lines if line.strip()]


def _normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _files() -> list[Path]:
    listed = [path for folder in FOLDERS for path in (ROOT / folder).rglob("*")]
    listed += [path for path in ROOT.iterdir() if path.suffix in {".md", ".toml", ".lock", ".yaml"}]
    listed += [ROOT / "Makefile"]
    skipped = {"__pycache__", "vendor", ".numba_cache"}
    return [p for p in listed if p.is_file() and p.suffix in TEXT and not skipped & set(p.parts)]


def _parser(name: str) -> ArgumentParser:
    parser = ArgumentParser(prog=name)
    parser.add_argument("--json")
    parser.add_argument("--traceback")
    next(command for command in find_commands() if command.name == name).arguments(parser)
    return parser


def _shell_lines() -> list[str]:
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    return [line.strip() for block in blocks for line in block.replace("\\\n", " ").splitlines() if line.strip()]


def test_no_path_of_one_machine_is_left() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path in _files()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if MACHINE.search(line)
    ]
    assert found == []


def test_every_command_is_in_the_readme_and_the_other_way_round() -> None:
    help_text = subprocess.run(
        [sys.executable, "-m", "bench_service.cli", "--help"],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE_S,
    ).stdout
    known = {command.name for command in find_commands()}
    assert all(re.search(rf"^ +{name}\b", help_text, re.MULTILINE) for name in known)
    assert set(re.findall(r"^\| `bench-service ([a-z-]+)`", README, re.MULTILINE)) == known
    shown = {match.group(1) for path in DOCUMENTS for match in COMMAND.finditer(path.read_text(encoding="utf-8"))}
    assert shown <= known


def test_every_option_that_the_readme_shows_exists() -> None:
    checked = 0
    for match in COMMAND.finditer("\n".join(_shell_lines())):
        known = {option for action in _parser(match.group(1))._actions for option in action.option_strings}
        given = {word.split("=")[0] for word in match.group(2).split() if word.startswith("-")}
        assert given <= known, f"bench-service {match.group(1)}: {sorted(given - known)}"
        checked += len(given)
    assert checked > 10


def test_every_make_target_that_the_readme_shows_exists() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    shown = set(re.findall(r"(?:^|`)make (?:[A-Z]+=\S+ )*([a-z]+)", "\n".join([*_shell_lines(), README]), re.MULTILINE))
    assert {"demo", "test", "lint"} <= shown <= targets


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_what_a_document_points_to_is_there(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link and not link.startswith("#")]
    places = re.findall(r"`((?:bench_service|drivers|models|simulators|tests|benchmarks|docs)/[\w./-]*)`", text)
    missing = [link for link in links if not (path.parent / link.split("#")[0]).exists()]
    assert missing + [place for place in places if not (ROOT / place).exists()] == []


def test_the_map_of_the_house_names_what_is_there() -> None:
    house = re.search(r"## Map of the house\n```\n(.*?)```", README, re.DOTALL)
    assert house is not None
    room, missing = "", []
    for line in house.group(1).splitlines():
        name = line.split()[0]
        room = room if line.startswith(" ") else name
        missing += [name] if not (ROOT / (room if name == room else room + name)).exists() else []
    assert missing == []


def test_the_rest_page_lists_the_addresses_that_are_served(tmp_path: Path) -> None:
    served = {
        f"{method.upper()} {address}"
        for address, methods in create_app(ServiceConfig(data_dir=tmp_path)).openapi()["paths"].items()
        for method in methods
    }
    text = (ROOT / "docs" / "rest.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `([A-Z]+ /\S+)`", text, re.MULTILINE)) == served


def test_installed_version_and_change_log_agree(project: dict[str, Any]) -> None:
    assert version("bench-service") == project["version"]
    headings = re.findall(r"^## \[?([\w.]+)\]?", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert headings[0] == "Unreleased" or headings[0] == project["version"]


def test_the_lock_pins_everything_with_hashes_and_names_no_host() -> None:
    pinned = re.compile(r"[\w.-]+(\[[\w, -]+\])?==[\w.+!]+( ; [^-]+?)?( --hash=sha256:[0-9a-f]{64})+")
    for entry in _entries():
        assert pinned.fullmatch(entry), entry[:80]
    assert "://" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")


def test_the_lock_meets_what_the_project_asks_for(project: dict[str, Any], lock: dict[str, list[Requirement]]) -> None:
    asked = [Requirement(text) for text in [*project["dependencies"], *project["optional-dependencies"]["dev"]]]
    for requirement in asked:
        pins = lock.get(_normalised(requirement.name), [])
        assert pins, f"{requirement.name} is not in requirements.lock"
        for pin in pins:
            (pinned,) = pin.specifier
            assert requirement.specifier.contains(Version(pinned.version)), f"{requirement} against {pin}"


def test_what_a_package_asks_for_with_extras_is_pinned_with_them(lock: dict[str, list[Requirement]]) -> None:
    # pip looks for "name[extra]" apart from "name": without a pin it meets the newest one, which has no hash here, as
    # soon as there is a newer one than the lock's.
    asked = [Requirement(text) for name in lock for text in _requires(name)]
    with_extras = [
        each for each in asked if each.extras and (each.marker is None or each.marker.evaluate({"extra": ""}))
    ]
    assert with_extras
    for each in with_extras:
        assert all(each.extras <= pin.extras for pin in lock[_normalised(each.name)]), f"{each} is not pinned as asked"


def _requires(name: str) -> list[str]:
    try:
        return requires(name) or []
    except PackageNotFoundError:
        # Of another platform or another Python.
        return []


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13"])
@pytest.mark.parametrize("machine", ["x86_64", "aarch64"])
def test_the_lock_has_one_version_of_each_package_for_each_python(
    lock: dict[str, list[Requirement]], python: str, machine: str
) -> None:
    environment = {
        "python_version": python,
        "python_full_version": f"{python}.1",
        "platform_machine": machine,
        "sys_platform": "linux",
        "platform_system": "Linux",
        "os_name": "posix",
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
    }
    for name, pins in lock.items():
        fitting = [pin for pin in pins if pin.marker is None or pin.marker.evaluate(environment)]
        assert len(fitting) <= 1, f"{name}: {fitting}"
        if any(pin.marker is None or "platform" not in str(pin.marker) for pin in pins):
            assert fitting, f"{name} has no version for Python {python} on {machine}"
