from __future__ import annotations

import numpy as np
import pytest

from vision.model.contour import ModelContour
from vision.pose.estimate import FeatureSupport, features_supported


def test_copies_in_sight_are_counted_and_averaged() -> None:
    holes = FeatureSupport("hole", "supporting", (1.0, None, 0.5, 0.2))
    assert (holes.in_sight, holes.confirmed) == (3, 2)
    assert holes.support == pytest.approx(1.7 / 3)


def test_nothing_in_sight_has_no_support() -> None:
    assert FeatureSupport("hole", "supporting", (None, None)).support is None


def test_support_goes_to_the_feature_whose_copy_a_circle_is(plate) -> None:
    contour = ModelContour.of(plate, 4000.0)
    support = np.linspace(0.1, 0.8, 8)
    samples = np.array([9, 9, 9, 0, 0, 9, 0, 9])
    told = features_supported(plate, contour.circle_feature, support, samples)
    assert [f.name for f in told] == [f.name for f in plate.features]
    assert told[3].copies == told[4].copies == (None,)
    assert told[5].copies == pytest.approx((0.6, None, 0.8))
    assert [f.role for f in told] == ["salient"] * 5 + ["supporting"]
