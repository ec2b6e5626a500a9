"""The house itself: no circle among any imports, rooms that are not too full, files and functions that can be read."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("models", "drivers", "simulators", "bench_service")
MOST_LINES, LONGEST, LONG, LONG_SHARE, FULL_ROOM = 300, 60, 30, 0.05, 15
# Loops that are compiled as one piece; the reason stands in each.
COMPILED_LOOP = "njit"
# Folders of plug-ins: one file for each thing there is.
PLUG_INS = {"models/effects", "models/network/signals", "models/design/test_signals", "bench_service/cli/commands"}

FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in FILES}


def imports_of(path: Path) -> set[str]:
    """Modules of this project that a file imports, wherever in it: at the top, in functions, for types."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.add(whole if whole in MODULES else node.module)
    return {name for name in found if name in MODULES}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected parts of more than one member (Tarjan 1972)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in graph[name]:
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            part = []
            while not part or part[-1] != name:
                part.append(stack.pop())
            if len(part) > 1:
                found.append(sorted(part))

    for name in graph:
        if name not in index:
            visit(name)
    return found


def functions(path: Path) -> Iterator[tuple[str, int, bool]]:
    """Name, lines and whether it is compiled, of every function of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            compiled = any(COMPILED_LOOP in ast.unparse(each) for each in node.decorator_list)
            assert node.end_lineno is not None
            yield node.name, node.end_lineno - node.lineno + 1, compiled


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


def test_no_files_import_each_other_in_a_circle() -> None:
    """A package's front door counts as the package: who imports it, imports all that it hands on."""
    assert circles({name: imports_of(path) for name, path in MODULES.items()}) == []


def test_no_rooms_of_models_import_each_other_in_a_circle() -> None:
    def room(name: str) -> str:
        return ".".join(name.split(".")[:2])

    graph: dict[str, set[str]] = {}
    for name, path in MODULES.items():
        if name.startswith("models."):
            graph.setdefault(room(name), set()).update(room(other) for other in imports_of(path))
    graph = {name: {other for other in others if other in graph} - {name} for name, others in graph.items()}
    assert circles(graph) == []


def test_files_and_functions_can_be_read() -> None:
    too_long = {
        str(path.relative_to(ROOT)): n for path in FILES if (n := len(path.read_text().splitlines())) > MOST_LINES
    }
    assert too_long == {}
    every = [(path, *each) for path in FILES for each in functions(path)]
    longest = [
        f"{path.relative_to(ROOT)}:{name} {n}" for path, name, n, compiled in every if n > LONGEST and not compiled
    ]
    assert longest == []
    assert sum(n > LONG for _, _, n, _ in every) <= LONG_SHARE * len(every)


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES if path.is_relative_to(ROOT / "models")}))
def test_a_room_is_not_too_full_and_says_what_it_is_for(folder: Path) -> None:
    door = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
    assert ast.get_docstring(door)
    if str(folder.relative_to(ROOT)) not in PLUG_INS:
        assert len([path for path in folder.glob("*.py") if path.stem != "__init__"]) <= FULL_ROOM
