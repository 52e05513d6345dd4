"""Intrinsic attributes of regions, their measurement on contours, and the constraints a vision model puts on them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.features import RegionAttributes
from vision.kernels import njit

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

    def violations(self, attributes: RegionAttributes) -> dict[str, str]:
        """The attributes that lie outside their bounds, and on which side: "small" or "large"."""
        return {
            name: "small" if getattr(attributes, name) < low else "large"
            for name, (low, high) in self._bounds()
            if not low <= getattr(attributes, name) <= high
        }

    def hold(self, **measured: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which of N things the constraints allow by the attributes given, each (N,), whatever the others are."""
        held = np.ones(np.broadcast_shapes(*(m.shape for m in measured.values())), np.bool_)
        for name, (low, high) in self._bounds():
            if name in measured:
                held &= (low <= measured[name]) & (measured[name] <= high)
        return held

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
    perimeter, enclosed, ellipse_complexity = _outline(contour, _SMOOTHING_PX)
    perimeter += np.pi  # half a pixel outwards: from pixel centres to their outer sides
    enclosed = max(enclosed + perimeter / 2, area_px)
    return perimeter, 4 * np.pi * area_px / perimeter**2, float(perimeter**2 / enclosed / ellipse_complexity)


@njit(cache=True)
def _outline(contour, reach):
    """Length of a closed pixel chain, the area inside, and perimeter² / area of the ellipse with its moments."""
    area, xx, xy, yy = _moments(contour)
    length = _length(contour, reach if len(contour) > 2 * (2 * reach + 1) else 0)
    if area <= 0:
        return length, 0.0, 4 * np.pi
    mean, difference = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    # Half a pixel more: from pixel centres to their outer sides.
    a = 2 * np.sqrt(max(mean + difference, 0.0)) + 0.5
    b = 2 * np.sqrt(max(mean - difference, 0.0)) + 0.5
    h = ((a - b) / (a + b)) ** 2
    perimeter = np.pi * (a + b) * (1 + 3 * h / (10 + np.sqrt(4 - 3 * h)))  # Ramanujan
    return length, area, perimeter**2 / (np.pi * a * b)


@njit(cache=True)
def _length(contour, reach):
    """Length of the closed chain of running means over 2 ``reach`` + 1 points."""
    n = len(contour)
    length = 0.0
    for i in range(n):
        # Neighbouring running means differ by the two points that enter and leave the window.
        enters, leaves = contour[(i + reach + 1) % n], contour[(i - reach) % n]
        length += np.hypot(float(enters[0] - leaves[0]), float(enters[1] - leaves[1]))
    return length / (2 * reach + 1)


@njit(cache=True)
def _moments(contour):
    """Area inside a closed polygon, and its central second moments xx, xy and yy over the area (Green's theorem)."""
    area = x_sum = y_sum = xx = xy = yy = 0.0
    origin_x, origin_y = contour[0, 0], contour[0, 1]
    for i in range(len(contour)):
        x0, y0 = float(contour[i - 1, 0] - origin_x), float(contour[i - 1, 1] - origin_y)
        x1, y1 = float(contour[i, 0] - origin_x), float(contour[i, 1] - origin_y)
        cross = x0 * y1 - x1 * y0
        area += cross / 2
        x_sum += cross * (x0 + x1) / 6
        y_sum += cross * (y0 + y1) / 6
        xx += cross * (x0 * x0 + x0 * x1 + x1 * x1) / 12
        xy += cross * (2 * x0 * y0 + x0 * y1 + x1 * y0 + 2 * x1 * y1) / 24
        yy += cross * (y0 * y0 + y0 * y1 + y1 * y1) / 12
    if area == 0:
        return 0.0, 0.0, 0.0, 0.0
    x, y = x_sum / area, y_sum / area
    return abs(area), xx / area - x * x, xy / area - x * y, yy / area - y * y
