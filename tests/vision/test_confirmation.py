"""Edges of drawn plates confirm the pose in which they were drawn, and no other."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.edges.edge_field import EdgeField
from vision.matching.scene_edges import SceneEdges, turned
from vision.model.contour import ModelContour

SCALE = 4200.0
FLIP = RigidTransform.from_rotation(Rotation.from_euler("x", 180, degrees=True))


@pytest.fixture(scope="module")
def contour(plate):
    return ModelContour.of(plate, SCALE)


@pytest.fixture
def front(pose):
    return pose(4, -6, 1, about=(5, -8, 17))


def edges_of(views):
    return SceneEdges(views, [EdgeField.from_gray(v.gray) for v in views])


def evidence_of(scene, T, contour):
    """Evidence of a single pose (RigidTransform or 4x4), as plain numbers."""
    matrix = T.as_matrix() if isinstance(T, RigidTransform) else T
    evidence = scene.evidence(matrix[None], contour)
    supporting = scene.evidence(matrix[None], contour.asymmetric()).score
    return SimpleNamespace(**{name: value[0] for name, value in vars(evidence).items()}, supporting=supporting[0])


def angle_between(a, b, fold):
    """Rotation about z between two 4x4 poses of equal axes, degrees, up to the symmetry."""
    R = a[:3, :3].T @ b[:3, :3]
    angle = np.degrees(np.arctan2(R[1, 0], R[0, 0]))
    period = 360 / fold
    return abs((angle + period / 2) % period - period / 2)


def test_the_true_pose_is_confirmed(front, photograph, contour):
    evidence = evidence_of(edges_of(photograph([front])), front, contour)
    assert evidence.score > 0.9
    assert evidence.salient > 0.9
    assert evidence.supporting > 0.9
    assert evidence.views == 3


def test_turned_and_flipped_poses_are_confirmed_less(front, photograph, contour):
    scene = edges_of(photograph([front]))
    truth = evidence_of(scene, front, contour)
    for degrees in (15, 40, 60):
        wrong = evidence_of(scene, turned(front.as_matrix(), np.radians([degrees]))[0], contour)
        assert wrong.supporting < 0.3 * truth.supporting
        assert wrong.salient == pytest.approx(truth.salient, abs=0.05)
    flipped = evidence_of(scene, (front * FLIP), contour)
    assert flipped.score < 0.7 * truth.score


def test_a_back_is_not_taken_for_a_front(pose, photograph, contour):
    back = pose(4, -6, 1, about=(185, 6, 0))
    scene = edges_of(photograph([back]))
    truth, flipped = (evidence_of(scene, T, contour) for T in (back, back * FLIP))
    assert truth.score > 0.9
    assert truth.supporting == 0
    assert flipped.score < 0.75 * truth.score
    assert flipped.supporting < 0.3


def test_support_falls_as_the_pose_moves_away(front, photograph, contour, pose):
    scene = edges_of(photograph([front]))
    scores = [evidence_of(scene, (pose(x) * front), contour).score for x in (0, 0.5, 1, 4)]
    assert (np.diff(scores) < 0).all()
    assert scores[-1] < 0.3


def test_no_edges_no_evidence(front, photograph, contour):
    evidence = evidence_of(edges_of(photograph([], noise=0)), front, contour)
    assert (evidence.score, evidence.salient, evidence.supporting) == (0, 0, 0)


def test_views_count_only_where_the_part_is_seen(front, photograph, contour):
    seen, unseen = photograph([front], views=[0, 1]), photograph([], views=[2])
    assert evidence_of(edges_of(seen + unseen), front, contour).views == 2


@pytest.mark.parametrize("start_deg", [0, 31, 77, 119, 200, -45])
def test_rotation_about_the_axis_is_found_from_any_start(start_deg, front, photograph, contour):
    scene = edges_of(photograph([front]))
    found, known = scene.find_inplane(turned(front.as_matrix(), np.radians([start_deg]))[0], contour, fold=3)
    assert known
    assert angle_between(found, front.as_matrix(), fold=3) < 0.7
    assert np.allclose(found[:3, 2:], front.as_matrix()[:3, 2:])


@pytest.mark.parametrize("least", [1, 40, 97])
def test_one_copy_looked_at_all_round_tells_what_all_copies_do(least, front, photograph, plate, monkeypatch):
    monkeypatch.setattr("vision.model.contour.INPLANE_STRIDE", 1)
    scene, contour = edges_of(photograph([front])), ModelContour.of(plate, SCALE)
    support = scene.inplane_support_all_round(front.as_matrix(), contour, 3, least)
    n = 3 * len(support)
    assert n >= least
    angles = np.arange(len(support)) * 2 * np.pi / n
    assert np.allclose(support, scene.inplane_support(front.as_matrix(), contour, angles), atol=1e-12)


def test_rotation_stays_unknown_where_no_supporting_feature_is_seen(pose, photograph, contour):
    back = pose(4, -6, 1, about=(185, 6, 0))
    _, known = edges_of(photograph([back])).find_inplane(back.as_matrix(), contour, fold=3)
    assert not known


def test_rotation_stays_unknown_where_several_are_supported_alike(front, photograph, contour):
    _, known = edges_of(photograph([front])).find_inplane(front.as_matrix(), contour, fold=1)
    assert not known


def test_what_little_a_part_shows_must_speak_for_more_than_itself(front, photograph, contour, pose, plate):
    behind = pose(9, 7, -20) * front
    scene = edges_of(photograph([behind, front]))
    scene.claim(front.as_matrix(), contour, plate)
    hidden = evidence_of(scene, behind, contour)
    alone = evidence_of(edges_of(photograph([behind])), behind, contour)
    assert 0.3 < hidden.score < alone.score - 0.1
    assert hidden.promise < alone.promise


def test_claimed_edges_no_longer_support(front, photograph, contour, pose, plate):
    other = pose(33, 38, 0, about=(3, 4, 0))
    front = pose(-30, -20) * front
    scene = edges_of(photograph([front, other], views=[0, 1, 3]))
    before = evidence_of(scene, other, contour)
    scene.claim(front.as_matrix(), contour, plate)
    assert evidence_of(scene, front, contour).score < 0.02
    assert evidence_of(scene, other, contour).score > before.score - 0.02
    assert len(scene.observe(front.as_matrix(), contour, 2.0).of_view) < 20


def test_a_pose_that_no_edges_support_claims_none(front, photograph, contour, pose, plate):
    scene = edges_of(photograph([front]))
    before = evidence_of(scene, front, contour).score
    scene.claim((pose(6, 6) * front).as_matrix(), contour, plate)
    assert evidence_of(scene, front, contour).score > before - 0.1


def test_observed_edges_lie_on_the_contour_and_belong_to_their_view(front, photograph, contour):
    views = photograph([front], noise=0)
    seen = edges_of(views).observe(front.as_matrix(), contour, 2.0)
    assert set(seen.of_view) == {0, 1, 2}
    for v, view in enumerate(views):
        mine = seen.of_view == v
        expected = view.project(front.apply(seen.points_part[mine].copy()))
        off = np.einsum("ij,ij->i", seen.pixels[mine] - expected, seen.normals[mine])
        assert mine.sum() > 200
        assert abs(off.mean()) < 0.05
        assert np.abs(off).max() < 0.4


@pytest.mark.parametrize("millimetres", [(0.4, -0.3, 0.6), (-0.5, 0.5, -1.0)])
def test_the_nearest_edges_bring_a_moved_pose_back(millimetres, front, photograph, contour, pose):
    scene = edges_of(photograph([front]))
    poses = (pose(*millimetres, about=(0.8, -0.6, 0)) * front).as_matrix()[None].copy()
    assert scene.align(poses, contour, (6.0, 5.0, 4.0, 3.0, 3.0), inplane=False).all()
    assert np.linalg.norm(poses[0, :3, 3] - front.translation) < 0.1e-3
    assert poses[0, :3, 2] @ front.as_matrix()[:3, 2] > np.cos(np.radians(0.3))


def test_alignment_without_edges_says_so(front, photograph, contour):
    poses = front.as_matrix()[None].copy()
    assert not edges_of(photograph([], noise=0)).align(poses, contour, (3.0,), inplane=True).any()
    assert np.array_equal(poses[0], front.as_matrix())


def test_what_a_claimed_part_hides_is_not_held_against_a_pose(front, photograph, contour, pose, plate):
    """A plate below another: its support is counted over what remains in sight."""
    below = pose(8, 3, -12) * front
    scene = edges_of(photograph([below, front]))
    before = evidence_of(scene, below, contour).score
    scene.claim(front.as_matrix(), contour, plate)
    assert evidence_of(scene, below, contour).score > before
    scene.forget_claims()
    scene.claim(front.as_matrix(), contour, plate, hiding=False)
    assert evidence_of(scene, below, contour).score <= before
    scene.forget_claims()
    assert evidence_of(scene, below, contour).score == before


def test_turning_is_about_the_part_itself(front):
    T = turned(front.as_matrix(), np.array([0.3]))[0]
    assert np.allclose(T[:3, 3], front.translation)
    assert np.allclose(front.rotation.as_matrix().T @ T[:3, :3], Rotation.from_rotvec([0, 0, 0.3]).as_matrix())
