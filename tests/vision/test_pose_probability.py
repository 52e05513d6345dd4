"""The probability of a pose: between none and one, and greater the more confirms it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.localizer import EllipseLocalizer
from vision.matching.parameters import MatchingParameters
from vision.pose.estimate import FeatureSupport, PoseEstimate
from vision.pose.probability import ProbabilityWeights, pose_probability


def estimate(score=0.5, turned=False, shown=0.3, weakest=0.4):
    features = (FeatureSupport("rim", "salient", (0.9, weakest, None)), FeatureSupport("hole", "supporting", (0.1,)))
    T = RigidTransform.identity()
    return PoseEstimate("hub", T, np.eye(6), score, "region", 0.1, 3, turned, features, shown)


def test_more_of_anything_that_confirms_it_makes_a_pose_more_likely():
    least = pose_probability(estimate())
    assert 0 < least < 1
    for more in ({"score": 0.6}, {"turned": True}, {"shown": 0.4}, {"weakest": 0.5}):
        assert least < pose_probability(estimate(**more)) < 1


def test_the_model_is_a_logistic_one():
    weights = ProbabilityWeights(evidence=2.0, turned=1.0, weakest=3.0, constant=4.0)
    odds = 2 * 0.5 * 0.5 + 1 + 3 * 0.4 - 4
    for pose, turn_matters in ((estimate(shown=0.25, turned=True), True), (estimate(shown=0.25), False)):
        found = pose_probability(pose, weights, turn_matters=turn_matters)
        assert found == pytest.approx(1 / (1 + np.exp(-odds)))


def test_the_probability_of_a_pose_is_that_of_what_confirms_it(plate, photograph, pose):
    views = photograph([pose(-20, 0, 0, about=(5, 3, 11))])
    weights = ProbabilityWeights(evidence=1.0, turned=0.5, weakest=2.0, constant=1.0)
    for fold in (3, None):
        model = replace(plate, symmetry_fold=fold)
        localizer = EllipseLocalizer([model], parameters=MatchingParameters(probability_weights=weights))
        (found,) = localizer.localize(views).estimates
        assert found.inplane_known == (fold is not None)
        assert 0.9 < found.shown <= 1
        assert found.probability == pose_probability(found, weights, turn_matters=fold is not None) > 0.85


def test_a_part_that_another_one_hides_shows_less(plate, photograph, pose):
    front, behind = pose(0, 0, 30), pose(25, 0, 0)
    found = EllipseLocalizer([plate]).localize(photograph([behind, front])).estimates
    shown = {round(1e3 * e.T_world_part.translation[2] / 30): e.shown for e in found}
    assert shown[0] < shown[1] - 0.1


@pytest.mark.parametrize("name", ["shown", "probability"])
@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_a_share_is_one(name, value):
    with pytest.raises(InputError, match=f"{name} of a pose"):
        PoseEstimate("hub", RigidTransform.identity(), np.eye(6), 0.9, "region", 0.1, 3, True, **{name: value})
