"""Teaching by clicks, on drawn plates whose circles are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse
from vision.localizer import extract_features
from vision.teaching.lesson import Lesson, TaughtFeature, acquire, locate, propose_extractor
from vision.teaching.snapping import ellipse_through, snap_to_edge
from vision.teaching.triangulation import triangulate_circle

UPRIGHT = RigidTransform.identity()
FRONT = ("outline_front", "ring_front", "bore_front", "hole_front")


def clicks_on(circle, view, rng, n=12, sigma_px=1.0):
    """Where a person with an unsteady hand clicks who means a circle."""
    start = rng.uniform(0, 2 * np.pi / n)
    at = circle.sample(360)[(np.arange(n) * 360 // n + int(np.degrees(start))) % 360]
    return view.project(at) + rng.normal(scale=sigma_px, size=(n, 2))


def feature(plate, name):
    return next(f for f in plate.features if f.name == name)


@pytest.fixture(scope="module")
def views(photograph):
    """Five pictures of the plate as it stands on the fixture: the world's frame is the plate's."""
    return photograph([UPRIGHT], views=5)


@pytest.fixture(scope="module")
def edges(views):
    return [EdgeField.from_gray(v.gray) for v in views]


@pytest.mark.parametrize("name", FRONT)
@pytest.mark.parametrize("seed", [10_040, 10_041])
def test_unsteady_clicks_snap_to_the_contour(name, seed, plate, views, edges):
    circle = feature(plate, name).circle
    rng = np.random.default_rng(seed)
    for view, field in zip(views, edges, strict=True):
        truth = project_circle(circle, view)
        clicks = clicks_on(circle, view, rng)
        ellipse, points = snap_to_edge(clicks, field)
        assert np.abs(truth.distance(ellipse.sample(90))).max() < 0.1
        assert np.abs(truth.distance(points)).max() < 0.5
        assert len(points) > 20


def test_clicks_stay_where_there_is_no_edge():
    truth = Ellipse.from_geometric(300, 200, 80, 60, 0.4)
    clicks = truth.sample(12)
    ellipse, points = snap_to_edge(clicks, EdgeField.from_gray(np.full((480, 640), 90, np.uint8)))
    assert np.array_equal(points, clicks)
    assert np.allclose(ellipse.geometric, truth.geometric, atol=1e-2)


@pytest.mark.parametrize(
    "clicks",
    [
        np.zeros((0, 2)),
        np.random.default_rng(10_042).uniform(0, 100, (4, 2)),
        np.zeros((6, 3)),
        np.full((6, 2), np.nan),
        np.column_stack([np.arange(8.0), 2 * np.arange(8.0) + 3]),
        np.tile([5.0, 7.0], (8, 1)),
    ],
    ids=["none", "four", "3d", "nan", "line", "one place"],
)
def test_clicks_that_make_no_ellipse_are_refused(clicks):
    with pytest.raises(InputError, match="clicks: got"):
        ellipse_through(clicks)


@pytest.mark.parametrize("name", FRONT)
def test_perfect_marks_give_the_circle(name, plate, views):
    circle = feature(plate, name).circle
    marks = {v: view.project(circle.sample(24)) for v, view in enumerate(views)}
    found = triangulate_circle(views, marks)
    assert np.allclose(found.circle.centre, circle.centre, atol=1e-7)
    assert found.circle.radius_m == pytest.approx(circle.radius_m, abs=1e-7)
    assert found.circle.normal @ circle.normal > np.cos(1e-5)
    assert max(found.residual_px.values()) < 1e-3
    assert found.inconsistent() == []


@pytest.mark.parametrize("name", FRONT)
@pytest.mark.parametrize("seed", [10_043, 10_044, 10_045])
def test_five_views_of_unsteady_clicks_give_the_circle(name, seed, plate, views, edges):
    taught = feature(plate, name)
    rng = np.random.default_rng(seed)
    clicks = {v: clicks_on(taught.circle, view, rng) for v, view in enumerate(views)}
    found = locate(TaughtFeature(name, taught.role, clicks), views, edges).circle
    assert 1e3 * np.linalg.norm(found.centre - taught.circle.centre) < 0.1
    assert 1e3 * abs(found.radius_m - taught.circle.radius_m) < 0.1
    # The direction of a hole 7 mm across is less well determined than that of an outline 60 mm across.
    limit_deg = 0.2 if taught.role == "salient" else 1.0
    assert np.degrees(np.arccos(min(found.normal @ taught.circle.normal, 1))) < limit_deg


def test_stated_accuracy_of_unsnapped_clicks_is_that_of_their_scatter(plate, views):
    circle = feature(plate, "outline_front").circle
    rng = np.random.default_rng(10_046)
    found = [
        triangulate_circle(views, {v: clicks_on(circle, view, rng) for v, view in enumerate(views)})
        for _ in range(40)
    ]
    radii = np.array([f.circle.radius_m for f in found])
    centres = np.array([f.circle.centre for f in found])
    assert np.std(radii) < 2 * np.mean([f.radius_sigma_m for f in found])
    assert np.std(radii) > 0.3 * np.mean([f.radius_sigma_m for f in found])
    assert np.std(centres, axis=0).max() < 2 * np.mean([f.centre_sigma_m for f in found])
    assert np.std(centres, axis=0).max() > 0.3 * np.mean([f.centre_sigma_m for f in found])


@pytest.mark.parametrize("wrong", [0, 3])
def test_the_view_whose_marks_disagree_is_named(wrong, plate, views):
    circle = feature(plate, "ring_front").circle
    rng = np.random.default_rng(10_047)
    marks = {v: clicks_on(circle, view, rng, sigma_px=0.3) for v, view in enumerate(views)}
    marks[wrong] = marks[wrong] + [12.0, -9.0]
    found = triangulate_circle(views, marks)
    assert found.inconsistent() == [wrong]
    assert 1e3 * np.linalg.norm(found.circle.centre - circle.centre) < 0.5


def test_fewer_than_two_marked_views_are_refused(plate, views):
    marks = views[0].project(plate.features[0].circle.sample(12))
    for few in ({}, {0: marks}):
        with pytest.raises(InputError, match="at least two"):
            triangulate_circle(views, few)


def test_two_views_from_one_place_are_refused(plate, views):
    marks = views[0].project(plate.features[0].circle.sample(12))
    with pytest.raises(InputError, match="different directions"):
        triangulate_circle([views[0], views[0]], {0: marks, 1: marks})


def test_refused_marks_are_reported_by_the_name_of_the_feature(plate, views, edges):
    marks = views[0].project(plate.features[0].circle.sample(12))
    with pytest.raises(InputError, match=r"feature 'rim': .*at least two"):
        locate(TaughtFeature("rim", "salient", {0: marks}), views, edges)


@pytest.fixture(scope="module")
def taught(plate, views):
    """The plate's front, taught from start to end."""
    rng = np.random.default_rng(10_048)
    marked = tuple(
        TaughtFeature(
            f.name, f.role, {v: clicks_on(f.circle, view, rng) for v, view in enumerate(views)}, copies=f.copies
        )
        for f in plate.features
        if f.name in FRONT
    )
    found = [extract_features(view, ("region", "group")) for view in views]
    return acquire(Lesson("plate", 0.060, marked, symmetry_fold=3), views, found)


def test_a_lesson_makes_the_model_that_was_shown(taught, plate):
    assert (taught.part, taught.diameter_m, taught.symmetry_fold) == ("plate", 0.060, 3)
    assert tuple(f.name for f in taught.features) == FRONT
    for found in taught.features:
        truth = feature(plate, found.name)
        assert (found.role, found.copies) == (truth.role, truth.copies)
        assert 1e3 * np.linalg.norm(found.circle.centre - truth.circle.centre) < 0.1
        assert 1e3 * abs(found.circle.radius_m - truth.circle.radius_m) < 0.1
        assert found.support > 0.9


def test_salient_circles_are_put_on_the_axis_and_upright(taught):
    for salient in taught.salient:
        assert salient.circle.centre[:2].tolist() == [0, 0]
        assert salient.circle.normal.tolist() == [0, 0, 1]


@pytest.mark.parametrize(
    ("name", "grey"),
    [
        ("bore_front", 50),
        ("hole_front", 60),
    ],
)
def test_attributes_are_those_of_the_region_inside(name, grey, taught, views, plate):
    attributes = dict(next(f for f in taught.features if f.name == name).attributes)
    assert grey - 3 < attributes["grey_mean"].low <= attributes["grey_mean"].high < grey + 12
    areas = [project_circle(feature(plate, name).circle, view).area for view in views]
    assert attributes["area_px"].low == pytest.approx(min(areas), rel=0.15)
    assert attributes["area_px"].high == pytest.approx(max(areas), rel=0.15)


def test_a_person_may_overrule_the_proposed_extractor(plate, views):
    circle = feature(plate, "bore_front").circle
    rng = np.random.default_rng(10_049)
    clicks = {v: clicks_on(circle, views[v], rng) for v in (0, 1)}
    for choice in ("region", "group"):
        lesson = Lesson("plate", 0.060, (TaughtFeature("bore", "salient", clicks, extractor=choice),))
        assert acquire(lesson, views, [[] for _ in views]).features[0].extractor == choice


def test_extractor_that_saw_the_feature_in_more_views_is_proposed(views):
    seen = {e: extract_features(views[0], (e,))[:1] for e in ("region", "group")}
    region, group = seen["region"], seen["group"]
    assert propose_extractor([region, group, group]) == "group"
    assert propose_extractor([region, region, group]) == "region"
    assert propose_extractor([region + group, []]) == "region"
    assert propose_extractor([]) == "region"


def test_a_circle_that_is_clearly_off_the_axis_or_tilted_stays_so(plate, views):
    tilted = Circle(np.array([0.004, 0.0, 0.004]), np.array([0.2, 0.0, 1.0]), 0.012)
    marks = {v: view.project(tilted.sample(24)) for v, view in enumerate(views)}
    blank = [EdgeField.from_gray(np.full((480, 640), 90, np.uint8)) for _ in views]
    found = locate(TaughtFeature("slant", "supporting", marks), views, blank).circle
    assert np.allclose(found.centre, tilted.centre, atol=1e-6)
    assert found.normal @ tilted.normal > np.cos(1e-4)
