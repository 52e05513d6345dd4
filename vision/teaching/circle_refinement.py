"""The last step from marks to a circle: once the views agree roughly, look again where the circle must be seen.

Along part of a rim there is often no edge of its own, but another one nearby: the foot of a boss, the far flank of
the thin dark line that a chamfer makes, the edge of what lies behind. Marks of a single view cannot tell; the views
together can, for what is not the circle moves from view to view.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from vision.edges.edge_field import SMOOTHING_PX, EdgeField
from vision.geometry.blur import CAMERA_VARIANCE, unshrink
from vision.geometry.camera import View
from vision.geometry.circle import Circle, project_circle
from vision.geometry.ellipse import Ellipse
from vision.teaching.circle_fit import Sightings, fit_circle

Array = NDArray[np.float64]

_ROUNDS = ((2.5, 0.5), (2.0, 0.3), (1.5, 0.2), (1.5, 0.2))
"""How far to look for the edge, and from which distance a point counts less, in pixels."""

_CLEAR_SLOPE = 25.0
"""Grey levels per pixel of an edge that counts half: the position of an edge is the surer, the steeper it is."""

_BLUR_VARIANCE = SMOOTHING_PX**2 + 1 / 3 + CAMERA_VARIANCE
"""Between a rim and its measured edge, px²: of the edge field, of differences over two pixels, of the camera."""

_LINE_REACH_PX = 4.0
"""Within which an edge of the other sign makes the two the flanks of a line."""

_FEWEST_POINTS = 12


def refine_circle(
    circle: Circle, freedom: Array, seen_in: Collection[int], views: Sequence[View], fields: Sequence[EdgeField]
) -> Circle:
    """Fit a circle to the edges that the views show where it is, the clear ones above all.

    Args:
        circle: where it is within about two pixels.
        freedom: (D, 6) directions of (centre, two of the normal, radius) along which it may move.
        seen_in: numbers of the views that show it.
        views: all views, with distortion-free lenses.
        fields: their edges.

    Returns:
        The circle, itself where fewer than two views show edges.
    """
    for reach, loss_px in _ROUNDS:
        marks, weights = {}, {}
        for v in seen_in:
            image = project_circle(circle, views[v])
            points, slopes = _edge_points(image, fields[v], reach)
            if image is not None and len(points) >= _FEWEST_POINTS:
                marks[v], weights[v] = points, _clearness(points, image, slopes, fields[v])
        if len(marks) < 2:
            break
        circle = fit_circle(Sightings.of(views, marks, weights), circle, freedom, "cauchy", loss_px).circle
    return circle


def _edge_points(image: Ellipse | None, field: EdgeField, reach_px: float) -> tuple[Array, Array]:
    """Edge points (N, 2) near an ellipse, put back to where they were before blur, and their slopes (N,)."""
    if image is None:
        return np.empty((0, 2)), np.empty(0)
    contour = image.sample(int(np.clip(np.pi * image.semi_axes[0], 24, 240)))
    normals = image.normals(contour)
    offsets, slopes = field.measure(contour, normals, reach_px)
    found = np.isfinite(offsets) & field.inside(contour)
    points = contour[found] + offsets[found, None] * normals[found]
    return np.asarray(unshrink(image.p, points, _BLUR_VARIANCE)), slopes[found]


def _clearness(points: Array, image: Ellipse, slopes: Array, field: EdgeField) -> Array:
    """How much (N,) an edge counts: faint ones little, and the flanks of thin lines.

    The two flanks of a line push each other apart when they are blurred.
    """
    normals = image.normals(points)
    steps = np.arange(-_LINE_REACH_PX, _LINE_REACH_PX + 0.5, 0.5)
    nearby = (points[:, None] + steps[:, None] * normals[:, None]).reshape(-1, 2)
    profile = field.slope(nearby, np.repeat(normals, len(steps), axis=0)).reshape(len(points), -1)
    opposite = np.nanmax(np.maximum(-profile * np.sign(slopes)[:, None], 0.0), axis=1)
    alone = np.clip(1 - opposite / np.maximum(np.abs(slopes), 1e-6), 0, 1) ** 2
    return np.asarray(slopes**2 / (slopes**2 + _CLEAR_SLOPE**2) * alone)
