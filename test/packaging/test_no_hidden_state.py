"""Importing the package changes nothing in the process, and nothing reaches into another library."""

from __future__ import annotations

import ast
import gc
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import fisheye_ep_calib
from fisheye_ep_calib import cli

PACKAGE = Path(fisheye_ep_calib.__file__).parent
MODULES = sorted(
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
    for path in PACKAGE.rglob("*.py")
)
CORE = [module for module in MODULES if not module.startswith("fisheye_ep_calib.ros")]
HAS_LAUNCH = importlib.util.find_spec("launch_ros") is not None  # not on PyPI
ROS = [
    module
    for module in MODULES
    if module.startswith("fisheye_ep_calib.ros") and (HAS_LAUNCH or not module.endswith(".launching"))
]

# Libraries are loaded before the first look: what they do to the process is theirs.
CHANGES = """
import importlib, json, locale, logging, multiprocessing, os, random, signal, sys, threading, warnings
for name in ("cv2", "matplotlib", "numpy", "scipy.optimize", "jinja2", "rclpy", "distributed"):
    if importlib.util.find_spec(name):
        importlib.import_module(name)
import cv2, matplotlib, numpy

def state():
    loggers = [logging.root, *(logging.getLogger(name) for name in sorted(logging.root.manager.loggerDict))]
    return {
        "environment": dict(os.environ),
        "folder": os.getcwd(),
        "path": sys.path[:],
        "signals": {int(number): repr(signal.getsignal(number)) for number in signal.valid_signals()},
        "blocked signals": sorted(map(int, signal.pthread_sigmask(signal.SIG_BLOCK, []))),
        "threads": [thread.name for thread in threading.enumerate()],
        "children": [child.name for child in multiprocessing.active_children()],
        "start method": multiprocessing.get_start_method(allow_none=True),
        "logging": [[one.name, one.level, repr(one.handlers)] for one in loggers if one.level or one.handlers],
        "opencv": [cv2.getNumThreads(), cv2.useOptimized()],
        "matplotlib": {key: repr(dict.__getitem__(matplotlib.rcParams, key)) for key in sorted(matplotlib.rcParams)},
        "pyplot": "matplotlib.pyplot" in sys.modules,
        "numpy": [repr(numpy.geterr()), repr(numpy.get_printoptions())],
        "random": [repr(random.getstate()), repr(numpy.random.get_state())],
        "locale": locale.setlocale(locale.LC_ALL),
        "hooks": [repr(sys.excepthook), repr(threading.excepthook)],
        "stdout": [sys.stdout.errors, sys.stderr.errors],
    }

before = state()
for name in sys.argv[1:]:
    importlib.import_module(name)
after = state()
print(json.dumps({key: [before[key], after[key]] for key in before if before[key] != after[key]}))
"""
# Once more with everything that they import at hand, so that what is allocated is their own.
ALLOCATED = """
import importlib, json, sys, tracemalloc
for name in sys.argv[1:]:
    importlib.import_module(name)
for name in [name for name in sys.modules if name.startswith("fisheye_ep_calib")]:
    del sys.modules[name]
tracemalloc.start()
most = {}
for name in sys.argv[1:]:
    tracemalloc.reset_peak()
    held = tracemalloc.get_traced_memory()[0]
    importlib.import_module(name)
    most[name] = tracemalloc.get_traced_memory()[1] - held
print(json.dumps(most))
"""
MOST_ALLOCATED = 4 << 20  # bytes, by a module and those that it is the first to import; their code takes a fraction


def in_new_process(program: str, *words: str) -> dict:
    ended = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, timeout=120)
    assert (ended.returncode, ended.stderr) == (0, "")
    return json.loads(ended.stdout)


@pytest.mark.parametrize("modules", [CORE, ROS], ids=["without ROS", "ROS"])
def test_an_import_changes_nothing_in_the_process(modules):
    if modules is ROS and importlib.util.find_spec("rclpy") is None:
        pytest.skip("no rclpy here")
    assert in_new_process(CHANGES, *modules) == {}


def test_an_import_allocates_nothing_large():
    allocated = in_new_process(ALLOCATED, *CORE)
    assert {name: size for name, size in allocated.items() if size > MOST_ALLOCATED} == {}


def own_names(tree: ast.AST) -> set[str]:
    """What a module defines: functions, classes, variables, attributes."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name):
            names |= {node.attr} if node.value.id == "self" else set()
    return names


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def reached_into(tree: ast.AST, inherited: set[str]) -> list[str]:
    """Private attributes of others that a module uses, and private names that it imports.

    inherited: what ``self`` may have from a base class of our own. ``os._exit`` is documented.
    """
    own = own_names(tree)
    reached = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and private(node.attr) and node.attr not in own:
            where = ast.unparse(node)
            if where != "os._exit" and not (where == f"self.{node.attr}" and node.attr in inherited):
                reached.append(where)
        elif isinstance(node, ast.ImportFrom):
            parts = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
            reached += [ast.unparse(node)] if any(map(private, parts)) else []
        elif isinstance(node, ast.Import):
            reached += [alias.name for alias in node.names if any(map(private, alias.name.split(".")))]
    return reached


def test_nothing_private_of_a_library_is_used():
    trees = {path: ast.parse(path.read_text("utf-8")) for path in PACKAGE.rglob("*.py")}
    ours = set().union(*map(own_names, trees.values()))
    assert {str(path): found for path, tree in trees.items() if (found := reached_into(tree, ours))} == {}


def test_what_is_private_elsewhere_is_noticed():
    program = (
        "from a._b import c\nimport d._e\nclass F:\n  def g(self, h):\n    self._own = self._base, self._node\n    h._i"
    )
    assert set(reached_into(ast.parse(program), {"_base"})) == {"from a._b import c", "d._e", "h._i", "self._node"}


@pytest.mark.parametrize(
    ("line", "key"),
    [
        ("import os; os.environ['OMP_NUM_THREADS'] = '1'", "environment"),
        ("import cv2; cv2.setNumThreads(1)", "opencv"),
        ("import logging; logging.basicConfig()", "logging"),
        ("import matplotlib; matplotlib.use('svg')", "matplotlib"),
        ("import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN)", "signals"),
    ],
)
def test_a_module_that_changes_the_process_is_noticed(tmp_path, monkeypatch, line, key):
    (tmp_path / "meddling.py").write_text(line, "utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert list(in_new_process(CHANGES, "meddling")) == [key]


def test_a_module_that_allocates_is_noticed(tmp_path, monkeypatch):
    (tmp_path / "fisheye_ep_calib_large.py").write_text("import numpy\nnumpy.empty(2**24, dtype=numpy.uint8)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert in_new_process(ALLOCATED, "fisheye_ep_calib_large")["fisheye_ep_calib_large"] > MOST_ALLOCATED


def test_the_environment_is_passed_to_processes_and_never_set() -> None:
    setting = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if sets_environment(path)}
    # multiprocessing passes none: set while workers start, and set back.
    # A command's own process: numpy's threads are counted when it is loaded.
    assert setting == {"worker_processes.py", "cli.py"}


def test_a_command_called_from_python_leaves_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in cli._THREADS:
        monkeypatch.delenv(name, raising=False)
    before, threshold = dict(os.environ), gc.get_threshold()
    with pytest.raises(SystemExit):
        cli.main(["--help"])
    assert dict(os.environ) == before and gc.get_threshold() == threshold


def sets_environment(path: Path) -> bool:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        stored = isinstance(node, ast.Subscript) and not isinstance(node.ctx, ast.Load)
        if stored and ast.unparse(node.value) == "os.environ":
            return True
        called = ast.unparse(node.func) if isinstance(node, ast.Call) else ""
        if called in {"os.putenv", "os.unsetenv", *(f"os.environ.{name}" for name in ("update", "setdefault", "pop"))}:
            return True
    return False
