"""A compiled function never runs the former code of one that it calls."""

import ast
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import models
from models.compiled_cache import keep_apart, source_files, stamp

ROOT = Path(models.__file__).parent
CALLER = """
from numba import njit
from models.callee import number

@njit(cache=True)
def twice():
    return 2 * number()
"""
CALLEE = """
from numba import njit

@njit(cache=True)
def number():
    return {}
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A small package of the same name with a compiled function that calls one of another file."""
    small = tmp_path / "models"
    small.mkdir()
    for name in ("__init__.py", "compiled_cache.py"):
        (small / name).write_text((ROOT / name).read_text())
    (small / "caller.py").write_text(CALLER)
    (small / "callee.py").write_text(CALLEE.format(21))
    return small


def _run(package: Path, program: str, **environment: str) -> str:
    inherited = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA_", "COV"))}
    answer = subprocess.run(
        [sys.executable, "-c", program],
        cwd=package.parent,
        env=inherited | {"PYTHONPATH": str(package.parent)} | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    return answer.stdout.strip()


def test_an_edit_in_a_callee_reaches_its_caller(package: Path) -> None:
    program = "from models.caller import twice; print(twice(), sum(twice.stats.cache_hits.values()))"
    assert _run(package, program) == "42 0"
    assert _run(package, program) == "42 1"
    (package / "callee.py").write_text(CALLEE.format(50))
    assert _run(package, program) == "100 0"
    (package / "callee.py").write_text(CALLEE.format(21))
    assert _run(package, program) == "42 1"
    assert not list(package.glob("__pycache__/*.nb*"))


def test_a_users_own_folder_stays_and_an_inherited_one_does_not(package: Path, tmp_path: Path) -> None:
    program = "import os, sys, models; print(os.environ['NUMBA_CACHE_DIR'], 'numba' in sys.modules)"
    own = str(tmp_path / "own")
    assert _run(package, program, NUMBA_CACHE_DIR=own) == f"{own} False"
    chosen = str(package / "__pycache__" / f"numba-{stamp(str(package))}")
    assert _run(package, program, NUMBA_CACHE_DIR=str(package / "__pycache__" / "numba-0123")) == f"{chosen} False"
    assert _run(package, program, NUMBA_CACHE_DIR="/elsewhere/models/__pycache__/numba-0123") == f"{chosen} False"


def test_where_nothing_can_be_written_numba_chooses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "__pycache__").write_text("a file")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    keep_apart(str(tmp_path))
    assert "NUMBA_CACHE_DIR" not in os.environ


def test_folders_that_nobody_has_asked_for_in_a_week_go(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(package / "__pycache__" / "numba-0"))
    ages = {"numba-old": 8.0, "numba-new": 6.0, "other-old": 8.0}
    for name, days in ages.items():
        folder = package / "__pycache__" / name
        folder.mkdir(parents=True)
        (folder / "index").touch()
        os.utime(folder, (time.time() - 86400.0 * days,) * 2)
    keep_apart(str(package))
    left = sorted(path.name for path in (package / "__pycache__").iterdir())
    assert left == sorted(["numba-new", f"numba-{stamp(str(package))}", "other-old"])


def test_each_file_that_compiled_functions_take_something_from_counts() -> None:
    counted = {Path(path) for path in source_files(str(ROOT)) if "njit" in Path(path).read_text()}
    assert len(counted) > 30
    for path in sorted(counted):
        for name, source in _taken_in(path).items():
            assert source in counted, (
                f"{path.relative_to(ROOT)} takes {name} into a compiled function, but {source.relative_to(ROOT)} does "
                "not say so: name njit in its text, or a change there is not compiled anew"
            )


def _taken_in(path: Path) -> dict[str, Path]:
    """Names that compiled functions of a file load and that another file of the package defines, with that file."""
    tree = ast.parse(path.read_text())
    loaded: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and any("njit" in ast.unparse(each) for each in node.decorator_list):
            loaded |= _names(node)
    # Constants of the file are made of others.
    for _ in range(3):
        for node in tree.body:
            if isinstance(node, ast.Assign) and loaded & {n for target in node.targets for n in _names(target)}:
                loaded |= _names(node.value)
    found = {}
    for name in loaded:
        source = _definition(path, name)
        if source != path:
            found[name] = source
    return found


def _names(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def _definition(path: Path, name: str) -> Path:
    """File of the package that a name of a file comes from in the end; the file itself where it is not imported."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "models":
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    folder = ROOT.parent.joinpath(*node.module.split("."))
                    for module in (folder / f"{alias.name}.py", folder / alias.name / "__init__.py"):
                        if module.exists():
                            return module
                    package = folder / "__init__.py"
                    return _definition(package if package.exists() else folder.with_suffix(".py"), alias.name)
    return path
