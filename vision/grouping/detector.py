"""The ellipse detector without a model: edge grouping at full resolution, then at half of it for what is left.

Soft and noisy outlines are clear in a smaller image, small ones only in the full one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_map import as_gray
from vision.features import EllipseFeature
from vision.geometry.ellipse import Ellipse
from vision.grouping.duplicates import is_known
from vision.grouping.edge_grouping import Grouping, GroupingParameters, group_edges

Array = NDArray[np.float64]

MAX_PX = 1600  # longer side; larger images are looked at with half the resolution
MIN_COARSE_PX = 64
MIN_COARSE_SEMI_MAJOR_PX = 5.0  # of the smaller image
MIN_COARSE_SCORE = 0.3
MAX_COARSE_HYPOTHESES, MAX_COARSE_ATTEMPTS = 400, 80  # less is left to be found there
COARSE_OVERLAP = 0.75  # half the resolution does not tell the two edges of a rim apart
COARSE_HYSTERESIS = 0.5  # there is less noise there, and more of a faint outline can be followed


@dataclass(frozen=True, eq=False)
class Detection:
    """What both looks found.

    Attributes:
        grouping: of the first look, in pixels of the image that was looked at.
        factor: side of these pixels in those of the given image: 1 unless that is too large.
        coarse: what only the second look showed, in pixels of the given image.
    """

    grouping: Grouping
    factor: int
    coarse: tuple[EllipseFeature, ...]

    @property
    def features(self) -> list[EllipseFeature]:
        """All ellipses in pixels of the given image, best first."""
        found = [_enlarged(feature, self.factor) for feature in self.grouping.features]
        return sorted([*found, *self.coarse], key=lambda feature: -feature.score)


def detect_ellipses(gray: NDArray[np.generic], parameters: GroupingParameters | None = None) -> Array:
    """Look for ellipses in a photograph, at full resolution and at half of it: their numbers alone, an array (N, 5).

    :func:`find_ellipses` tells score, edge points and covariance of the same ellipses; ``group_ellipses`` looks once.

    Args:
        gray: (H, W) uint8 grey levels; (H, W, 3) RGB is converted.
        parameters: thresholds; the defaults are meant for photographs.

    Returns:
        (N, 5) centre x, centre y, semi-major axis, semi-minor axis in pixels (a whole number is the centre of a
        pixel), angle of the major axis in radians from x towards y; best first. N may be 0.

    Raises:
        InputError: when ``gray`` is not an image, see :func:`vision.edges.edge_map.as_gray`.
    """
    return np.array([f.ellipse.geometric for f in find_ellipses(gray, parameters)]).reshape(-1, 5)


def find_ellipses(gray: NDArray[np.generic], parameters: GroupingParameters | None = None) -> list[EllipseFeature]:
    """Look for ellipses in a photograph, at full resolution and at half of it: with score, edge points, covariance.

    :func:`detect_ellipses` gives the same ellipses in bare numbers; ``group_ellipses`` looks once, as matching does.

    Images with more than 1600 px along a side are halved first, which bounds the time. So do ``max_hypotheses`` and
    ``max_attempts``: among very many ellipses those made of the longest edges are found.

    Args:
        gray: as for :func:`detect_ellipses`.
        parameters: thresholds.

    Returns:
        Features, best first. The score, from 0 to 1, is the probability of a true ellipse by a logistic model of
        coverage, accuracy, size and surroundings (see ``vision/grouping/score.py``), raised by concentric neighbours.

    Raises:
        InputError: as :func:`detect_ellipses`.
    """
    return detect(gray, parameters).features


def detect(gray: NDArray[np.generic], parameters: GroupingParameters | None = None) -> Detection:
    """Both looks of :func:`find_ellipses`, apart; arguments and errors are the same."""
    parameters = parameters or GroupingParameters()
    image, factor = halved(as_gray(gray))
    grouping = group_edges(image, _scaled(parameters, factor, image))
    if min(image.shape) < MIN_COARSE_PX:
        return Detection(grouping, factor, ())
    known = np.array([f.ellipse.p for f in grouping.features]).reshape(-1, 5)
    half = np.asarray(cv2.pyrDown(image), np.uint8)
    second = group_edges(half, _scaled(_coarse(parameters), 2 * factor, half))
    coarse = (_enlarged(feature, 2 * factor) for feature in second.features)
    new = (f for f in coarse if not is_known(f.ellipse.p / factor, known, len(known), COARSE_OVERLAP, np.inf))
    return Detection(grouping, factor, tuple(new))


def halved(image: NDArray[np.uint8], most_px: int = MAX_PX) -> tuple[NDArray[np.uint8], int]:
    """Halve an image, (H, W) or (H, W, 3), until neither side is longer than this.

    Returns:
        The smaller image, and the side of its pixels in those of the given one; the centres of its pixels are those
        of every so many.
    """
    factor = 1
    while max(image.shape[:2]) > most_px:
        image, factor = np.asarray(cv2.pyrDown(image), np.uint8), 2 * factor
    return image, factor


def _coarse(parameters: GroupingParameters) -> GroupingParameters:
    """The parameters of the look at half the resolution."""
    return replace(
        parameters,
        edges=replace(parameters.edges, hysteresis=min(parameters.edges.hysteresis, COARSE_HYSTERESIS)),
        min_score=max(parameters.min_score, MIN_COARSE_SCORE),
        max_hypotheses=min(parameters.max_hypotheses, MAX_COARSE_HYPOTHESES),
        max_attempts=min(parameters.max_attempts, MAX_COARSE_ATTEMPTS),
    )


def _scaled(parameters: GroupingParameters, factor: int, image: NDArray[np.uint8]) -> GroupingParameters:
    """The parameters for an image whose pixels are ``factor`` of the given one wide."""
    if factor == 1:
        return parameters
    smallest, largest = parameters.size_px or (0.0, factor * float(max(image.shape)))
    smallest = max(smallest / factor, MIN_COARSE_SEMI_MAJOR_PX)
    return replace(parameters, size_px=(smallest, max(largest / factor, smallest)))


def _enlarged(feature: EllipseFeature, factor: int) -> EllipseFeature:
    """A feature of a smaller image, whose pixels have their centres on every ``factor``-th one of the larger."""
    if factor == 1:
        return feature
    covariance = feature.ellipse.covariance
    ellipse = Ellipse(factor * feature.ellipse.p, None if covariance is None else factor**2 * covariance)
    return replace(feature, ellipse=ellipse, points=factor * feature.points)
