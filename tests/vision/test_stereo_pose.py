"""The pose by stereo: exact from exact ellipses, closed form, and none where the views share nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.model.vision_model import SalientCircles
from vision.pose.stereo import absolute_orientation, corresponding_points, pose_by_stereo, triangulate


@given(st.integers(0, 2**32 - 1))
def test_absolute_orientation_recovers_any_pose(seed):
    rng = np.random.default_rng(seed)
    truth = RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))
    points = rng.normal(size=(5, 3))
    found = absolute_orientation(points, truth.apply(points), rng.uniform(0.5, 2, 5))
    assert np.allclose(found.as_matrix(), truth.as_matrix(), atol=1e-9)


def test_absolute_orientation_never_mirrors():
    points = np.random.default_rng(0).normal(size=(8, 3))
    found = absolute_orientation(points, points * [1, 1, -1])
    assert np.linalg.det(found.rotation.as_matrix()) == pytest.approx(1)


@pytest.mark.parametrize(
    "points", [np.zeros((2, 3)), np.outer(np.arange(5.0), [1, 2, 3]), np.zeros((4, 2))], ids=["few", "line", "flat"]
)
def test_degenerate_points_are_refused(points):
    with pytest.raises(InputError, match="expected"):
        absolute_orientation(points, points)


def ellipses_of(
    T: RigidTransform, circles: SalientCircles, views: list[View]
) -> tuple[list[list[EllipseFeature]], np.ndarray]:
    """What exact extractors find of the circles that face the cameras, and which is which."""
    features: list[list[EllipseFeature]] = []
    matches = np.full((len(views), len(circles.radius)), -1)
    for v, view in enumerate(views):
        features.append([])
        for k in np.flatnonzero(circles.side > 0):
            circle = Circle(np.array([0.0, 0.0, circles.height[k]]), np.array([0.0, 0.0, 1.0]), circles.radius[k])
            ellipse = project_circle(circle.moved(T), view)
            matches[v, k] = len(features[v])
            features[v].append(EllipseFeature(ellipse, "region", ellipse.sample(60), 1.0, 1.0))
    return features, matches


@pytest.mark.parametrize("views", [[0, 1], [0, 1, 2]])
@pytest.mark.parametrize("off", [(0, 0, 0), (1.5, -1, 6), (-1, 2, -5)])
def test_exact_ellipses_give_the_exact_pose(views, off, plate, photograph, pose):
    truth = pose(4, -6, 2, about=(5, -4, 30))
    seen, circles = photograph([], views=views), SalientCircles.of(plate)
    features, matches = ellipses_of(truth, circles, seen)
    hypothesis = pose(*off) * truth * pose(about=(2, -1.5, 0))
    found = pose_by_stereo(hypothesis.as_matrix(), matches, features, seen, circles)
    assert np.allclose(found[:3, 3], truth.translation, atol=1e-7)
    assert np.allclose(found[:3, 2], truth.as_matrix()[:3, 2], atol=1e-5)


def test_a_wrong_match_is_left_out(plate, photograph, pose):
    truth = pose(0, 0, 0, about=(5, -4, 30))
    seen, circles = photograph([], views=[0, 1, 2]), SalientCircles.of(plate)
    features, matches = ellipses_of(truth, circles, seen)
    matches[2] = np.where(matches[2] >= 0, np.roll(matches[2], 1), -1)
    found = pose_by_stereo(truth.as_matrix(), matches, features, seen, circles)
    assert np.allclose(found[:3, 3], truth.translation, atol=1e-7)


def test_views_that_share_no_circle_give_no_pose(plate, photograph, pose):
    truth = pose()
    seen, circles = photograph([], views=[0, 1]), SalientCircles.of(plate)
    features, matches = ellipses_of(truth, circles, seen)
    matches[0, 0], matches[1, 1:] = -1, -1
    assert pose_by_stereo(truth.as_matrix(), matches, features, seen, circles) is None
    assert pose_by_stereo(truth.as_matrix(), matches[:1], features[:1], seen[:1], circles) is None


def test_correspondences_lie_on_the_ellipse_and_on_the_epipolar_line(plate, photograph, pose):
    first, second = photograph([], views=[0, 1])
    circle = Circle(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.03).moved(pose(about=(8, 3, 0)))
    other = project_circle(circle, second)
    points = circle.sample(17)
    found, crossing = corresponding_points(first.project(points), (first, second), other)
    nearest = np.linalg.norm(found - second.project(points), axis=2).min(axis=0)
    assert nearest[crossing > 0.1].max() < 1e-4
    assert np.abs(other.distance(found[0][crossing > 0.1])).max() < 1e-6
    outside, none = corresponding_points(np.array([[-5000.0, 0.0]]), (first, second), other)
    assert np.isnan(outside).all()
    assert none == 0


@given(st.integers(0, 2**32 - 1))
def test_rays_meet_where_they_were_aimed(seed):
    rng = np.random.default_rng(seed)
    origins, points = rng.normal(size=(2, 3)), rng.normal([0, 0, 9], size=(6, 3))
    directions = (points - origins[:, None]) * rng.uniform(0.5, 2, size=(2, 6, 1))
    assert np.allclose(triangulate(origins, directions), points, atol=1e-6)
    assert np.isnan(triangulate(origins, np.ones((2, 1, 3)))).all()
