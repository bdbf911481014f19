"""The house as the code has it: no import circle, arrows between rooms that point one way, functions one can read."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = "fisheye_ep_calib"
LONGEST_FUNCTION = 60  # lines


@cache
def modules() -> dict[str, ast.Module]:
    """Name → syntax of every module of the package."""
    found = {}
    for path in sorted((ROOT / PACKAGE).rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        found[name] = ast.parse(path.read_text(encoding="utf-8"), str(path))
    return found


@cache
def imports() -> dict[str, set[str]]:
    """Module → modules of the package that it imports: anywhere, in functions and for type checkers too."""
    return {name: imported_by(tree) - {name} for name, tree in modules().items()}


def imported_by(tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports name the package"
            inside = {f"{node.module}.{alias.name}" for alias in node.names}
            # What is imported from a module rather than being one is that module's.
            found |= {name if name in modules() else str(node.module) for name in inside}
    return found & modules().keys()


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """The strongly connected components with more than one member (Tarjan, SIAM J. Computing 1, 1972)."""
    index: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(node: str) -> None:
        index[node] = lowest[node] = len(index)
        stack.append(node)
        for other in sorted(edges.get(node, ())):
            if other not in index:
                visit(other)
            if other in stack:
                lowest[node] = min(lowest[node], lowest[other])
        if lowest[node] == index[node]:
            members = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(members) > 1:
                found.append(sorted(members))

    for node in edges:
        if node not in index:
            visit(node)
    return found


def rooms_of(edges: dict[str, set[str]]) -> dict[str, set[str]]:
    """Room → rooms that its modules import; modules beside the rooms count as rooms."""
    found: dict[str, set[str]] = {}
    for module, known in edges.items():
        if "." in module:
            room = module.split(".")[1]
            found.setdefault(room, set()).update(other.split(".")[1] for other in known if "." in other)
            found[room].discard(room)
    return found


def test_circles_are_found() -> None:
    assert circles({"a": {"b"}, "b": {"c", "d"}, "c": {"a"}, "d": set(), "e": {"a"}}) == [["a", "b", "c"]]


def test_nested_imports_count() -> None:
    tree = ast.parse(f"def f():\n    if x:\n        from {PACKAGE}.camera.fisheye import FisheyeCamera")
    assert imported_by(tree) == {f"{PACKAGE}.camera.fisheye"}


def test_no_module_imports_itself_by_a_detour() -> None:
    assert not circles(imports())


def test_arrows_between_rooms_point_one_way() -> None:
    assert not circles(rooms_of(imports()))


@pytest.mark.parametrize("module", sorted(modules()))
def test_functions_can_be_read_in_one_sitting(module) -> None:
    long = {
        node.name: node.end_lineno - node.lineno + 1
        for node in ast.walk(modules()[module])
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.end_lineno - node.lineno >= LONGEST_FUNCTION
    }
    assert not long


def defined_in(tree: ast.Module) -> set[str]:
    """Names that a module binds at its top, by whatever statement."""
    names = set()
    for node in ast.walk(ast.Module([each for each in tree.body if not isinstance(each, ast.ClassDef)], [])):
        names |= {
            (each.asname or each.name).split(".")[0] for each in getattr(node, "names", ()) if hasattr(each, "name")
        }
        names |= {node.id} if isinstance(node, ast.Name) else set()
        names |= {node.name} if isinstance(node, ast.FunctionDef) else set()
    return names | {node.name for node in tree.body if isinstance(node, ast.ClassDef)}


@pytest.mark.parametrize("folder", ["benchmarks", "docs", "test"])
def test_tests_and_benchmarks_import_what_there_is(folder) -> None:
    """A name that has moved is found here, before the one slow test that imports it."""
    gone = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module in modules():
                inside = defined_in(modules()[node.module])
                gone += [
                    f"{path.relative_to(ROOT)}: {node.module}.{each.name}"
                    for each in node.names
                    if each.name not in inside and f"{node.module}.{each.name}" not in modules()
                ]
    assert gone == []
