"""Intrinsic attributes of regions, their measurement on contours, and the constraints a vision model puts on them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Protocol, TypeVar

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.errors import InputError
from vision.features import RegionAttributes

Contour = NDArray[np.int32]
Bounds = tuple[float, float]

_SMOOTHING_PX = 2
"""Contour points averaged on either side when measuring length: undoes the staircase of the pixel grid."""


class HasAttributes(Protocol):
    """Anything with the attributes of a region."""

    @property
    def attributes(self) -> RegionAttributes:
        """The intrinsic attributes."""


R = TypeVar("R", bound=HasAttributes)


@dataclass(frozen=True)
class AttributeConstraints:
    """The (min, max) that a vision model allows for each attribute of a region; None allows any (Section 5.1).

    The names are those of :class:`vision.features.RegionAttributes`.
    """

    area_px: Bounds | None = None
    perimeter_px: Bounds | None = None
    circularity: Bounds | None = None
    shape_complexity: Bounds | None = None
    grey_mean: Bounds | None = None
    grey_deviation: Bounds | None = None

    def __post_init__(self) -> None:
        for name, bounds in self._bounds():
            if len(bounds) != 2 or not bounds[0] <= bounds[1]:
                raise InputError(f"constraint on {name}", got=bounds, expected="(min, max) with min <= max, or None")

    def allow(self, attributes: RegionAttributes) -> bool:
        """Whether every attribute lies within its bounds, ends included."""
        return all(low <= getattr(attributes, name) <= high for name, (low, high) in self._bounds())

    def prune(self, regions: Iterable[R]) -> list[R]:
        """The regions that are left after pruning, in their order (Fig. 7 b)."""
        return [region for region in regions if self.allow(region.attributes)]

    def _bounds(self) -> list[tuple[str, Bounds]]:
        named = ((f.name, getattr(self, f.name)) for f in fields(self))
        return [(name, bounds) for name, bounds in named if bounds is not None]


def measure_shape(contour: Contour, area_px: float) -> tuple[float, float, float]:
    """Perimeter, circularity and shape complexity of a region.

    Args:
        contour: (N, 2) boundary pixels of the region, in order.
        area_px: its number of pixels, holes not counted.

    Returns:
        perimeter_px, circularity, shape_complexity as in :class:`vision.features.RegionAttributes`.
    """
    perimeter = _length(contour) + np.pi  # half a pixel outwards: from pixel centres to their outer sides
    enclosed, ellipse_complexity = _moment_ellipse(contour)
    enclosed = max(enclosed + perimeter / 2, area_px)
    return perimeter, 4 * np.pi * area_px / perimeter**2, float(perimeter**2 / enclosed / ellipse_complexity)


def _length(contour: Contour) -> float:
    """Length of a closed pixel chain, smoothed."""
    if len(contour) <= 2 * (2 * _SMOOTHING_PX + 1):
        return float(cv2.arcLength(contour, True))
    return float(_smoothed_length(contour, _SMOOTHING_PX))


@njit(cache=True)
def _smoothed_length(contour, reach):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Length of the closed chain of running means over 2 ``reach`` + 1 points."""
    n = len(contour)
    width = 2 * reach + 1
    length = 0.0
    for i in range(n):
        # Neighbouring running means differ by the two points that enter and leave the window.
        enters, leaves = contour[(i + reach + 1) % n], contour[(i - reach) % n]
        length += np.hypot(float(enters[0] - leaves[0]), float(enters[1] - leaves[1])) / width
    return length


def _moment_ellipse(contour: Contour) -> tuple[float, float]:
    """Area inside the contour, and perimeter² / area of the ellipse that has its second moments."""
    m = cv2.moments(contour)
    area = m["m00"]
    if area <= 0:
        return 0.0, 4 * np.pi
    mean, difference = (m["mu20"] + m["mu02"]) / 2, math.hypot((m["mu20"] - m["mu02"]) / 2, m["mu11"])
    # Half a pixel more: from pixel centres to their outer sides.
    a, b = (2 * math.sqrt(max(moment / area, 0.0)) + 0.5 for moment in (mean + difference, mean - difference))
    h = ((a - b) / (a + b)) ** 2
    perimeter = math.pi * (a + b) * (1 + 3 * h / (10 + math.sqrt(4 - 3 * h)))  # Ramanujan
    return area, perimeter**2 / (math.pi * a * b)
