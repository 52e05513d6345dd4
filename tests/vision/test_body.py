"""The body of a plate hides what lies behind it and leaves no room for another in the same place."""

from __future__ import annotations

import numpy as np
import pytest

from vision.model.solid import render_depth, share_inside
from vision.model.vision_model import SalientCircles


def test_a_plate_covers_its_disc_at_its_own_depth_and_nothing_else(plate, photograph, pose):
    T = pose(3, -4, 2, about=(6, -5, 10))
    (view,) = photograph([T], views=[1])
    depth = np.full(view.gray.shape, np.inf, np.float32)
    T_camera_part = view.T_world_camera.inv() * T
    render_depth(depth, T_camera_part.as_matrix(), view.camera, plate)
    inside, outside = ([0.026, 0.0, 0.0], [0.034, 0.0, 0.0])
    for point, hidden in ((inside, True), (outside, False)):
        u, v = np.round(view.project(T.apply([point]))[0]).astype(int)
        assert np.isfinite(depth[v, u]) == hidden
    u, v = np.round(view.project(T.apply([inside]))[0]).astype(int)
    assert depth[v, u] == pytest.approx(T_camera_part.apply([inside])[0, 2], abs=0.006)


def test_a_nearer_part_is_not_overwritten_and_one_behind_the_camera_covers_nothing(plate, photograph, pose):
    (view,) = photograph([], views=[1])
    near, far = pose(0, 0, 12), pose(0, 0, -12)
    once = np.full(view.gray.shape, np.inf, np.float32)
    T_camera_world = np.linalg.inv(view.T_world_camera.as_matrix())
    render_depth(once, T_camera_world @ near.as_matrix(), view.camera, plate)
    twice = once.copy()
    render_depth(twice, T_camera_world @ far.as_matrix(), view.camera, plate)
    assert (twice <= once).all()
    assert np.array_equal(twice[np.isfinite(once)], once[np.isfinite(once)])
    untouched = once.copy()
    behind = view.T_world_camera.as_matrix() @ np.diag([1.0, 1.0, -1.0, 1.0])
    behind[:3, 3] = view.T_world_camera.translation - 0.3 * view.T_world_camera.as_matrix()[:3, 2]
    render_depth(untouched, T_camera_world @ behind, view.camera, plate)
    assert np.array_equal(untouched, once)


def test_two_plates_cannot_be_in_one_place(plate, pose):
    circles = SalientCircles.of(plate)
    thickness = circles.height.max() - circles.height.min()
    found = pose(0, 0, 0, about=(10, 5, 0))
    beside, above, through = (found * pose(x, y, z, about=a) for x, y, z, a in (
        (61, 0, 0, (0, 0, 0)), (0, 0, 1e3 * thickness, (0, 0, 0)), (15, 0, 3, (0, 0, 0))))  # fmt: skip
    poses = np.stack([T.as_matrix() for T in (beside, above, through)])
    share = share_inside(poses, found.as_matrix(), circles)
    assert share[:2].tolist() == [0, 0]
    assert share[2] > 0.15
