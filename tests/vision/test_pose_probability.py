"""The probability of a pose: between none and one, and greater the more confirms it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError
from vision.localizer import EllipseLocalizer
from vision.matching.parameters import MatchingParameters
from vision.pose.estimate import PoseEstimate
from vision.pose.probability import USUAL_WEIGHTS, ProbabilityWeights, probability


def test_more_of_anything_that_confirms_it_makes_a_pose_more_likely():
    least = probability(USUAL_WEIGHTS, 0.5, False, 0.3)
    assert 0 < least < probability(USUAL_WEIGHTS, 0.6, False, 0.3) < 1
    assert least < probability(USUAL_WEIGHTS, 0.5, True, 0.3)
    assert least < probability(USUAL_WEIGHTS, 0.5, False, 0.4)


def test_the_model_is_a_logistic_one():
    weights = ProbabilityWeights(score=2.0, turned=1.0, shown=3.0, constant=4.0)
    assert probability(weights, 0.5, True, 0.5) == pytest.approx(1 / (1 + np.exp(0.5)))


def test_the_probability_of_a_pose_is_that_of_what_confirms_it(plate, photograph, pose):
    views = photograph([pose(-20, 0, 0, about=(5, 3, 11))])
    weights = ProbabilityWeights(score=1.0, turned=0.5, shown=2.0, constant=1.0)
    for model, turned in ((plate, True), (replace(plate, symmetry_fold=None), True)):
        localizer = EllipseLocalizer([model], parameters=MatchingParameters(probability_weights=weights))
        (found,) = localizer.localize(views).estimates
        assert 0.9 < found.shown <= 1
        assert found.probability == probability(weights, found.score, turned, found.shown)


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
