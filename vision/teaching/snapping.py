"""From a few clicks near a contour to the edge itself: fit, look along the normals, fit again."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vision.edges.edge_field import EdgeField
from vision.errors import InputError
from vision.geometry.ellipse import Ellipse
from vision.geometry.ellipse_fit import fit_ellipse

Array = NDArray[np.float64]

MINIMUM_CLICKS = 5
LEAST_SPREAD = 0.02  # across the clicks over along them; an ellipse seen within a degree of edge on has less


def ellipse_through(clicks: ArrayLike) -> Ellipse:
    """The ellipse through five or more clicks (N, 2).

    Raises:
        InputError: for fewer clicks, or clicks that no ellipse passes near.
    """
    points = np.asarray(clicks, dtype=np.float32)
    if points.ndim != 2 or points.shape[1:] != (2,) or len(points) < MINIMUM_CLICKS or not np.isfinite(points).all():
        raise InputError(
            "clicks", got=f"an array {points.shape}", expected=f"at least {MINIMUM_CLICKS} finite points (x, y)"
        )
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < LEAST_SPREAD * spread[0]:
        raise InputError("clicks", got="points on a line", expected="points around an ellipse", do="Spread them out.")
    (x, y), (width, height), degrees = cv2.fitEllipseDirect(points)
    if not np.isfinite([x, y, width, height]).all() or min(width, height) <= 0:
        raise InputError("clicks", got="points on a line", expected="points around an ellipse", do="Spread them out.")
    angle = np.radians(degrees)
    if width >= height:
        return Ellipse.from_geometric(x, y, width / 2, height / 2, angle)
    return Ellipse.from_geometric(x, y, height / 2, width / 2, angle + np.pi / 2)


def snap_to_edge(clicks: ArrayLike, field: EdgeField, reach_px: float = 2.5) -> tuple[Ellipse, Array]:
    """The contour that a person means with clicks near it.

    Args:
        clicks: (N, 2) pixels, N >= 5.
        field: the edges of the view.
        reach_px: how far a click may be from the edge.

    Returns:
        The fitted ellipse and the sub-pixel edge points (M, 2) along it. Where the image shows no edge for at least
        a third of the circumference the clicks are taken as they are.
    """
    ellipse = ellipse_through(clicks)
    points = np.asarray(clicks, dtype=float)
    for reach in (reach_px, 0.7 * reach_px, 1.2):
        seen = _edge_points(ellipse, field, reach)
        if seen is None:
            break
        fitted = fit_ellipse(seen)
        if fitted is None:
            break
        points, ellipse = seen, fitted
    return ellipse, points


def _edge_points(ellipse: Ellipse, field: EdgeField, reach_px: float) -> Array | None:
    """Edge points along an ellipse, the outliers among them left out; None where there are too few."""
    n = int(np.clip(2 * np.pi * ellipse.semi_axes[0] / 2, 24, 240))
    contour = ellipse.sample(n)
    normals = ellipse.normals(contour)
    offsets, _ = field.measure(contour, normals, reach_px)
    found = np.isfinite(offsets) & field.inside(contour)
    if found.sum() < max(n / 3, 6):
        return None
    seen = contour[found] + offsets[found, None] * normals[found]
    refit = ellipse_through(seen)
    deviation = np.abs(refit.distance(seen))
    limit = max(3 * 1.4826 * float(np.median(deviation)), 0.25)
    kept = seen[deviation <= limit]
    return kept if len(kept) >= max(n / 3, 6) else None
