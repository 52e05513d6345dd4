"""Sub-pixel edges along the visible circles of a posed model, each paired with the model's point that it shows."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.evidence import EdgeField, edge_along, profile_weights
from vision.model_contour import ModelContour
from vision.pose import Observations
from vision.visibility import BORDER_PX, chain, project_samples

Array = NDArray[np.float64]

SIGMA_PX = 0.3


def observe_edges(
    T_world_part: Array,
    contour: ModelContour,
    cameras: tuple[Array, Array],
    fields: list[tuple[EdgeField, NDArray[np.bool_]]],
    reach_px: float,
) -> Observations:
    """Find the edges near the contour of a posed model, claimed ones left out.

    Args:
        T_world_part: 4x4 pose.
        contour: of the model.
        cameras: T_camera_world (V, 4, 4) and fx, fy, cx, cy (V, 4).
        fields: of every view the edge field, and where its edges have been claimed.
        reach_px: how far from the contour to look.
    """
    weights = profile_weights(reach_px)
    samples = contour.samples
    blocks = [
        _observe(T_world_part, T_camera_world, intrinsics, samples, field.smooth, claimed, weights)
        for T_camera_world, intrinsics, (field, claimed) in zip(*cameras, fields, strict=True)
    ]
    view = np.repeat(np.arange(len(blocks)), [len(index) for index, _, _ in blocks])
    index, pixels, normals = (np.concatenate([block[k] for block in blocks]) for k in range(3))
    return Observations(
        view, contour.points[index], pixels, normals, np.full(len(index), SIGMA_PX), contour.circle[index]
    )


@njit(cache=True, error_model="numpy")
def _observe(T_world_part, T_camera_world, intrinsics, samples, smooth, claimed, weights):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Numbers (N,) of the samples with an edge in one view, the edges' pixels and the contour's normals (N, 2)."""
    height, width = claimed.shape
    size = len(samples.circle)
    T, image, shown = np.empty((4, 4)), np.empty((5, size)), np.empty(size, np.bool_)
    index, pixels, normals = np.empty(size, np.intp), np.empty((size, 2)), np.empty((size, 2))
    profile, slope = np.empty(len(weights), np.float32), np.zeros(len(weights), np.float32)
    chain(T_camera_world, T_world_part, T)
    project_samples(T, intrinsics, samples, image, shown)
    count = 0
    for i in np.flatnonzero(shown):
        u, v = image[0, i], image[1, i]
        if not (BORDER_PX <= u <= width - 1 - BORDER_PX and BORDER_PX <= v <= height - 1 - BORDER_PX):
            continue
        if claimed[int(np.rint(v)), int(np.rint(u))]:
            continue
        nx, ny = image[3, i], image[4, i]
        offset, _ = edge_along(smooth, u, v, nx, ny, weights, profile, slope)
        if np.isfinite(offset):
            index[count] = i
            pixels[count, 0], pixels[count, 1] = u + offset * nx, v + offset * ny
            normals[count, 0], normals[count, 1] = nx, ny
            count += 1
    return index[:count], pixels[:count], normals[:count]
