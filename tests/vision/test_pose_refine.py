"""Gauss-Newton refinement of a pose against points whose images are computed, not seen."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.pose.edge_errors import USUAL
from vision.pose.observations import Observations
from vision.pose.refinement import refine_pose

SIGMA_PX = 0.3


def observer(contour, truth, views, noise=None, outliers=None):
    """Sees the true images of the model's points, displaced across the contour by noise or outliers."""
    projections = [contour.project(truth.as_matrix(), view) for view in views]
    view = np.concatenate([np.full(len(p.index), v) for v, p in enumerate(projections)])
    index = np.concatenate([p.index for p in projections])
    pixels = np.concatenate([p.pixels for p in projections])
    normals = np.concatenate([p.normals for p in projections])
    if noise is not None:
        pixels = pixels + noise(view, contour.circle[index], normals)[:, None] * normals
    if outliers is not None:
        wrong = np.arange(0, len(pixels), 5)
        pixels[wrong] += outliers * normals[wrong]
    seen = Observations(
        view, contour.points[index], pixels, normals, np.full(len(view), SIGMA_PX), contour.circle[index]
    )
    return lambda _pose, _iteration: seen


def shaken(truth, rng, millimetres, degrees):
    def direction():
        v = rng.normal(size=3)
        return v / np.linalg.norm(v)

    turn = Rotation.from_rotvec(np.radians(degrees) * direction())
    return RigidTransform.from_components(
        truth.translation + 1e-3 * millimetres * direction(), turn * truth.rotation
    ).as_matrix()


def error(T, truth):
    """Translation in metres and rotation vector in radians, both in the world frame (6,)."""
    turn = Rotation.from_matrix(T[:3, :3]) * truth.rotation.inv()
    return np.concatenate([T[:3, 3] - truth.translation, turn.as_rotvec()])


@pytest.mark.parametrize("seed", range(10_020, 10_028))
def test_the_true_pose_is_reached_from_five_millimetres_and_two_degrees(seed, contour, truth, photograph):
    views = photograph([])
    start = shaken(truth, np.random.default_rng(seed), 5, 2)
    refined = refine_pose(start, observer(contour, truth, views), views, iterations=8, inplane=True)
    assert np.abs(error(refined.T_world_part, truth)).max() < 1e-8
    assert refined.residual_px < 1e-5


def test_a_fifth_of_gross_outliers_does_not_move_the_pose(contour, truth, photograph):
    views = photograph([])
    rng = np.random.default_rng(10_030)
    refined = refine_pose(
        shaken(truth, rng, 0.5, 0.3),
        observer(contour, truth, views, outliers=6.0),
        views,
        iterations=10,
        inplane=True,
    )
    assert np.abs(error(refined.T_world_part, truth)).max() < 1e-6
    assert np.count_nonzero(refined.weights < 1e-6) == pytest.approx(len(refined.weights) / 5, abs=1)


def errors_of_edges(rng, sigma_px):
    """What light does to edges: noise at each point, a shift of each view, a swelling of each rim in it."""

    def draw(view, circle, normals):
        total = rng.normal(scale=sigma_px, size=len(view))
        for v in np.unique(view):
            mine = view == v
            total[mine] += normals[mine] @ rng.normal(scale=USUAL.shift_px, size=2)
            for c in np.unique(circle[mine]):
                total[mine & (circle == c)] += rng.normal(scale=USUAL.swell_px)
        return total

    return draw


def test_covariance_covers_the_scatter_over_such_errors_and_is_not_three_times_as_wide(contour, truth, photograph):
    views = photograph([])
    draw = errors_of_edges(np.random.default_rng(10_031), SIGMA_PX)
    draws, covariances = [], []
    for _ in range(200):
        observe = observer(contour, truth, views, noise=draw)
        refined = refine_pose(truth.as_matrix(), observe, views, iterations=5, inplane=True)
        draws.append(error(refined.T_world_part, truth))
        covariances.append(refined.covariance)
    squared = [e @ np.linalg.solve(C, e) for e, C in zip(draws, covariances, strict=True)]
    # Chi-square of six degrees of freedom has the mean 6. The covariance allows for more than these errors.
    assert 1.5 < np.mean(squared) < 7.5
    ratio = np.std(draws, axis=0) / np.sqrt(np.mean([np.diag(C) for C in covariances], axis=0))
    assert (ratio > 1 / 3).all()
    assert (ratio < 1.25).all()


def test_covariance_grows_with_the_noise(contour, truth, photograph):
    views = photograph([])
    sizes = []
    for sigma in (0.1, 0.8):
        observe = observer(contour, truth, views, noise=errors_of_edges(np.random.default_rng(10_032), sigma))
        sizes.append(np.trace(refine_pose(truth.as_matrix(), observe, views, iterations=5, inplane=True).covariance))
    assert sizes[1] > 1.05 * sizes[0]


def test_rotation_about_the_axis_is_held_when_asked(contour, truth, photograph):
    views = photograph([])
    turned = truth * RigidTransform.from_rotation(Rotation.from_euler("z", 20, degrees=True))
    start = shaken(turned, np.random.default_rng(10_033), 2, 0)
    circles = contour.points[:, 2] > 0
    outline = circles & (contour.circle == 0)
    # The same rim, seen as circles are: which of its points is which cannot be told.
    projections = [view.project(truth.apply(contour.points[outline])) for view in views]

    def observe(T, _):
        blocks = []
        for v, (view, pixels) in enumerate(zip(views, projections, strict=True)):
            mine = contour.project(T, view)
            mine_outline = contour.circle[mine.index] == 0
            index, normals, where = mine.index[mine_outline], mine.normals[mine_outline], mine.pixels[mine_outline]
            nearest = np.linalg.norm(where[:, None] - pixels[None], axis=2).argmin(axis=1)
            blocks.append((np.full(len(index), v), contour.points[index], pixels[nearest], normals))
        view, points, pixels, normals = (np.concatenate([b[k] for b in blocks]) for k in range(4))
        return Observations(view, points, pixels, normals, np.full(len(view), SIGMA_PX), np.zeros(len(view), int))

    refined = refine_pose(start, observe, views, iterations=10, inplane=False)
    relative = truth.rotation.inv() * Rotation.from_matrix(refined.T_world_part[:3, :3])
    assert np.degrees(relative.as_euler("zyx")[0]) == pytest.approx(20, abs=0.05)
    assert np.degrees(np.abs(relative.as_euler("zyx")[1:])).max() < 0.1
    assert 1e3 * np.linalg.norm(refined.T_world_part[:3, 3] - truth.translation) < 0.1


def test_too_few_points_are_no_refinement(contour, truth, photograph):
    views = photograph([])
    seen = observer(contour, truth, views)(None, 0)
    few = Observations(*(values[:11] for values in seen))
    assert refine_pose(truth.as_matrix(), lambda *_: few, views, iterations=3, inplane=True) is None


def test_start_is_left_as_it_was(contour, truth, photograph):
    views = photograph([])
    start = shaken(truth, np.random.default_rng(10_034), 5, 2)
    before = start.copy()
    refine_pose(start, observer(contour, truth, views), views, iterations=3, inplane=True)
    assert np.array_equal(start, before)
