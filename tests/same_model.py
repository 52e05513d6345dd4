"""Whether two vision models are the same up to how processors differ."""

from __future__ import annotations

import pytest

REL, ABS = 1e-3, 2e-5
"""Of a figure, in metres: another processor draws and smooths a few pixels differently, which moves an edge by
micrometres."""
ABS_DIRECTION = 5e-4
"""Of a component of an edge's direction, a unit vector: such a pixel turns the edge by up to 1e-4."""


def assert_same(expected: object, found: object, path: str = "") -> None:
    """Compare two models as JSON: numbers up to how machines differ, everything else equal."""
    if isinstance(expected, dict):
        assert isinstance(found, dict), path
        assert list(expected) == list(found), path
        for key in expected:
            assert_same(expected[key], found[key], f"{path}.{key}")
    elif isinstance(expected, list):
        assert isinstance(found, list), path
        assert len(expected) == len(found), path
        for i, (a, b) in enumerate(zip(expected, found, strict=True)):
            assert_same(a, b, f"{path}[{i}]")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=REL, abs=ABS_DIRECTION if ".directions" in path else ABS), path
    else:
        assert expected == found, path
