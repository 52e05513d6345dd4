"""The edge support of posed contours: the innermost loop of matching, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from vision.edges.edge_field import FULL_ALIGNMENT, LOOSEST_ALIGNMENT
from vision.model.projection import chain, is_covered, list_inside, project_samples


@njit(cache=True, error_model="numpy")
def tally_support(poses, cameras, samples, edges, reach_px, total, count):
    """Add the edge support of each circle's samples to ``total`` and their number to ``count``.

    The same as :meth:`ModelContour.project` followed by :meth:`vision.edges.edge_field.EdgeField.support`, in one
    pass. View by view, because the edges of one fit into the processor's cache.

    Args:
        poses: (N, 4, 4) T_world_part.
        cameras: T_camera_world (V, 4, 4) and fx, fy, cx, cy (V, 4).
        samples: of a contour, see :class:`vision.model.projection.ContourSamples`.
        edges: distance (V, H, W), infinite where edges have been claimed, direction (V, H, W, 2), and the depth
            beyond which parts already found hide what is there, by blocks of pixels.
        reach_px: tolerance.
        total: (N, V, C) added to.
        count: (N, V, C, 2) added to: the samples that nothing known hides, and all that face the camera.
    """
    size = len(samples.circle)
    image, shown, pixel = np.empty((5, size)), np.empty(size, np.bool_), np.empty((2, size), np.int32)
    listed, near = np.empty(size, np.intp), np.empty(size, np.intp)
    T_camera_world, intrinsics = cameras
    T = np.empty((4, 4))
    for v in range(len(intrinsics)):
        distance, direction, cover = edges[0][v], edges[1][v], edges[2][v]
        height, width = distance.shape
        for n in range(len(poses)):
            chain(T_camera_world[v], poses[n], T)
            project_samples(T, intrinsics[v], samples, image, shown)
            inside = listed[: list_inside(image, shown, width, height, pixel, listed)]
            close = near[: _count(samples, image, pixel, inside, distance, cover, reach_px, count[n, v], near)]
            for i in close:
                column, line = pixel[0, i], pixel[1, i]
                edge = (distance[line, column], direction[line, column, 0], direction[line, column, 1])
                total[n, v, samples.circle[i]] += _support(edge, image[3, i], image[4, i], reach_px)


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
def _support(edge, nx, ny, reach_px):
    """Support of a sample by an edge in reach: the nearer, and the more it runs along the contour, the better."""
    distance, direction_x, direction_y = edge
    nearness = (reach_px - distance) / (reach_px - 1.0)
    share = (abs(direction_x * nx + direction_y * ny) - LOOSEST_ALIGNMENT) / (FULL_ALIGNMENT - LOOSEST_ALIGNMENT)
    return min(nearness, 1.0) * min(max(share, 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def claim_edges(T, intrinsics, samples, edges, reach_px, least, width_px):
    """Claim the edges in one view that support the samples of a posed contour.

    Args:
        T: (4, 4) T_camera_part.
        intrinsics: fx, fy, cx, cy.
        samples: of the contour.
        edges: distance (H, W), direction (H, W, 2), claimed (H, W) bool; the first and the last are written to.
        reach_px: tolerance.
        least: support of a sample from which its edge is claimed.
        width_px: how far around such a sample.
    """
    distance, direction, claimed = edges
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
            edge = (distance[v, u], direction[v, u, 0], direction[v, u, 1])
            mine[count, 0], mine[count, 1] = u, v
            count += _support(edge, image[3, i], image[4, i], reach_px) > least
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
