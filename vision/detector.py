"""The ellipse detector without a model: edge grouping at full resolution, then at half of it for what is left.

Soft and noisy outlines are clear in a smaller image, small ones only in the full one.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vision.edges import as_gray
from vision.ellipse import Ellipse
from vision.ellipse_pairs import is_known
from vision.features import EllipseFeature
from vision.grouping import GroupingParameters, group_ellipses

Array = NDArray[np.float64]

MAX_PX = 1600  # longer side; larger images are looked at with half the resolution
MIN_COARSE_PX = 64
MIN_COARSE_SEMI_MAJOR_PX = 5.0  # of the smaller image
MIN_COARSE_SCORE = 0.3
MAX_COARSE_HYPOTHESES, MAX_COARSE_ATTEMPTS = 400, 80  # less is left to be found there
COARSE_OVERLAP = 0.75  # half the resolution does not tell the two edges of a rim apart
COARSE_HYSTERESIS = 0.5  # there is less noise there, and more of a faint outline can be followed


def detect_ellipses(gray: NDArray[np.generic], parameters: GroupingParameters | None = None) -> Array:
    """Find the ellipses in a photograph: those that edges show at full resolution, then others at half of it.

    The order is that of the score; :func:`find_ellipses` returns it, with the edge points and covariances.

    Args:
        gray: (H, W) uint8 grey levels; (H, W, 3) RGB is converted.
        parameters: thresholds; the defaults are meant for photographs.

    Returns:
        (N, 5) centre x, centre y, semi-major axis, semi-minor axis in pixels (a whole number is the centre of a
        pixel), angle of the major axis in radians from x towards y; best first. N may be 0.

    Raises:
        InputError: when ``gray`` is not an image, see :func:`vision.edges.as_gray`.
    """
    return np.array([f.ellipse.geometric for f in find_ellipses(gray, parameters)]).reshape(-1, 5)


def find_ellipses(gray: NDArray[np.generic], parameters: GroupingParameters | None = None) -> list[EllipseFeature]:
    """The ellipses of :func:`detect_ellipses` with all that is known of them.

    Images with more than 1600 px along a side are halved first, which bounds the time. So do ``max_hypotheses`` and
    ``max_attempts``: among very many ellipses those made of the longest edges are found.

    Args:
        gray: as for :func:`detect_ellipses`.
        parameters: thresholds.

    Returns:
        Features, best first. The score, from 0 to 1, is the probability of a true ellipse by a logistic model of
        coverage, accuracy, size and surroundings (see ``vision/ellipse_score.py``), raised by concentric neighbours.

    Raises:
        InputError: as :func:`detect_ellipses`.
    """
    parameters = parameters or GroupingParameters()
    image, factor = _shrunk(as_gray(gray))
    found = _scaled_ellipses(image, factor, parameters)
    if min(image.shape) >= MIN_COARSE_PX:
        known = np.array([f.ellipse.p for f in found]).reshape(-1, 5)
        half = np.asarray(cv2.pyrDown(image), np.uint8)
        for feature in _scaled_ellipses(half, 2 * factor, _coarse(parameters)):
            if not is_known(feature.ellipse.p, known, len(known), COARSE_OVERLAP, np.inf):
                found.append(feature)
        found.sort(key=lambda feature: -feature.score)
    return found


def _coarse(parameters: GroupingParameters) -> GroupingParameters:
    """The parameters of the look at half the resolution."""
    return replace(
        parameters,
        edges=replace(parameters.edges, hysteresis=min(parameters.edges.hysteresis, COARSE_HYSTERESIS)),
        min_score=max(parameters.min_score, MIN_COARSE_SCORE),
        max_hypotheses=min(parameters.max_hypotheses, MAX_COARSE_HYPOTHESES),
        max_attempts=min(parameters.max_attempts, MAX_COARSE_ATTEMPTS),
    )


def _shrunk(image: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], int]:
    """The image, halved until it is not too large, and the side of its pixels in those of the given one."""
    factor = 1
    while max(image.shape) > MAX_PX:
        image, factor = np.asarray(cv2.pyrDown(image), np.uint8), 2 * factor
    return image, factor


def _scaled_ellipses(image: NDArray[np.uint8], factor: int, parameters: GroupingParameters) -> list[EllipseFeature]:
    """What is found in an image whose pixels are ``factor`` of the given one wide, in pixels of the given one."""
    if factor == 1:
        return group_ellipses(image, parameters)
    smallest, largest = parameters.size_px or (0.0, factor * float(max(image.shape)))
    size_px = (max(smallest / factor, MIN_COARSE_SEMI_MAJOR_PX), largest / factor)
    if size_px[0] > size_px[1]:
        return []
    return [_enlarged(f, factor) for f in group_ellipses(image, replace(parameters, size_px=size_px))]


def _enlarged(feature: EllipseFeature, factor: int) -> EllipseFeature:
    """A feature of a smaller image, whose pixels have their centres on every ``factor``-th one of the larger."""
    covariance = feature.ellipse.covariance
    ellipse = Ellipse(factor * feature.ellipse.p, None if covariance is None else factor**2 * covariance)
    return replace(feature, ellipse=ellipse, points=factor * feature.points)
