"""What `pip install` without -e takes along: everything that the program reads."""

from __future__ import annotations

import fnmatch
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
ROOMS = ("vision", "robot", "benchmark", "assets")
DATA = [
    path.relative_to(ROOT)
    for room in ROOMS
    for path in (ROOT / room).rglob("*")
    if path.is_file() and path.suffix not in (".py", ".pyc") and "__pycache__" not in path.parts
]


def is_package_data(path: Path) -> bool:
    """Whether a pattern of the file's package, or of one above it, names the file."""
    patterns = SETUPTOOLS["package-data"]
    for parent in path.parents:
        for pattern in patterns.get(".".join(parent.parts), []):
            if fnmatch.fnmatch(path.relative_to(parent).as_posix(), pattern.replace("**/*", "*")):
                return True
    return path.name in patterns["*"]


@pytest.mark.parametrize("room", ROOMS)
def test_every_room_is_a_package(room):
    assert f"{room}*" in SETUPTOOLS["packages"]["find"]["include"]


def test_every_file_that_is_no_source_is_package_data():
    assert len(DATA) > 100
    assert [path.as_posix() for path in DATA if not is_package_data(path)] == []


def test_a_file_that_nobody_names_is_found():
    assert not is_package_data(Path("benchmark/world/forgotten.xml"))
