"""Hypotheses from perfect ellipses of a known pose."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.camera import camera_arrays
from vision.geometry.circle import circle_poses, project_circle
from vision.geometry.workspace import Workspace
from vision.matching.candidates import find_candidates, poses_of
from vision.matching.votes import EllipseTable, count_votes, predict_circle
from vision.model.vision_model import SalientCircles

WORKSPACE = Workspace((-0.06, -0.06, -0.03), (0.06, 0.06, 0.03))


def perfect(model, poses, views):
    """The ellipses of all salient circles that face the cameras, as an extractor without error would find them."""
    features = []
    for view in views:
        mine = []
        for T in poses:
            for circle in (f.circle.moved(T) for f in model.salient):
                if circle.normal @ (view.T_world_camera.translation - circle.centre) > 0:
                    ellipse = project_circle(circle, view)
                    mine.append(EllipseFeature(ellipse, "region", ellipse.sample(60), 1.0, 1.0))
        features.append(mine)
    return features


def distance_of(candidates, T):
    """Distance of the origins in metres and angle of the axes in radians from a pose."""
    away = np.linalg.norm(candidates.origin - T.translation, axis=1)
    return away, np.arccos(np.clip(candidates.axis @ T.as_matrix()[:3, 2], -1, 1))


POSES = {"front": (8, -5, 2, (6, -9, 30)), "back": (-6, 9, -2, (172, 8, -20))}


@pytest.fixture(params=POSES)
def truth(request, pose):
    x, y, z, about = POSES[request.param]
    return pose(x, y, z, about=about)


def test_the_true_pose_wins(plate, truth, photograph):
    views = photograph([])
    candidates = find_candidates(views, perfect(plate, [truth], views), plate, WORKSPACE)
    away, angle = distance_of(candidates, truth)
    assert away[0] < 1e-6
    assert angle[0] < 1e-6
    assert (np.diff(candidates.votes) <= 0).all()


def test_a_true_reading_is_voted_for_by_every_visible_circle_in_every_view(plate, truth, photograph):
    views = photograph([])
    features = perfect(plate, [truth], views)
    candidates = find_candidates(views, features, plate, WORKSPACE)
    per_view = len(features[0])
    assert (candidates.matches[0] >= 0).sum() == 3 * per_view
    weights = np.sqrt([f.circle.radius_m / 0.030 for f in plate.salient])
    facing = [f.circle.normal[2] * truth.as_matrix()[2, 2] > 0 for f in plate.salient]
    assert candidates.votes[0] == pytest.approx(3 * weights[facing].sum(), rel=1e-4)
    # What is matched are the ellipses of the very circles.
    for v, row in enumerate(candidates.matches[0]):
        for k, m in enumerate(row):
            if m >= 0:
                expected = project_circle(plate.salient[k].circle.moved(truth), views[v])
                assert np.allclose(features[v][m].ellipse.geometric[:4], expected.geometric[:4])


def test_both_circles_behind_an_ellipse_become_candidates(plate, truth, photograph):
    (view,) = photograph([], views=[1])
    outline = perfect(plate, [truth], [view])[0][0]
    k = 0 if truth.as_matrix()[2, 2] > 0 else 3
    candidates = find_candidates([view], [[outline]], plate, None)
    mine = candidates.take(np.flatnonzero(candidates.seed[:, 2] == k))
    assert len(mine) == 2
    side = np.sign(plate.salient[k].circle.normal[2])
    for expected in circle_poses(outline.ellipse, view.camera, 0.030):
        circle = expected.moved(view.T_world_camera)
        found = mine.axis @ (side * circle.normal) > np.cos(1e-4)
        assert found.sum() == 1
        height = plate.salient[k].circle.centre[2]
        origin = circle.centre - height * mine.axis[found][0]
        assert np.allclose(mine.origin[found][0], origin, atol=1e-9)
    away, angle = distance_of(mine, truth)
    assert ((away < 1e-6) & (angle < 1e-5)).sum() == 1


def test_candidates_outside_the_workspace_are_left_out(plate, truth, photograph):
    views = photograph([])
    features = perfect(plate, [truth], views)
    elsewhere = Workspace((0.2, 0.2, -0.03), (0.3, 0.3, 0.03))
    assert len(find_candidates(views, features, plate, elsewhere)) == 0
    inside = find_candidates(views, features, plate, WORKSPACE)
    everywhere = find_candidates(views, features, plate, None)
    assert 0 < len(inside) < len(everywhere)
    margin = 0.25 * plate.diameter_m
    assert (np.abs(inside.origin) <= np.array(WORKSPACE.high) + margin + 1e-12).all()


def test_no_ellipses_make_no_candidates(plate, photograph):
    candidates = find_candidates(photograph([]), [[], [], []], plate, WORKSPACE)
    assert len(candidates) == len(candidates.distinct(plate.diameter_m)) == 0
    assert candidates.matches.shape == (0, 3, 5)


def test_a_view_without_ellipses_casts_no_votes(plate, truth, photograph):
    views = photograph([])
    features = perfect(plate, [truth], views)
    features[1] = []
    best = find_candidates(views, features, plate, WORKSPACE)
    assert (best.matches[:, 1] == -1).all()
    assert distance_of(best, truth)[0][0] < 1e-6


def test_two_plates_are_two_distinct_candidates_ahead_of_all_others(plate, photograph, pose):
    truths = [pose(-33, 0, 0, about=(5, 3, 0)), pose(33, 4, 1, about=(176, 5, 0))]
    views = photograph([])
    best = find_candidates(views, perfect(plate, truths, views), plate, WORKSPACE).distinct(plate.diameter_m)
    for truth in truths:
        away, angle = distance_of(best, truth)
        assert int(np.argmin(away + angle)) < 2
        assert (away + angle).min() < 1e-5
        near = (away < 0.02 * plate.diameter_m) & (angle < np.radians(3))
        assert near.sum() == 1


def test_predictions_are_the_projected_circles_and_undefined_where_turned_away(plate, truth, photograph):
    (view,) = photograph([], views=[2])
    T = truth.as_matrix()
    T_camera_world, intrinsics = camera_arrays([view])
    row = np.empty(5)
    for feature, height, side, radius in zip(plate.salient, *SalientCircles.of(plate), strict=True):
        seen = predict_circle(T_camera_world[0] @ T, intrinsics[0], height, side, radius, row)
        assert seen == (feature.circle.normal[2] * T[2, 2] > 0)
        if seen:
            expected = project_circle(feature.circle.moved(truth), view).geometric
            assert np.allclose(row[:4], expected[:4], atol=1e-6)
            assert np.sin(row[4] - expected[4]) == pytest.approx(0, abs=1e-3)


def test_votes_fall_with_the_distance_from_the_truth(plate, truth, photograph):
    views = photograph([])
    features = perfect(plate, [truth], views)
    origin = truth.translation + np.array([0.0, 0.3, 0.6, 1.0, 5.0])[:, None] * [1e-3, 0, 0]
    axis = np.tile(truth.as_matrix()[:3, 2], (5, 1))
    circles = SalientCircles.of(plate)
    votes, matches = count_votes(poses_of(origin, axis), camera_arrays(views), circles, EllipseTable.of(features))
    assert (np.diff(votes) < 0).all()
    assert votes[-1] == 0
    assert (matches[-1] == -1).all()


def test_pose_of_a_candidate_is_rigid_with_its_axis_and_origin():
    rng = np.random.default_rng(10_002)
    axis = rng.normal(size=(20, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    origin = rng.normal(size=(20, 3))
    for T, z, o in zip(poses_of(origin, axis), axis, origin, strict=True):
        assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3))
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
        assert np.allclose(T[:3, 2], z)
        assert np.allclose(T[:, 3], [*o, 1])


def test_a_workspace_is_made_of_any_three_numbers_a_corner():
    box = Workspace(np.array([-1, 0, 0]), [1, 2, 0])
    assert box == Workspace((-1.0, 0.0, 0.0), (1.0, 2.0, 0.0))
    assert box.contains(np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.1]])).tolist() == [True, False]


@pytest.mark.parametrize(
    ("low", "high"),
    [
        ((0.1, 0, 0), (-0.1, 1, 1)),
        ((0, 0, 0), (np.nan, 1, 1)),
        ((-np.inf, 0, 0), (1, 1, 1)),
        ((0, 0), (1, 1)),
        (0.0, 1.0),
        (None, (1, 1, 1)),
        (("a", "b", "c"), (1, 1, 1)),
    ],
    ids=str,
)
def test_what_is_no_box_is_refused(low, high):
    with pytest.raises(InputError, match=r"workspace: got .*; expected x, y, z of two corners"):
        Workspace(low, high)


def test_the_lowest_point_is_that_of_all_circles(plate):
    circles = SalientCircles.of(plate)
    for rotation in Rotation.random(20, rng=np.random.default_rng(0)):
        T = RigidTransform.from_components([0.1, -0.2, 0.3], rotation)
        expected = min(T.apply(f.circle.sample(720))[:, 2].min() for f in plate.salient)
        assert circles.lowest(T.as_matrix()) == pytest.approx(expected, abs=1e-6)
