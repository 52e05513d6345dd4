"""Every setting of every extractor and of matching refuses what it cannot be, and names itself."""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass

import numpy as np
import pytest

from vision.edges.edge_map import EdgeParameters
from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.grouping.edge_grouping import GroupingParameters
from vision.grouping.fragments import FragmentParameters
from vision.grouping.kalman_filter import FilterParameters
from vision.grouping.score import DEFAULT_WEIGHTS, ScoreWeights
from vision.matching.parameters import ConfirmationParameters, MatchingParameters
from vision.pose.edge_errors import EdgeErrors
from vision.pose.probability import USUAL_WEIGHTS, ProbabilityWeights
from vision.regions.quadtree import SplitAndMergeParameters
from vision.regions.region_ellipses import BoundaryFitParameters
from vision.regions.segmentation import RegionGrowingParameters
from vision.settings import POSITIVE, SHARE, Allowed, check, count

SETTINGS = (
    *(
        EdgeParameters,
        FragmentParameters,
        FilterParameters,
        GroupingParameters,
        SplitAndMergeParameters,
        RegionGrowingParameters,
    ),
    *(BoundaryFitParameters, MatchingParameters, ConfirmationParameters, EdgeErrors, ExtractionThresholds),
)


def numbers():
    """Class, name and default value of every setting that is a number or a tuple of numbers."""
    found = []
    for settings in SETTINGS:
        for field in fields(settings):
            value = getattr(settings(), field.name)
            if (
                not is_dataclass(value)
                and value is not None
                and not isinstance(value, bool | ScoreWeights | ProbabilityWeights)
            ):
                found.append(pytest.param(settings, field.name, value, id=f"{settings.__name__}.{field.name}"))
    return found


@pytest.mark.parametrize(("settings", "name", "default"), numbers())
@pytest.mark.parametrize("wrong", [math.nan, -math.inf, -5, "5", None, True], ids=str)
def test_a_setting_refuses_what_it_cannot_be(settings, name, default, wrong):
    value = (*default[:-1], wrong) if isinstance(default, tuple) else wrong
    with pytest.raises(InputError, match=name):
        settings(**{name: value})


@pytest.mark.parametrize(("settings", "name", "default"), numbers())
def test_a_limit_is_finite_unless_it_may_be_switched_off(settings, name, default):
    value = (*default[:-1], math.inf) if isinstance(default, tuple) else math.inf
    if name == "max_apart_px":
        settings(**{name: value})
        return
    with pytest.raises(InputError, match=name):
        settings(**{name: value})


@pytest.mark.parametrize(("settings", "name", "default"), numbers())
def test_a_setting_may_be_a_number_of_numpy(settings, name, default):
    value = tuple(np.array(default)) if isinstance(default, tuple) else np.array(default)[()]
    assert getattr(settings(**{name: value}), name) == default


@pytest.mark.parametrize(
    ("settings", "wrong"),
    [
        (EdgeParameters, {"hysteresis": 1.01}),
        (EdgeParameters, {"min_contrast": 9.0}),
        (EdgeParameters, {"max_gap_px": 2.5}),
        (GroupingParameters, {"min_score": 1.01}),
        (GroupingParameters, {"size_px": (5.0,)}),
        (GroupingParameters, {"size_px": (5.0, math.nan)}),
        (GroupingParameters, {"max_attempts": 10.5}),
        (GroupingParameters, {"weights": DEFAULT_WEIGHTS._replace(error=math.nan)}),
        (GroupingParameters, {"weights": DEFAULT_WEIGHTS._replace(chain=-1.0)}),
        (MatchingParameters, {"probability_weights": None}),
        (MatchingParameters, {"probability_weights": USUAL_WEIGHTS._replace(weakest=math.inf)}),
        (MatchingParameters, {"probability_weights": USUAL_WEIGHTS._replace(evidence=-1.0)}),
        (GroupingParameters, {"weights": tuple(DEFAULT_WEIGHTS)}),
        (FilterParameters, {"iterations": 0}),
        (MatchingParameters, {"candidates": 0}),
        (MatchingParameters, {"minimum_scores": ()}),
        (MatchingParameters, {"minimum_scores": 0.6}),
        (MatchingParameters, {"reach_px": [2.5]}),
        (EdgeParameters, {"smoothing_px": (1.0,)}),
        (MatchingParameters, {"loose_reach_px": 1.0}),
        (ConfirmationParameters, {"reach_px": 1.0}),
        (ConfirmationParameters, {"least_shown": 0.0}),
        (ConfirmationParameters, {"most_peaks": 0}),
        (MatchingParameters, {"depth_shares": (0.0, -1.0)}),
        (MatchingParameters, {"doubtful_scores": (0.6, 0.2)}),
        (MatchingParameters, {"doubtful_scores": (0.2, 0.4, 0.6)}),
        (RegionGrowingParameters, {"gap_px": 1.5}),
        (BoundaryFitParameters, {"min_axis_ratio": 1.5}),
    ],
    ids=str,
)
def test_limits_of_a_setting(settings, wrong):
    (name,) = wrong
    with pytest.raises(InputError, match=name if name != "min_contrast" else "max_contrast"):
        settings(**wrong)


@pytest.mark.parametrize(
    ("allowed", "good", "bad", "text"),
    [
        (POSITIVE, [1e-9, 5], [0, -1, math.inf], "a finite number > 0"),
        (SHARE, [0, 1], [-1e-9, 1 + 1e-9], "a finite number >= 0 and <= 1"),
        (count(2), [2, np.int64(3)], [1, 2.0], "a whole number >= 2"),
        (Allowed(0, infinite=True), [0, math.inf], [-1, math.nan], "a number >= 0"),
        (Allowed(high=3), [-7, 3], [3.1, -math.inf], "a finite number <= 3"),
    ],
)
def test_what_is_allowed(allowed, good, bad, text):
    assert all(allowed.holds(value) for value in good)
    assert not any(allowed.holds(value) for value in [*bad, "1", None, True, [1]])
    assert str(allowed) == text


def test_the_message_names_the_setting_and_what_it_may_be():
    class Some:
        reach_px = (1.0, -1.0)

    expected = r"^reach_px of Some: got \(1\.0, -1\.0\); expected a tuple with .* number, each a finite number > 0$"
    with pytest.raises(InputError, match=expected):
        check(Some(), reach_px=POSITIVE)
