"""The house: imports run downward, siblings do not know each other, files stay liveable."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "torchradiometry"
FLOORS = (
    {"quantities", "numerics", "errors", "arguments", "places", "files", "archives"},
    {"geometry", "deploy"},
    {"sources", "materials", "transport", "solve"},
    {"shade"},
    {"scene"},
    {"render"},
    {"plan"},
    {"learn", "reference", "export"},
    {"demo"},
    {"cli"},
    {"__main__"},
)
#: base modules that build on each other
WITHIN_BASE = {
    "numerics": set(),
    "errors": set(),
    "quantities": set(),
    "arguments": {"errors"},
    "places": {"errors"},
    "files": {"errors", "places"},
    "archives": {"errors", "files"},
}
#: an optional library and the only file that may import it
OWNERS = {
    "cv2": "files.py",
    "OpenEXR": "files.py",
    "embreex": "transport/embree.py",
    "onnxruntime": "deploy/runtime.py",
    "pyrender": "reference/",
    "OpenGL": "reference/",
    "onnx": "export/",
    "onnxscript": "export/",
}
MODULES = sorted(PACKAGE.rglob("*.py"))


def relative(path: Path) -> str:
    return path.relative_to(PACKAGE).as_posix()


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def floor(name: str) -> int:
    return next(i for i, rooms in enumerate(FLOORS) if name in rooms)


def imported(tree: ast.AST) -> list[tuple[str, int]]:
    """Every module name that a tree imports, with its line."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"relative import on line {node.lineno}"
            found.append((node.module or "", node.lineno))
    return found


def inside_functions(tree: ast.AST) -> list[ast.AST]:
    functions = [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [statement for function in functions for statement in function.body]


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_imports_run_strictly_downward(path: Path) -> None:
    if path == PACKAGE / "__init__.py":
        return
    own = room(path)
    for name, line in imported(ast.parse(path.read_text())):
        if not name.startswith("torchradiometry."):
            continue
        other = name.split(".")[1]
        if other == own:
            continue
        allowed = floor(other) < floor(own) or other in WITHIN_BASE.get(own, ())
        assert allowed, f"{relative(path)}:{line} imports {name}: {other} is not below {own}"


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_own_modules_are_never_imported_inside_a_function(path: Path) -> None:
    for statement in inside_functions(ast.parse(path.read_text())):
        for name, line in imported(statement):
            assert not name.startswith("torchradiometry"), f"{relative(path)}:{line}"


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_an_optional_library_is_imported_only_by_its_owner(path: Path) -> None:
    for name, line in imported(ast.parse(path.read_text())):
        owner = OWNERS.get(name.split(".")[0])
        assert owner is None or relative(path).startswith(owner), f"{relative(path)}:{line} {name}"


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_files_and_functions_stay_liveable(path: Path) -> None:
    text = path.read_text()
    assert text.count("\n") <= 400
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            length = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            assert length <= 60, f"{relative(path)}:{node.lineno} {node.name}: {length} lines"


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_epsilons_live_in_numerics(path: Path) -> None:
    if path.name == "numerics.py":
        return
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Constant) and isinstance(node.value, float):
            assert node.value == 0 or abs(node.value) > 1e-6, f"{relative(path)}:{node.lineno}"


def test_deploy_never_touches_torch() -> None:
    for path in sorted((PACKAGE / "deploy").rglob("*.py")):
        names = {name.split(".")[0] for name, _ in imported(ast.parse(path.read_text()))}
        assert "torch" not in names, relative(path)
