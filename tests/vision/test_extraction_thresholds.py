"""The thresholds that a model carries reach the extractors, and by default change nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vision.errors import InputError
from vision.extraction import ExtractionThresholds
from vision.grouping.edge_grouping import GroupingParameters
from vision.localizer import EllipseLocalizer, common_thresholds, extract_features
from vision.regions.region_ellipses import BoundaryFitParameters
from vision.regions.segmentation import RegionGrowingParameters


@pytest.fixture(scope="module")
def view(photograph, pose):
    return photograph([pose()], views=1)[0]


def test_defaults_are_the_extractors_own():
    own = ExtractionThresholds()
    assert own.growing == RegionGrowingParameters()
    assert own.boundary_fit == BoundaryFitParameters()
    assert own.grouping == GroupingParameters.for_model()


@pytest.mark.parametrize(
    ("extractor", "deaf"),
    [
        ("region", {"canny_low": 90.0, "canny_high": 120.0, "homogeneity": 120.0}),
        ("region", {"boundary_error_px": 1e-3}),
        ("group", {"shortest_fragment_px": 2000.0}),
        ("group", {"noise_factor": 1000.0, "shortest_fragment_px": 500.0}),
        ("group", {"fitting_error_px": 1e-3}),
    ],
    ids=str,
)
def test_each_threshold_can_silence_its_extractor(extractor, deaf, view):
    assert len(extract_features(view, (extractor,))) >= 3
    assert len(extract_features(view, (extractor,), thresholds=ExtractionThresholds(**deaf))) <= 1


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_thresholds_that_are_no_thresholds_are_refused(value):
    with pytest.raises(InputError, match="homogeneity of ExtractionThresholds"):
        ExtractionThresholds(homogeneity=value)


def test_canny_thresholds_in_the_wrong_order_are_refused():
    with pytest.raises(InputError, match="canny_low <= canny_high"):
        ExtractionThresholds(canny_low=9.0, canny_high=8.0)


def test_a_localizer_takes_the_thresholds_that_its_models_agree_on(plate, view):
    adapted = replace(plate, thresholds=ExtractionThresholds(noise_factor=1000.0, shortest_fragment_px=500.0))
    assert common_thresholds([adapted, adapted]) == adapted.thresholds
    assert common_thresholds([adapted, plate]) == ExtractionThresholds()
    assert len(EllipseLocalizer([adapted], ("group",)).extraction(view).features) <= 1
    assert len(EllipseLocalizer([adapted, plate], ("group",)).extraction(view).features) >= 3
