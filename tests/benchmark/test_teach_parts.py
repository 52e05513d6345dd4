"""The shipped vision models are what teaching gives today, and true to the parts."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from benchmark.localizers import load_model
from benchmark.teaching import teach
from benchmark.world.parts import get_part
from vision.model_file import model_to_json

PARTS = ("hub", "cover1", "cover2")
LIMIT_MM = {"hub": 0.25, "cover1": 0.1, "cover2": 0.1}

# Weak edges: rims deep in the casting of which hardly more than half is seen. Every other salient circle must hold.
pytestmark = pytest.mark.slow


@cache
def taught(name):
    return teach(name)


def same(shipped, fresh, path=""):
    """Compare two JSON documents: numbers within 1e-6, everything else equal."""
    if isinstance(shipped, dict):
        assert list(shipped) == list(fresh), path
        for key in shipped:
            same(shipped[key], fresh[key], f"{path}.{key}")
    elif isinstance(shipped, list):
        assert len(shipped) == len(fresh), path
        for i, (a, b) in enumerate(zip(shipped, fresh, strict=True)):
            same(a, b, f"{path}[{i}]")
    elif isinstance(shipped, float):
        assert fresh == pytest.approx(shipped, rel=1e-6, abs=1e-6), path
    else:
        assert shipped == fresh, path


@pytest.mark.parametrize("name", PARTS)
def test_shipped_model_is_what_teaching_gives(name):
    same(json.loads(model_to_json(load_model(name))), json.loads(model_to_json(taught(name))), name)


def salient_features():
    found = []
    for name in PARTS:
        for feature in load_model(name).salient:
            found.append(pytest.param(name, feature.name, id=f"{name}-{feature.name}"))
    return found


@pytest.mark.parametrize(("name", "feature"), salient_features())
def test_salient_circle_is_true_to_the_part(name, feature):
    (circle,) = [f.circle for f in taught(name).salient if f.name == feature]
    (rim,) = [r for r in get_part(name).rims if r.name == feature]
    assert 1e3 * np.linalg.norm(circle.centre - [rim.offset_m, 0, rim.z_m]) < LIMIT_MM[name]
    assert 1e3 * abs(circle.radius_m - rim.radius_m) < LIMIT_MM[name]
    assert np.degrees(np.arccos(min(rim.side * circle.normal[2], 1))) < 0.2


@pytest.mark.parametrize("name", PARTS)
def test_supporting_circles_are_where_the_part_has_them(name):
    rims = {r.name: r for r in get_part(name).rims}
    for feature in taught(name).supporting:
        rim = rims[feature.name]
        assert feature.copies == rim.copies
        assert 1e3 * np.linalg.norm(feature.circle.centre - [rim.offset_m, 0, rim.z_m]) < 2 * LIMIT_MM[name] + 0.25
        assert 1e3 * abs(feature.circle.radius_m - rim.radius_m) < LIMIT_MM[name]


@pytest.mark.parametrize("name", PARTS)
def test_both_faces_grasps_bore_and_symmetry_are_taught(name):
    part, model = get_part(name), taught(name)
    assert {np.sign(f.circle.normal[2]) for f in model.salient} == {-1.0, 1.0}
    assert [g.name for g in model.grasps] == [g.name for g in part.grasps]
    assert model.symmetry_fold == part.symmetry.fold
    assert model.bore is not None
    assert model.bore.diameter_m == part.bore.diameter_m
