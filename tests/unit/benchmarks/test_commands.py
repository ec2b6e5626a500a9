"""Each benchmark finds what it imports when it is started by the command that its description gives."""

import ast
import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[3] / "benchmarks"
COMMAND = re.compile(r"python (-m benchmarks\.|benchmarks/)(\w+)")


def started() -> dict[str, bool]:
    """Benchmarks that tell their command, and whether that is `python -m` (the project's folder is on the path)."""
    found = {}
    for file in sorted(FOLDER.glob("*.py")):
        told = COMMAND.findall(ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "")
        for how, name in told:
            if name == file.stem:
                found[name] = how.startswith("-m")
    return found


def missing(name: str, as_module: bool) -> list[str]:
    """Imports of a benchmark, and of those that it imports, that its way of starting does not find."""
    wrong, seen, left = [], set(), [name]
    while left:
        here = left.pop()
        seen.add(here)
        tree = ast.parse((FOLDER / f"{here}.py").read_text(encoding="utf-8"))
        for module in (node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)):
            package, _, rest = module.partition(".")
            if package in ("benchmarks", "tests") and not as_module:
                wrong.append(f"{here}: {module}")
            elif (FOLDER / f"{package}.py").exists() and as_module:
                wrong.append(f"{here}: {module}")
            sibling = rest if package == "benchmarks" else package
            if (FOLDER / f"{sibling}.py").exists() and sibling not in seen:
                left.append(sibling)
    return wrong


@pytest.mark.parametrize(("name", "as_module"), started().items())
def test_it_finds_what_it_imports(name: str, as_module: bool) -> None:
    assert not missing(name, as_module)


def test_most_of_them_tell_their_command() -> None:
    assert len(started()) > 35


def test_an_import_that_is_not_found_is_seen() -> None:
    assert missing("false_trips", as_module=False) and missing("real_cells", as_module=True)
