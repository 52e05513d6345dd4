"""What the other ellipses of a picture say about one of them.

Rims, wheels, cups and rings come in pairs with one centre and one shape, and accidental curves do not: a concentric
neighbour speaks for an ellipse, the more so the surer it is itself.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.ellipse_support import axes

Array = NDArray[np.float64]

# Of ellipses that count as concentric: largest distance of their centres over the smaller semi-minor axis, largest
# difference of their shapes, and smallest ratio of their sizes; what is closer is the same outline once more.
_MAX_ECCENTRICITY, _MAX_SHAPE_DIFFERENCE, _MIN_SIZE_RATIO = 0.15, 0.15, 1.12


def concentric_support(ps: Array, scores: Array) -> Array:
    """Score of the best ellipse that is concentric with each, or 0.

    Args:
        ps: (S, 5) focal parameters.
        scores: (S,) of the ellipses by themselves.

    Returns:
        (S,) scores.
    """
    return np.asarray(_concentric_support(ps, scores))


@njit(cache=True)
def _shapes(ps):  # type: ignore[no-untyped-def]
    """(S, 6) centre, semi-minor axis, geometric mean of the semi-axes, and flatness along the doubled angle."""
    shapes = np.empty((len(ps), 6))
    for k in range(len(ps)):
        x, y, major, minor, cos, sin = axes(ps[k])
        flatness = 1 - minor / major
        shapes[k] = x, y, minor, np.sqrt(major * minor), flatness * (cos * cos - sin * sin), flatness * 2 * cos * sin
    return shapes


@njit(cache=True)
def _are_concentric(a, b):  # type: ignore[no-untyped-def]
    """Whether two ellipses (rows of :func:`_shapes`) have one centre and one shape, and different sizes."""
    apart = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2
    if apart > (_MAX_ECCENTRICITY * min(a[2], b[2])) ** 2:
        return False
    unlike = (a[4] - b[4]) ** 2 + (a[5] - b[5]) ** 2
    return unlike < _MAX_SHAPE_DIFFERENCE**2 and max(a[3], b[3]) > _MIN_SIZE_RATIO * min(a[3], b[3])


@njit(cache=True)
def _concentric_support(ps, scores):  # type: ignore[no-untyped-def]
    shapes, best = _shapes(ps), np.zeros(len(ps))
    for i in range(len(ps)):
        for j in range(len(ps)):
            if scores[j] > best[i] and _are_concentric(shapes[i], shapes[j]):
                best[i] = scores[j]
    return best
