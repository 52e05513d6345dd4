"""The package's own names, which are imported when they are first used."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

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


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'vision' has no attribute 'detect_squares'"):
        _ = vision.detect_squares
