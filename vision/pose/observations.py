"""Observed edge points, each paired with its model point: along a posed contour, or on matched ellipses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.edges.edge_field import EdgeField, edge_along, profile_weights
from vision.features import EllipseFeature
from vision.geometry.camera import CameraArrays, View
from vision.model.contour import ModelContour
from vision.model.projection import BORDER_PX, chain, project_samples
from vision.model.vision_model import SalientCircles

Array = NDArray[np.float64]

SIGMA_PX = 0.3
"""Of an edge point across its contour, until the residuals say better."""


def observe_edges(
    T_world_part: Array,
    contour: ModelContour,
    cameras: CameraArrays,
    fields: Sequence[EdgeField],
    claimed: NDArray[np.bool_],
    reach_px: float,
) -> Observations:
    """Find the edges near the contour of a posed model, claimed ones left out.

    Args:
        T_world_part: 4x4 pose.
        contour: of the model.
        cameras: of the views.
        fields: the edge field of every view.
        claimed: (V, H, W) where edges have been claimed; H and W are those of the largest view.
        reach_px: how far from the contour to look.
    """
    weights = profile_weights(reach_px)
    samples = contour.samples
    blocks = [
        _observe(T_world_part, cameras, v, samples, field.smooth, claimed, weights) for v, field in enumerate(fields)
    ]
    view = np.repeat(np.arange(len(blocks)), [len(index) for index, _, _ in blocks])
    index, pixels, normals = map(np.concatenate, zip(*blocks, strict=True))
    return Observations(
        view, contour.points[index], pixels, normals, np.full(len(index), SIGMA_PX), contour.circle[index]
    )


@njit(cache=True, error_model="numpy")
def _observe(T_world_part, cameras, view, samples, smooth, claimed, weights):
    """Numbers (N,) of the samples with an edge in one view, the edges' pixels and the contour's normals (N, 2)."""
    height, width = smooth.shape
    size = len(samples.circle)
    T, image, shown = np.empty((4, 4)), np.empty((5, size)), np.empty(size, np.bool_)
    index, pixels, normals = np.empty(size, np.intp), np.empty((size, 2)), np.empty((size, 2))
    profile, slope = np.empty(len(weights), np.float32), np.zeros(len(weights), np.float32)
    chain(cameras.T_camera_world[view], T_world_part, T)
    project_samples(T, cameras.intrinsics[view], samples, image, shown)
    count = 0
    for i in np.flatnonzero(shown):
        u, v = image[0, i], image[1, i]
        if not (BORDER_PX <= u <= width - 1 - BORDER_PX and BORDER_PX <= v <= height - 1 - BORDER_PX):
            continue
        if claimed[view, int(np.rint(v)), int(np.rint(u))]:
            continue
        nx, ny = image[3, i], image[4, i]
        offset, _ = edge_along(smooth, u, v, nx, ny, weights, profile, slope)
        if np.isfinite(offset):
            index[count] = i
            pixels[count, 0], pixels[count, 1] = u + offset * nx, v + offset * ny
            normals[count, 0], normals[count, 1] = nx, ny
            count += 1
    return index[:count], pixels[:count], normals[:count]


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
    view, model, pixels, normals, circle = map(np.concatenate, zip(*blocks, strict=True))
    return Observations(view, model, pixels, normals, np.full(len(view), SIGMA_PX), circle)


def _image_normals(points: Array, tangents: Array, T_camera_part: Array, fx: float, fy: float) -> Array:
    """Unit normals (N, 2) of the image of a curve through points (N, 3) with tangents (N, 3)."""
    x, y, z = (points @ T_camera_part[:3, :3].T + T_camera_part[:3, 3]).T
    tx, ty, tz = (tangents @ T_camera_part[:3, :3].T).T
    along = np.column_stack([fx * (tx - x / z * tz), fy * (ty - y / z * tz)])
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return np.column_stack([along[:, 1], -along[:, 0]])


class Observations(NamedTuple):
    """Edge points matched to points of the model, as the compiled loops read them.

    Attributes:
        of_view: (N,) index of the view.
        points_part: (N, 3) model points in the part's frame, metres.
        pixels: (N, 2) where their edge was seen.
        normals: (N, 2) unit normals of the projected contour: only the distance along them is known.
        sigma_px: (N,) standard deviation of that distance.
        circle: (N,) number of the model's circle that the point belongs to.
    """

    of_view: NDArray[np.intp]
    points_part: Array
    pixels: Array
    normals: Array
    sigma_px: Array
    circle: NDArray[np.intp]


POINTS_PER_ELLIPSE = 48
