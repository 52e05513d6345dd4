"""What a wrong calibration does to poses is what their covariance says it does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from vision.errors import InputError
from vision.geometry.workspace import Workspace
from vision.localizer import EllipseLocalizer
from vision.matching.parameters import MatchingParameters
from vision.pose.calibration import CalibrationError
from vision.pose.observations import Observations
from vision.pose.refinement import refine_pose

SHOPFLOOR = CalibrationError(0.5e-3, np.radians(0.1), 0.1e-3, 0.2)
SOURCES = {
    "hand-eye translation": CalibrationError(hand_eye_translation_m=1e-3),
    "hand-eye rotation": CalibrationError(hand_eye_rotation_rad=2e-3),
    "arm": CalibrationError(arm_translation_m=0.3e-3),
    "lens": CalibrationError(lens_px=1.0),
    "shop floor": SHOPFLOOR,
}


def seen_from(views, contour, truth, lens):
    """The true images of the model's points, through a lens whose distortion the calibration does not know."""
    projections = [contour.project(truth.as_matrix(), view) for view in views]
    pixels = [lens(view.camera, p.pixels) for view, p in zip(views, projections, strict=True)]
    index = np.concatenate([p.index for p in projections])
    view = np.concatenate([np.full(len(p.index), v) for v, p in enumerate(projections)])
    normals = np.concatenate([p.normals for p in projections])
    seen = Observations(
        view, contour.points[index], np.concatenate(pixels), normals, np.full(len(view), 0.3), contour.circle[index]
    )
    return lambda _pose, _iteration: seen


def drawn_lens(rng, lens_px):
    """Radial and tangential distortion, each one as large in the corner as the others on average."""
    terms = np.eye(5)[[0, 2, 3]]
    weights = rng.normal(scale=lens_px / np.sqrt(3), size=3)

    def lens(camera, pixels):
        corner = np.array([[camera.width_px - 0.5, camera.height_px - 0.5]])
        moved = pixels.copy()
        for term, weight in zip(terms, weights, strict=True):
            distorted = replace(camera, distortion=tuple(1e-3 * term))
            largest = np.linalg.norm(distorted.project(camera.rays(corner)) - corner)
            moved += weight * (distorted.project(camera.rays(pixels)) - pixels) / largest
        return moved

    return lens


def misbelieved(views, rng, error):
    """The views with the poses that a drawn calibration error makes one believe."""
    hand_eye = RigidTransform.from_components(
        rng.normal(scale=error.hand_eye_translation_m / np.sqrt(3), size=3),
        Rotation.from_rotvec(rng.normal(scale=error.hand_eye_rotation_rad / np.sqrt(3), size=3)),
    )
    out = []
    for view in views:
        arm = RigidTransform.from_translation(rng.normal(scale=error.arm_translation_m / np.sqrt(3), size=3))
        out.append(replace(view, T_world_camera=arm * view.T_world_camera * hand_eye))
    return out


def refined(views, contour, truth, error, seed):
    rng = np.random.default_rng(seed)
    observe = seen_from(views, contour, truth, drawn_lens(rng, error.lens_px))
    believed = misbelieved(views, rng, error)
    found = refine_pose(truth.as_matrix(), observe, believed, iterations=5, inplane=True, calibration=error)
    return pose_error(found.T_world_part, truth), found.covariance


def pose_error(T, truth):
    turn = Rotation.from_matrix(T[:3, :3]) * truth.rotation.inv()
    return np.concatenate([T[:3, 3] - truth.translation, turn.as_rotvec()])


@pytest.fixture
def agreeing_views(photograph):
    """Three views from nearby whose cameras are turned alike: an error moves all of them the same way."""
    first = photograph([], views=1)[0]
    around = [Rotation.from_euler("xy", (x, y), degrees=True) for x, y in ((0, 0), (8, 3), (-6, 9))]
    return [
        replace(first, T_world_camera=RigidTransform.from_rotation(turn) * first.T_world_camera) for turn in around
    ]


@pytest.mark.parametrize("source", SOURCES)
def test_the_covariance_says_how_far_a_wrong_calibration_moves_the_pose(source, contour, truth, agreeing_views):
    error = SOURCES[source]
    errors, covariances = zip(
        *(refined(agreeing_views, contour, truth, error, seed) for seed in range(120)), strict=True
    )
    _, anyway = refined(agreeing_views, contour, truth, CalibrationError(), 0)
    # Not the mean: contradictory views may leave psi no curvature, and then a covariance can be of any size.
    claimed = np.sqrt(np.median(np.diagonal(covariances, axis1=1, axis2=2), axis=0) - np.diag(anyway))
    happened = np.sqrt(np.mean(np.square(errors), axis=0))
    told = happened > np.sqrt(np.diag(anyway))
    assert told.any()
    # It may allow for more than happened, as it counts with views that drop out, but hardly for less.
    assert np.all(claimed[told] > 0.8 * happened[told])
    assert np.all(claimed[told] < 4 * happened[told])


@pytest.mark.parametrize("seed", [0, 1000])
def test_the_ellipsoid_holds_the_true_pose_though_the_views_contradict_each_other(seed, contour, truth, photograph):
    views = photograph([])  # turned against each other: the same mounting error moves each another way
    drawn = [refined(views, contour, truth, SHOPFLOOR, seed + i) for i in range(100)]
    inside = [e @ np.linalg.solve(C, e) < chi2(6).ppf(0.95) for e, C in drawn]
    assert np.mean(inside) > 0.9


def test_a_pose_that_is_not_told_of_the_error_is_sure_and_wrong(contour, truth, agreeing_views):
    def inside(told):
        rng = np.random.default_rng(3)
        counted = []
        for _ in range(50):
            believed = misbelieved(agreeing_views, rng, SHOPFLOOR)
            observe = seen_from(agreeing_views, contour, truth, lambda _, pixels: pixels)
            found = refine_pose(truth.as_matrix(), observe, believed, iterations=5, inplane=True, calibration=told)
            e = pose_error(found.T_world_part, truth)
            counted.append(e @ np.linalg.solve(found.covariance, e) < chi2(6).ppf(0.95))
        return np.mean(counted)

    assert inside(SHOPFLOOR) > 0.9
    assert inside(CalibrationError()) < 0.1


def test_a_localizer_told_of_the_calibration_is_less_sure_of_the_same_poses(plate, pose, photograph):
    truth = pose(-10, 6, 1, about=(5, 3, 11))
    views, workspace = photograph([truth]), Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))
    (exact,) = EllipseLocalizer([plate]).localize(views, workspace).estimates
    zero = MatchingParameters(calibration=CalibrationError())
    (same,) = EllipseLocalizer([plate], parameters=zero).localize(views, workspace).estimates
    told = MatchingParameters(calibration=SHOPFLOOR)
    (unsure,) = EllipseLocalizer([plate], parameters=told).localize(views, workspace).estimates
    assert np.array_equal(same.covariance, exact.covariance)
    assert np.array_equal(unsure.T_world_part.as_matrix(), exact.T_world_part.as_matrix())
    assert np.linalg.eigvalsh(unsure.covariance - exact.covariance).min() > 0
    assert np.trace(unsure.covariance[:3, :3]) > 4 * np.trace(exact.covariance[:3, :3])


@pytest.mark.parametrize("wrong", [-1e-3, np.nan, np.inf])
@pytest.mark.parametrize("field", ["hand_eye_translation_m", "hand_eye_rotation_rad", "arm_translation_m", "lens_px"])
def test_sizes_that_are_none_are_refused(field, wrong):
    with pytest.raises(InputError, match=field):
        CalibrationError(**{field: wrong})
