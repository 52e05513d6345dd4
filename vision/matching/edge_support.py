"""The edge support of posed contours: the innermost loop of matching, compiled."""

from __future__ import annotations

import numpy as np

from vision.edges.edge_field import FULL_ALIGNMENT, LOOSEST_ALIGNMENT
from vision.kernels import njit
from vision.model.projection import chain, is_covered, list_inside, project_samples


@njit(cache=True, error_model="numpy")
def tally_support(poses, cameras, samples, edges, reach_px, total, count):
    """Add the edge support of each circle's samples to ``total`` and their number to ``count``.

    The same as :meth:`ModelContour.project` followed by :meth:`vision.edges.edge_field.EdgeField.support`, in one
    pass. View by view, because the edges of one fit into the processor's cache.

    Args:
        poses: (N, 4, 4) T_world_part.
        cameras: of the views, see :class:`vision.geometry.camera.CameraArrays`.
        samples: of a contour, see :class:`vision.model.projection.ContourSamples`.
        edges: of the views, see :class:`vision.edges.edge_field.StackedEdges`.
        reach_px: tolerance.
        total: (N, V, C) added to.
        count: (N, V, C, 2) added to: the samples that nothing known hides, and all that face the camera.
    """
    size = len(samples.circle)
    image, shown, pixel = np.empty((5, size)), np.empty(size, np.bool_), np.empty((2, size), np.int32)
    listed, near = np.empty(size, np.intp), np.empty(size, np.intp)
    T = np.empty((4, 4))
    for v in range(len(cameras.intrinsics)):
        distance, direction, cover = edges.distance[v], edges.direction[v], edges.cover[v]
        height, width = distance.shape
        for n in range(len(poses)):
            chain(cameras.T_camera_world[v], poses[n], T)
            project_samples(T, cameras.intrinsics[v], samples, image, shown)
            inside = listed[: list_inside(image, shown, width, height, pixel, listed)]
            close = near[: _count(samples, image, pixel, inside, distance, cover, reach_px, count[n, v], near)]
            for i in close:
                column, line = pixel[0, i], pixel[1, i]
                along = direction[line, column, 0] * image[3, i] + direction[line, column, 1] * image[4, i]
                total[n, v, samples.circle[i]] += _support(distance[line, column], along, reach_px)


@njit(cache=True, error_model="numpy")
def _count(samples, image, pixel, inside, distance, cover, reach_px, count, near):
    """Count samples circle by circle; write those with an edge near them to ``near``, and return how many."""
    found = 0
    for i in inside:
        column, line = pixel[0, i], pixel[1, i]
        is_open = not is_covered(cover, column, line, image[2, i] - samples.margin_m)
        count[samples.circle[i], 0] += is_open
        count[samples.circle[i], 1] += 1.0
        near[found] = i
        found += is_open & (distance[line, column] < reach_px)
    return found


@njit(cache=True, error_model="numpy", inline="always")
def _support(distance, along, reach_px):
    """Support of a sample by an edge in reach: the nearer, and the more it runs along the contour, the better.

    Args:
        distance: pixels from the sample to the edge.
        along: cosine between the edge's gradient and the contour's normal.
        reach_px: tolerance.
    """
    nearness = (reach_px - distance) / (reach_px - 1.0)
    share = (abs(along) - LOOSEST_ALIGNMENT) / (FULL_ALIGNMENT - LOOSEST_ALIGNMENT)
    return min(nearness, 1.0) * min(max(share, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def claim_edges(T, intrinsics, samples, edges, view, reach_px, least, width_px):
    """Claim the edges in one view that support the samples of a posed contour.

    Args:
        T: (4, 4) T_camera_part.
        intrinsics: fx, fy, cx, cy.
        samples: of the contour.
        edges: of all views; what is claimed is written to ``distance`` and ``claimed``.
        view: the number of the view.
        reach_px: tolerance.
        least: support of a sample from which its edge is claimed.
        width_px: how far around such a sample.
    """
    distance, direction, claimed = edges.distance[view], edges.direction[view], edges.claimed[view]
    height, width = distance.shape
    size = len(samples.circle)
    image, shown, mine = np.empty((5, size)), np.empty(size, np.bool_), np.empty((size, 2), np.intp)
    project_samples(T, intrinsics, samples, image, shown)
    count = 0
    for i in np.flatnonzero(shown):
        x, y = np.rint(image[0, i]), np.rint(image[1, i])
        if x < 0 or y < 0 or x >= width or y >= height:
            continue
        u, v = int(x), int(y)
        if distance[v, u] < reach_px:
            along = direction[v, u, 0] * image[3, i] + direction[v, u, 1] * image[4, i]
            mine[count, 0], mine[count, 1] = u, v
            count += _support(distance[v, u], along, reach_px) > least
    for u, v in mine[:count]:
        for y in range(max(v - width_px, 0), min(v + width_px + 1, height)):
            for x in range(max(u - width_px, 0), min(u + width_px + 1, width)):
                claimed[y, x], distance[y, x] = True, np.inf


@njit(cache=True)
def share_claimed(claimed, points):
    """Share of points (N, 2) in pixels that lie on claimed edges (H, W)."""
    height, width = claimed.shape
    count = 0
    for i in range(len(points)):
        u = min(max(int(np.rint(points[i, 0])), 0), width - 1)
        v = min(max(int(np.rint(points[i, 1])), 0), height - 1)
        count += claimed[v, u]
    return count / len(points)
