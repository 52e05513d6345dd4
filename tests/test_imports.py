"""The walls between the packages, held by reading every import (CONTRIBUTING.md, "Walls")."""

from __future__ import annotations

import ast
import sys
from dataclasses import dataclass
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("vision", "robot", "benchmark")
FILES = tuple(sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")))

VISION_MAY_IMPORT = {"vision", "numpy", "scipy", "cv2", "filterpy", "numba"}
ROBOT_MAY_IMPORT = {"robot", "numpy", "scipy", "mujoco", "mink", "ruckig"}
VALUE_TYPES = ("vision.geometry.camera", "vision.errors", "vision.model.grasp", "vision.frozen")
EDITOR = "vision/teaching/editor/"
ANYONE = {"errors", "frozen", "settings", "features", "kernel_cache"}
ROOMS: dict[str, set[str]] = {
    "geometry": set(),
    "files": {"geometry"},
    "edges": {"geometry"},
    "regions": {"geometry", "edges"},
    "grouping": {"geometry", "edges"},
    "extraction": {"geometry", "regions", "grouping"},
    "model": {"geometry", "files", "extraction"},
    "pose": {"geometry", "edges", "model"},
    "matching": {"geometry", "edges", "extraction", "model", "pose"},
    "drawing": {"geometry", "edges", "regions", "grouping", "extraction", "model", "pose"},
    "localizer": {"geometry", "edges", "regions", "extraction", "model", "pose", "matching"},
    "paper": {"geometry", "edges", "regions", "grouping", "extraction", "model", "pose", "matching", "localizer"},
}
"""What each room of `vision` may import besides itself and what anyone may: lower rooms come first."""
BENCHMARK_ANYONE = {"config", "strict_json", "child_process", "interrupts", "seeds"}
BENCHMARK_ROOMS: dict[str, set[str]] = {
    "config": set(),
    "strict_json": set(),
    "child_process": {"interrupts"},
    "interrupts": set(),
    "seeds": set(),
    "meshes": set(),
    "world": {"meshes"},
    "models": {"meshes", "world"},
    "localizers": {"meshes", "world", "models"},
    "records": set(),
    "study": {"meshes", "world"},
    "tasks": {"meshes", "world", "models"},
    "episodes": {"meshes", "world", "models", "localizers", "records", "study", "tasks"},
    "report": {"meshes", "world", "models", "localizers", "records", "study", "tasks", "episodes"},
    "lessons": {"meshes", "world", "localizers", "records", "tasks", "episodes"},
    "detector": {"meshes", "world", "records", "report"},
}
"""The same for `benchmark`; its commands, timing and tuning may import any room."""
SCENE = "benchmark/world/scene.py"


@dataclass(frozen=True)
class Import:
    """One imported thing: `from a.b import c` and `import a.b.c` both have the target a.b.c."""

    target: str
    line: int

    @property
    def root(self) -> str:
        return self.target.partition(".")[0]

    def is_in(self, module: str) -> bool:
        return self.target == module or self.target.startswith(module + ".")

    @property
    def is_private(self) -> bool:
        parts = self.target.split(".")
        return any(part.startswith("_") and not part.endswith("__") for part in parts)


def imports(source: str, path: str) -> list[Import]:
    """All imports of a file, whether at its top, in a function or for type checking; relative ones made absolute."""
    package = path.removesuffix(".py").split("/")[:-1]
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [Import(alias.name, node.lineno) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            found += [Import(f"{module}.{alias.name}", node.lineno) for alias in node.names]
    return found


def broken_walls(source: str, path: str) -> list[str]:
    """What a file imports and should not.

    Args:
        source: the file's text.
        path: its path from the root of the repository, with slashes.

    Returns:
        One sentence per offending import.
    """
    return [
        f"{path}:{item.line}: {complaint}" for item in imports(source, path) for complaint in _complaints(item, path)
    ]


def _complaints(item: Import, path: str) -> list[str]:
    home = path.split("/")[0]
    known = item.root in sys.stdlib_module_names
    complaints = []
    if home == "vision" and not known and item.root not in VISION_MAY_IMPORT | _extra(path):
        complaints.append(f"vision may not import {item.target}")
    if home == "robot" and not known and item.root not in ROBOT_MAY_IMPORT and not any(map(item.is_in, VALUE_TYPES)):
        complaints.append(f"robot may not import {item.target}")
    if item.is_in("vision.teaching") and home == "vision" and not path.startswith("vision/teaching/"):
        complaints.append(f"vision may not import {item.target}: teaching imports vision, not the other way round")
    complaints += _crossed_rooms(item, path)
    if item.root == "dm_control" and path != SCENE:
        complaints.append(f"only {SCENE} may import {item.target}")
    if item.is_private and item.root != home:
        complaints.append(f"{item.target} is private to another package")
    return complaints


def _crossed_rooms(item: Import, path: str) -> list[str]:
    """A room imports lower rooms of its package only; the two extractors do not know each other."""
    parts, names = path.removesuffix(".py").split("/"), item.target.split(".")
    home = parts[0]
    rooms, anyone = {"vision": (ROOMS, ANYONE), "benchmark": (BENCHMARK_ROOMS, BENCHMARK_ANYONE)}.get(
        home, ({}, set())
    )
    if names[0] != home or len(names) < 2 or parts[1] not in rooms:
        return []
    allowed = rooms[parts[1]] | anyone | {parts[1]}
    return [] if names[1] in allowed else [f"the room {home}/{parts[1]} may not import {item.target}"]


def _extra(path: str) -> set[str]:
    return {"nicegui", "fastapi"} if path.startswith(EDITOR) else set()


@pytest.mark.parametrize("path", [file.relative_to(ROOT).as_posix() for file in FILES])
def test_file_respects_the_walls(path):
    assert broken_walls((ROOT / path).read_text(encoding="utf-8"), path) == []


@pytest.mark.parametrize(
    ("package", "rules", "top"),
    [("vision", ROOMS, {"teaching"}), ("benchmark", BENCHMARK_ROOMS, {"commands", "timing", "tuning"})],
)
def test_every_room_has_its_rule_and_says_its_purpose(package, rules, top):
    rooms = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
    assert rooms - set(rules) == top
    for room in rooms:
        text = (ROOT / package / room / "__init__.py").read_text(encoding="utf-8")
        assert ast.get_docstring(ast.parse(text)), f"{package}/{room}/__init__.py does not say what it is for"


def test_no_files_import_each_other_in_a_circle():
    """Whether at the top, in a function or for type checking: each can be read after those that it imports."""
    modules = {path.relative_to(ROOT).as_posix().removesuffix(".py").replace("/", "."): path for path in FILES}
    graph = {}
    for module, path in modules.items():
        targets = imports(path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix())
        named = {name for item in targets for name in (item.target, item.target.rpartition(".")[0])}
        graph[module] = named & modules.keys() - {module}
    TopologicalSorter(graph).prepare()


@pytest.mark.parametrize("rules", [ROOMS, BENCHMARK_ROOMS])
def test_the_rules_of_the_rooms_have_no_circle(rules):
    TopologicalSorter(rules).prepare()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_is_read(package):
    assert any(file.is_relative_to(ROOT / package) for file in FILES)


@pytest.mark.parametrize("path", sorted((ROOT / "benchmark" / "tasks").glob("*.py")), ids=lambda path: path.stem)
def test_a_task_never_asks_for_the_truth(path):
    names = {
        node.attr for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Attribute)
    }
    assert names.isdisjoint({"truth", "camera_truth", "peg_truth", "visibility", "xpos", "xquat", "xmat"})


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("vision/pose/refinement.py", "import mujoco"),
        ("vision/pose/refinement.py", "import robot.arm"),
        ("vision/pose/refinement.py", "def f():\n    from benchmark import config"),
        ("vision/pose/refinement.py", "from vision.teaching import session"),
        ("vision/pose/refinement.py", "from ..teaching.session import Session"),
        ("vision/pose/refinement.py", "from scipy.optimize._lsq import trf"),
        ("vision/teaching/session.py", "import nicegui"),
        ("vision/regions/merging.py", "from vision.grouping import fragments"),
        ("vision/grouping/score.py", "from vision.regions.quadtree import SplitAndMergeParameters"),
        ("vision/matching/matcher.py", "from vision.regions.segmentation import segment"),
        ("vision/geometry/ellipse.py", "from vision.edges.edge_map import EdgeMap"),
        ("vision/localizer.py", "from vision.drawing.panel import Panel"),
        ("benchmark/world/cell.py", "from benchmark.episodes.episode import run_episode"),
        ("benchmark/records/store.py", "from benchmark.report import tables"),
        ("benchmark/localizers/oracle.py", "from benchmark.records.store import read_records"),
        ("robot/arm.py", "import cv2"),
        ("robot/arm.py", "from vision.edges.edge_map import canny"),
        ("robot/arm.py", "from vision import Camera"),
        ("robot/arm.py", "from dm_control import mjcf"),
        ("benchmark/cli.py", "import dm_control.mjcf"),
        ("benchmark/cli.py", "from vision.geometry.camera import _project"),
        ("benchmark/cli.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from dm_control import mjcf"),
    ],
)
def test_a_broken_wall_is_found(path, source):
    last_line = source.count("\n") + 1
    complaints = broken_walls(source, path)
    assert complaints
    assert all(complaint.startswith(f"{path}:{last_line}: ") for complaint in complaints)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        (
            "vision/pose/refinement.py",
            "from __future__ import annotations\nimport math\nimport cv2\nfrom scipy import linalg",
        ),
        ("vision/pose/refinement.py", "from .ellipse import Ellipse\nfrom vision.geometry.ellipse import _helper"),
        ("vision/teaching/session.py", "from vision.teaching import operator\nfrom ..pose import Pose"),
        ("vision/teaching/editor/page.py", "from nicegui import ui"),
        ("robot/arm.py", "import mujoco\nimport mink\nfrom vision.errors import InputError"),
        ("benchmark/world/scene.py", "from dm_control import mjcf"),
        ("benchmark/cli.py", "import vision\nfrom vision.teaching import session\nfrom robot import arm"),
    ],
)
def test_what_is_allowed_passes(path, source):
    assert broken_walls(source, path) == []
