"""Matching of drawn plates from the ellipses that an extractor without error would find."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.edges.edge_field import EdgeField
from vision.extraction import Arc
from vision.features import EllipseFeature
from vision.geometry.circle import project_circle
from vision.geometry.workspace import Workspace
from vision.matching.hypotheses import HypothesisGenerator
from vision.matching.matcher import Matcher
from vision.matching.parameters import MatchingParameters
from vision.model.contour import ModelContour
from vision.pose.refinement import refine_pose

WORKSPACE = Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))


def perfect(model, poses, views):
    """The ellipses of all salient circles that face the cameras."""
    features = []
    for view in views:
        circles = [f.circle.moved(T) for T in poses for f in model.salient]
        facing = [c for c in circles if c.normal @ (view.T_world_camera.translation - c.centre) > 0]
        ellipses = [project_circle(c, view) for c in facing]
        features.append([EllipseFeature(e, "group", e.sample(60), 1.0, 1.0) for e in ellipses])
    return features


def matcher(model, views, workspace=WORKSPACE, **parameters):
    fields = [EdgeField.from_gray(v.gray) for v in views]
    return Matcher(views, fields, model, workspace, MatchingParameters(**parameters))


def errors(found: RigidTransform, truth: RigidTransform, fold: int):
    """Distance in mm and rotation in degrees, up to the plate's symmetry."""
    turns = Rotation.from_rotvec(np.outer(np.arange(fold) * 2 * np.pi / fold, [0, 0, 1]))
    angles = ((truth.rotation * turns).inv() * found.rotation).magnitude()
    return 1e3 * np.linalg.norm(found.translation - truth.translation), np.degrees(angles.min())


def tilt(found, truth):
    return np.degrees(np.arccos(np.clip(found.as_matrix()[:3, 2] @ truth.as_matrix()[:3, 2], -1, 1)))


@pytest.fixture
def scene(pose):
    return [pose(-33, 0, 0, about=(5, 3, 11)), pose(33, 4, 1, about=(-4, 6, 70))]


@pytest.mark.parametrize("joint", [True, False])
def test_every_plate_is_found_once_and_in_place(joint, plate, scene, photograph):
    views = photograph(scene)
    found = matcher(plate, views, joint_edges=joint).match(perfect(plate, scene, views))
    assert len(found) == 2
    for truth in scene:
        nearest = min(found, key=lambda e: errors(e.T_world_part, truth, 3)[0])
        distance, angle = errors(nearest.T_world_part, truth, 3)
        assert distance < 0.05
        assert angle < (0.1 if joint else 1.0)
        assert nearest.inplane_known
        assert nearest.views == 3
        assert nearest.score > 0.9
        assert nearest.part == "plate"
        assert nearest.extractor == "group"


def test_a_part_that_was_found_claims_its_edges(plate, scene, photograph):
    views = photograph(scene[:1])
    matching = matcher(plate, views)
    outline = project_circle(plate.salient[0].circle.moved(scene[0]), views[0]).sample(100)
    arc = Arc(outline, np.zeros_like(outline))
    assert matching.scene.unclaimed(0, [arc], 1) == [arc]
    matching.match(perfect(plate, scene[:1], views))
    assert matching.scene.unclaimed(0, [arc], 1) == []


def test_no_place_is_taken_twice_and_no_pose_stands_without_support(plate, scene, photograph):
    views = photograph(scene[:1])
    matching = matcher(plate, views)
    features = perfect(plate, scene[:1], views)
    (found,) = matching.match(features)
    assert matching._stands(found, 0.5, [])
    assert not matching._stands(found, 1.1, [])
    assert not matching._stands(found, 0.5, [found])


def test_on_ellipses_alone_the_pose_starts_from_stereo(plate, scene, photograph, monkeypatch):
    starts = []

    def refine(T, *arguments, **settings):
        starts.append(T)
        return refine_pose(T, *arguments, **settings)

    monkeypatch.setattr("vision.matching.matcher.refine_pose", refine)
    monkeypatch.setattr("vision.matching.matcher.pose_by_stereo", lambda *_: scene[0].as_matrix())
    views = photograph(scene[:1])
    matcher(plate, views, joint_edges=False).match(perfect(plate, scene[:1], views))
    assert starts
    assert all(np.array_equal(T, scene[0].as_matrix()) for T in starts)


def test_a_plate_on_its_face_is_found_so_and_its_turn_is_unknown(plate, photograph, pose):
    truth = pose(3, 6, -2, about=(176, 7, 0))
    views = photograph([truth])
    (found,) = matcher(plate, views).match(perfect(plate, [truth], views))
    assert errors(found.T_world_part, truth, 3)[0] < 0.05
    assert tilt(found.T_world_part, truth) < 0.1
    assert not found.inplane_known
    about_axis = (
        found.T_world_part.as_matrix()[:3, 2] @ found.covariance[3:, 3:] @ found.T_world_part.as_matrix()[:3, 2]
    )
    assert about_axis == pytest.approx(np.pi**2 / 3, rel=1e-3)


def test_an_estimate_tells_which_features_confirm_it(plate, photograph, pose):
    front = pose(4, 3, 0, about=(5, 3, 11))
    (found,) = matcher(plate, photograph([front])).match(perfect(plate, [front], photograph([front])))
    assert [f.name for f in found.features] == [f.name for f in plate.features]
    assert [f.role for f in found.features] == [f.role for f in plate.features]
    told = {f.name: f for f in found.features}
    for name in ("outline_front", "ring_front", "bore_front", "hole_front"):
        assert told[name].in_sight == told[name].confirmed == len(told[name].copies)
        assert told[name].support > 0.9
    assert len(told["hole_front"].copies) == 3
    for name in ("outline_back", "bore_back"):
        assert told[name].copies == (None,)
        assert told[name].support is None


def test_ellipses_without_edges_are_no_plates(plate, scene, photograph):
    views = photograph([])
    assert matcher(plate, views).match(perfect(plate, scene, views)) == []


def test_edges_without_ellipses_are_no_plates(plate, scene, photograph):
    assert matcher(plate, photograph(scene)).match([[], [], []]) == []


def test_plates_outside_the_workspace_are_not_found(plate, scene, photograph):
    views = photograph(scene)
    left = Workspace((-0.08, -0.08, -0.03), (0.0, 0.08, 0.03))
    (found,) = matcher(plate, views, left).match(perfect(plate, scene, views))
    assert errors(found.T_world_part, scene[0], 3)[0] < 0.05


def test_ellipses_that_belong_to_nothing_do_no_harm(plate, scene, photograph):
    views = photograph(scene)
    features = perfect(plate, scene, views)
    rng = np.random.default_rng(10_003)
    for found in features:
        for _ in range(15):
            stray = project_circle(plate.salient[rng.integers(5)].circle, views[0])
            stray = type(stray)(stray.p + np.append(np.tile(rng.uniform(-150, 150, 2), 2), rng.uniform(5, 50)))
            found.append(EllipseFeature(stray, "region", stray.sample(60), 0.6, 0.5))
    found = matcher(plate, views).match(features)
    assert len(found) == 2
    for truth in scene:
        assert min(errors(e.T_world_part, truth, 3)[0] for e in found) < 0.05


def test_the_best_come_first_and_none_is_below_the_minimum(plate, scene, photograph):
    views = photograph(scene)
    features = perfect(plate, scene, views)
    scores = [e.score for e in matcher(plate, views).match(features)]
    assert scores == sorted(scores, reverse=True)
    assert matcher(plate, views, minimum_scores=(1.01,)).match(features) == []


def test_covariance_is_symmetric_positive_and_of_the_size_of_the_error(plate, scene, photograph):
    views = photograph(scene)
    found = matcher(plate, views).match(perfect(plate, scene, views))
    assert len(found) == len(scene)
    for estimate in found:
        assert np.allclose(estimate.covariance, estimate.covariance.T, rtol=1e-6, atol=1e-18)
        assert (np.linalg.eigvalsh(estimate.covariance) > 0).all()
        assert 1e-7 < np.sqrt(np.trace(estimate.covariance[:3, :3])) < 1e-4


def test_the_same_images_give_the_same_poses(plate, scene, photograph):
    views = photograph(scene)
    features = perfect(plate, scene, views)
    first, second = (matcher(plate, views).match(features) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.T_world_part.as_matrix(), b.T_world_part.as_matrix())


@pytest.mark.parametrize("share", [-0.035, -0.012, 0.0, 0.023])
def test_a_pose_that_fits_one_view_at_a_wrong_depth_is_moved_to_where_the_others_agree(
    share, plate, photograph, pose
):
    truth = pose(4, -6, 1, about=(5, -8, 17))
    views = photograph([truth])
    of_plate = matcher(plate, views)
    contour = ModelContour.of(plate, views[0].camera.fx / 0.5)
    generator = HypothesisGenerator(of_plate.scene, of_plate.circles, contour, of_plate.parameters)
    wrong = truth.as_matrix()
    wrong[:3, 3] += share * (wrong[:3, 3] - views[0].T_world_camera.translation)
    moved = RigidTransform.from_matrix(generator.supported_by_others(wrong, 0, inplane=True))
    distance, angle = errors(moved, truth, 3)
    assert distance < 0.1
    assert angle < 0.3


def test_a_plate_that_would_reach_through_the_floor_is_not_taken(plate, pose, photograph):
    leaning = pose(0, 0, 0, about=(40, 0, 11))
    views = photograph([leaning])
    flat_bin = Workspace((-0.08, -0.08, -0.004), (0.08, 0.08, 0.03))
    found = {
        slack: matcher(plate, views, flat_bin, floor_slack=slack).match(perfect(plate, [leaning], views))
        for slack in (0.05, 1.0)
    }
    assert found[0.05] == []
    assert len(found[1.0]) == 1
