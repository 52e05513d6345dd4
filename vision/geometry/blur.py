"""Blur draws the edges of curved outlines inwards: by how much, and back."""

from __future__ import annotations

import numpy as np

from vision.geometry.focal_form import norm2, residual
from vision.kernels import njit

CAMERA_VARIANCE = 1 / 12 + 0.6**2
"""Variance in px² by which a sharp camera blurs: the area of a pixel, and a lens of 0.6 px."""

SOBEL_VARIANCE = 0.5
"""The same of the 3x3 Sobel operator, across its mask."""

_LARGEST_SHIFT_PX = 0.3
"""Beyond this, where an ellipse is as narrow as the blur, the shift is no longer in proportion to the curvature."""


@njit(cache=True)
def unshrink(p, points, variance):
    """Edge points (N, 2) of the ellipse p (focal form), put back to where they were before the image was blurred.

    A Gaussian of that variance draws the edge of a disc of radius r inwards by variance / 2r, bright discs and dark
    ones alike. The radius of curvature of an ellipse where the focal distances are s1 and s2 is (s1 s2)^1.5 / (a b).
    """
    focal = norm2(p[0] - p[2], p[1] - p[3])
    axes_product = 0.25 * p[4] * np.sqrt(max(p[4] * p[4] - focal * focal, 0.0))
    moved = np.empty_like(points)
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        _, ax, ay, bx, by, slope = residual(p, x, y)
        product = max(norm2(x - p[0], y - p[1]) * norm2(x - p[2], y - p[3]), 1e-18)
        shift = min(0.5 * variance * axes_product / (product * np.sqrt(product)), _LARGEST_SHIFT_PX) / slope
        moved[k, 0], moved[k, 1] = x + shift * (ax + bx), y + shift * (ay + by)
    return moved
