"""The package's own names, which are imported when they are first used."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import vision

HEAVY = ("cv2", "numba", "filterpy", "scipy", "numpy")


@pytest.mark.parametrize("statement", ["import vision", "import vision.errors"])
def test_errors_load_without_the_heavy_libraries(statement):
    code = f"import sys; {statement}; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", vision.__all__)
def test_every_name_is_that_of_its_module(name):
    found = getattr(vision, name)
    assert found is getattr(import_module(found.__module__), name)
    assert name in dir(vision)


def test_editors_see_the_names_that_are_there():
    source = Path(vision.__file__).read_text(encoding="utf-8")
    imported = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    seen = {(alias.name, node.module) for node in imported for alias in node.names}
    public = {(name, getattr(vision, name).__module__) for name in vision.__all__}
    assert public <= seen
    assert {name for name, module in seen if module.startswith("vision.")} == set(vision.__all__)


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'vision' has no attribute 'detect_squares'"):
        _ = vision.detect_squares
