"""How many turns about z leave a solid unchanged, measured on its cross-sections."""

from __future__ import annotations

import cv2
import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.uint8]

SLICES = 32
MASK_PX = 512
MOST_FOLDS = 72
DIFFERENT = 1e-4  # share of the solid that may differ after a turn that leaves it unchanged
_SUBPIXEL_BITS = 6
_SLIVER = np.ones((3, 3), np.uint8)  # differences no wider than this are those of a circle drawn as a polygon
_GOLDEN_TURN = (5**0.5 - 1) / 2  # no multiple of it is a simple fraction of a turn


def symmetry_fold(solid: Manifold) -> int | None:
    """The number of equal turns about z that leave a solid unchanged; None where any turn does.

    The solid is cut into slices, and each compared with itself after a turn. Two discs with holes differ where a hole
    meets none; that the rims are polygons, and not the same ones after the turn, makes slivers that do not count.
    """
    x0, y0, z0, x1, y1, z1 = solid.bounding_box()
    pitch = (z1 - z0) / SLICES
    radius = float(np.hypot(max(-x0, x1), max(-y0, y1)))
    slices = [solid.slice(z0 + (k + 0.5) * pitch).to_polygons() for k in range(SLICES)]
    slices = [polygons for polygons in slices if polygons]
    masks = [_mask(polygons, 0.0, radius) for polygons in slices]
    limit = DIFFERENT * sum(int(mask.sum()) for mask in masks)

    def unchanged(turn: float) -> bool:
        different = 0
        for polygons, mask in zip(slices, masks, strict=True):
            different += int(cv2.erode(mask ^ _mask(polygons, 2 * np.pi * turn, radius), _SLIVER).sum())
            if different > limit:
                return False
        return True

    if all(unchanged(k * _GOLDEN_TURN) for k in range(1, 5)):
        return None
    return next((fold for fold in range(MOST_FOLDS, 1, -1) if unchanged(1 / fold)), 1)


def _mask(polygons: list[Floats], angle_rad: float, radius: float) -> Mask:
    """The cross-section after a turn about its origin, 1 inside, (MASK_PX, MASK_PX)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    to_px = np.array([[c, s], [-s, c]]) * (0.49 * MASK_PX / radius)
    fixed = [np.rint((p @ to_px + MASK_PX / 2) * 2**_SUBPIXEL_BITS).astype(np.int32) for p in polygons]
    mask = np.zeros((MASK_PX, MASK_PX), np.uint8)
    cv2.fillPoly(mask, fixed, 1, shift=_SUBPIXEL_BITS)
    return mask
