"""The shipped vision models come from recorded sessions, are what teaching gives today, and are true to the parts."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

from benchmark.models import MODELS, load_model
from benchmark.study.simulated_person import Operator, record, teach
from benchmark.world.parts import get_part
from tests.same_model import assert_same
from vision.model.model_file import model_to_json
from vision.teaching.session_file import load_session
from vision.teaching.view_directory import load_views

PARTS = ("hub", "cover1", "cover2")
LIMIT_MM = 0.1
LIMIT_DEG = 0.2

pytestmark = pytest.mark.slow


@cache
def taught(name):
    return teach(name)


@pytest.mark.parametrize("name", PARTS)
def test_shipped_model_is_what_teaching_gives(name):
    assert_same(json.loads(model_to_json(load_model(name))), json.loads(model_to_json(taught(name))), name)


@pytest.mark.parametrize("name", PARTS)
def test_shipped_session_is_what_the_simulated_person_does(name):
    session = load_session(MODELS / "sessions" / name)
    assert session.events == record(name)[0].events
    session.check(load_views(MODELS / "sessions" / name))


def assert_true(model, part):
    """Every circle within the limits of the drawing's."""
    rims = {r.name: r for r in part.rims}
    for feature in model.features:
        rim, circle = rims[feature.name], feature.circle
        assert feature.copies == rim.copies
        assert 1e3 * np.linalg.norm(circle.centre - [rim.offset_m, 0, rim.z_m]) < LIMIT_MM, feature.name
        assert 1e3 * abs(circle.radius_m - rim.radius_m) < LIMIT_MM, feature.name
        assert np.degrees(np.arccos(min(rim.side * circle.normal[2], 1))) < LIMIT_DEG, feature.name


@pytest.mark.parametrize("name", PARTS)
def test_shipped_circles_are_true_to_the_part(name):
    assert_true(load_model(name), get_part(name))


@pytest.mark.parametrize("name", PARTS)
def test_another_hand_teaches_true_circles_too(name):
    assert_true(teach(name, Operator(seed=1)), get_part(name))


def test_a_hand_that_is_off_by_three_pixels_still_teaches_the_outline():
    model = teach("cover2", Operator(click_sigma_px=3.0))
    (outline,) = [f for f in model.salient if f.name == "outline_front"]
    assert 1e3 * abs(outline.circle.radius_m - 0.0325) < LIMIT_MM


def test_two_views_teach_less_well_than_five_but_teach():
    part = get_part("cover1")
    rims = {r.name: r for r in part.rims}
    for feature in teach("cover1", Operator(views=2)).salient:
        assert 1e3 * abs(feature.circle.radius_m - rims[feature.name].radius_m) < 3 * LIMIT_MM


@pytest.mark.parametrize("name", PARTS)
def test_both_faces_grasps_bore_and_symmetry_are_taught(name):
    part, model = get_part(name), taught(name)
    assert {np.sign(f.circle.normal[2]) for f in model.salient} == {-1.0, 1.0}
    assert [g.name for g in model.grasps] == [g.name for g in part.grasps]
    assert model.symmetry_fold == part.symmetry.fold
    assert model.bore is not None
    assert model.bore.diameter_m == part.bore.diameter_m
