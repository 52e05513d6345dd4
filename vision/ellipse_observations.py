"""The edge points of matched ellipses, each paired with the point of the model that it shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.camera import View
from vision.candidates import SalientCircles
from vision.ellipse_table import POINTS_PER_ELLIPSE
from vision.features import EllipseFeature
from vision.pose import Observations

Array = NDArray[np.float64]

SIGMA_PX = 0.3


def observe_ellipses(
    T_world_part: Array,
    matches: NDArray[np.intp],
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    circles: SalientCircles,
) -> Observations:
    """Edge points of matched ellipses, each paired with the point of its circle that it is nearest to.

    The viewing ray meets the plane of the circle; the direction from the centre to that point gives the point of
    the circle, and the projected tangent there gives the contour normal.

    Args:
        T_world_part: 4x4 pose.
        matches: (V, K) number of the ellipse within its view, -1 for none.
        features: the ellipses of every view.
        views: with distortion-free lenses.
        circles: the salient circles.
    """
    blocks = []
    for v, k in zip(*np.nonzero(matches >= 0), strict=True):
        points = features[v][matches[v, k]].points
        pixels = points[:: max(len(points) // POINTS_PER_ELLIPSE, 1)]
        camera = views[v].camera
        T_camera_part = np.linalg.inv(views[v].T_world_camera.as_matrix()) @ T_world_part
        R, t = T_camera_part[:3, :3], T_camera_part[:3, 3]
        rays = np.column_stack([(pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy), np.ones(len(pixels))])
        rays, eye = rays @ R, -t @ R
        reach = (circles.height[k] - eye[2]) / rays[:, 2]
        direction = (eye + reach[:, None] * rays)[:, :2]
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
        model = np.column_stack([direction * circles.radius[k], np.full(len(direction), circles.height[k])])
        tangent = np.column_stack([-direction[:, 1], direction[:, 0], np.zeros(len(direction))])
        normals = _image_normals(model, tangent, T_camera_part, camera.fx, camera.fy)
        of_view, of_circle = (np.full(len(pixels), number, np.intp) for number in (v, k))
        blocks.append((of_view, model, pixels, normals, of_circle))
    if not blocks:
        none, flat = np.empty(0, np.intp), np.empty((0, 2))
        return Observations(none, np.empty((0, 3)), flat, flat, np.empty(0), none)
    view, model, pixels, normals, circle = (np.concatenate([b[j] for b in blocks]) for j in range(5))
    return Observations(view, model, pixels, normals, np.full(len(view), SIGMA_PX), circle)


def _image_normals(points: Array, tangents: Array, T_camera_part: Array, fx: float, fy: float) -> Array:
    """Unit normals (N, 2) of the image of a curve through points (N, 3) with tangents (N, 3)."""
    x, y, z = (points @ T_camera_part[:3, :3].T + T_camera_part[:3, 3]).T
    tx, ty, tz = (tangents @ T_camera_part[:3, :3].T).T
    along = np.column_stack([fx * (tx - x / z * tz), fy * (ty - y / z * tz)])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.column_stack([along[:, 1], -along[:, 0]])
