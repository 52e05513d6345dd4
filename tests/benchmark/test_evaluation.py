"""What counts as extracted, matched and false, on views that nobody has to draw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.episodes.evaluation import TruePiece, judge
from benchmark.models import load_model
from vision.features import EllipseFeature
from vision.geometry.camera import Camera, View
from vision.geometry.circle import project_circle
from vision.localizer import Localization
from vision.pose.estimate import PoseEstimate

CAMERA = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
POSE = RigidTransform.from_components([0.01, 0.02, 0.1], Rotation.from_euler("xyz", [10, -5, 40], degrees=True))
SALIENT = [feature.circle for feature in load_model("cover2").salient]


def view(x: float) -> View:
    """From 0.75 m above, beside the piece, looking at it."""
    towards = np.array([x, 0.0, -0.75]) / np.hypot(x, 0.75)
    right = np.array([-towards[2], 0.0, towards[0]])
    rotation = Rotation.from_matrix(np.column_stack([right, np.cross(towards, right), towards]))
    return View(np.zeros((480, 640), np.uint8), CAMERA, RigidTransform.from_components([-x, 0.02, 0.85], rotation))


VIEWS = [view(x) for x in (-0.2, 0.0, 0.2)]


def piece(pose: RigidTransform = POSE, in_bin: bool = True) -> TruePiece:
    return TruePiece("cover2", pose, 0.9, in_bin)


def feature(number: int, circle: int, extractor: str = "region") -> EllipseFeature:
    """The perfect image of a salient circle of the piece in a view."""
    ellipse = project_circle(SALIENT[circle].moved(POSE), VIEWS[number])
    return EllipseFeature(ellipse, extractor, np.empty((0, 2)), 1.0, 1.0)


def estimate(offset_m: float = 0.0, part: str = "cover2") -> PoseEstimate:
    pose = RigidTransform.from_translation([offset_m, 0, 0]) * POSE
    return PoseEstimate(part, pose, 1e-6 * np.eye(6), 1.0, "group", 0.1, 3, True)


def results(*features: EllipseFeature | None, estimates=(), alone=None):
    """What the verdict says of the piece, given one feature or none in each view."""
    found = tuple(() if f is None else (f,) for f in features)
    answer = Localization(tuple(estimates), found, alone or {"focal-region": (), "focal-group": ()})
    return judge(answer, "focal", [piece()], VIEWS).pieces[0].results


def test_a_piece_is_extracted_by_one_circle_in_two_views():
    assert results(feature(0, 0), None, feature(2, 0))["focal"].extracted


def test_two_circles_in_a_view_each_are_not_the_same_feature_twice():
    assert not results(feature(0, 0), None, feature(2, 1))["focal"].extracted


def test_one_view_is_not_enough():
    assert not results(feature(0, 0), None, None)["focal"].extracted


def test_an_extractor_is_credited_with_what_it_found_itself():
    found = results(feature(0, 0), feature(1, 0, "group"), feature(2, 0))
    assert {name: result.extracted for name, result in found.items()} == {
        "focal-region": True,
        "focal-group": False,
        "focal": True,
    }
    mixed = results(feature(0, 0), feature(1, 0, "group"), None)
    assert {name: result.extracted for name, result in mixed.items()} == {
        "focal-region": False,
        "focal-group": False,
        "focal": True,
    }


@pytest.mark.parametrize("name", ["outline_front", "hollow_back"])
def test_a_circle_that_faces_away_is_not_extracted(name):
    (circle,) = (f.circle.moved(POSE) for f in load_model("hub").salient if f.name == name)
    seen = tuple((EllipseFeature(project_circle(circle, v), "group", np.empty((0, 2)), 1.0, 1.0),) for v in VIEWS)
    hub = TruePiece("hub", POSE, 0.9, True)
    extracted = judge(Localization((), seen), "focal", [hub], VIEWS).pieces[0].results["focal"].extracted
    assert extracted == (name == "outline_front")


@pytest.mark.parametrize(
    ("offset_m", "part", "matched"), [(0.006, "cover2", True), (0.007, "cover2", False), (0.0, "cover1", False)]
)
def test_a_pose_within_a_tenth_of_the_diameter_matches_and_any_other_is_false(offset_m, part, matched):
    verdict = judge(Localization((estimate(offset_m, part),)), "focal", [piece()], VIEWS)
    assert verdict.pieces[0].results["focal"].matched == matched
    assert verdict.false_positives == {"focal": int(not matched)}
    assert verdict.owner == ((0,) if matched else (None,))


def test_probabilities_are_kept_of_right_poses_and_of_false_ones():
    right, wrong = (replace(estimate(offset), probability=p) for offset, p in ((0.0, 0.9), (0.05, 0.2)))
    verdict = judge(Localization((right, wrong, estimate(0.04))), "focal", [piece()], VIEWS)
    assert verdict.pieces[0].results["focal"].probability == 0.9
    assert verdict.false_probabilities == {"focal": (0.2,)}


def test_a_second_pose_of_a_piece_is_false():
    verdict = judge(Localization((estimate(0.003), estimate())), "focal", [piece()], VIEWS)
    assert verdict.false_positives == {"focal": 1}
    assert verdict.owner == (None, 0)
    assert verdict.pieces[0].results["focal"].errors.translation_mm < 1e-6


def test_the_stage_at_which_a_piece_was_lost():
    def stage(localization: Localization, **changes: object) -> str | None:
        return judge(localization, "focal", [piece(**changes)], VIEWS).pieces[0].failed_stage

    seen = tuple((feature(number, 0),) for number in range(3))
    assert stage(Localization((estimate(),))) is None
    assert stage(Localization((), seen)) == "matching"
    assert stage(Localization(())) == "extraction"
    assert stage(Localization((estimate(),)), in_bin=False) == "drop"
