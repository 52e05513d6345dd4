"""Poses behind a single arc: the last resort for a part of which little more than a piece of its outline shows.

An arc alone determines an ellipse badly, but the radius is taught, parts lie in the bin more often flat than not, and
the other views tell the depth; what an arc suggests under these priors, the edges of all views confirm or refute.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.extraction import Arc
from vision.geometry.camera import CameraArrays, View
from vision.geometry.small_systems import factorise, solve
from vision.geometry.workspace import Workspace
from vision.kernels import njit
from vision.model.solid import OUTLINE_SHARE
from vision.model.vision_model import SalientCircles
from vision.pose.alignment import rows_of_circle, turn_and_move

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

POINTS_PER_ARC = 24
MOST_UNEXPLAINED = 10  # that are tried in a view, the longest
NOISE_PX = 0.5
TILT_SIGMA_RAD = np.radians(12.0)
DEPTH_SIGMA = 0.02  # relative
DEPTH_LEVELS = (0.15, 0.4, 0.65)  # of the workspace's height
ITERATIONS = 4
LARGEST_RESIDUAL_PX = 1.5


def arc_poses(
    arcs: Sequence[Sequence[Arc]],
    views: Sequence[View],
    cameras: CameraArrays,
    circles: SalientCircles,
    workspace: Workspace,
) -> tuple[Array, Indices]:
    """The poses that the arcs of all views suggest, as outlines of flat lying parts at several depths.

    Args:
        arcs: of every view.
        views: with distortion-free lenses.
        cameras: of the views.
        circles: the model's salient circles.
        workspace: where parts can be; its z axis points up.

    Returns:
        T_world_part (N, 4, 4) and seeds (N, 3): view, -1, number of the circle.
    """
    poses, seeds = [np.empty((0, 4, 4))], [np.empty((0, 3), np.intp)]
    outlines = np.flatnonzero(circles.radius > OUTLINE_SHARE * circles.radius.max())
    heights = workspace.low[2] + np.array(DEPTH_LEVELS) * (workspace.high[2] - workspace.low[2])
    for v, (view, mine) in enumerate(zip(views, arcs, strict=True)):
        T_world_camera = view.T_world_camera.as_matrix()
        for arc in mine:
            stride = max(len(arc.points) // POINTS_PER_ARC, 1)
            points, inwards = np.ascontiguousarray(arc.points[::stride]), arc.inwards[::stride]
            middle = np.array([points.mean(axis=0), np.median(points, axis=0), np.median(inwards, axis=0)])
            for k in outlines:
                circle, intrinsics = circles.circle(k), cameras.intrinsics[v]
                started = _starts(middle, T_world_camera, intrinsics, circle, heights)
                good = _fit_arc(started, points, cameras.T_camera_world[v], intrinsics, circle)
                poses.append(started[good])
                seeds.append(np.full((int(good.sum()), 3), (v, -1, k), np.intp))
    found, seed = np.concatenate(poses), np.concatenate(seeds)
    inside = workspace.contains(found[:, :3, 3], margin_m=0.25 * float(circles.radius.max()))
    return found[inside], seed[inside]


@njit(cache=True)
def _starts(middle, T_world_camera, intrinsics, circle, heights):
    """(H, 4, 4) poses of flat lying parts at several heights whose circle passes through the middle of an arc.

    Args:
        middle: (3, 2) mean and median of the arc's points, median of its normals.
        T_world_camera: (4, 4).
        intrinsics: fx, fy, cx, cy.
        circle: see :class:`vision.model.vision_model.CoaxialCircle`.
        heights: (H,) of the circle's centre in the world.
    """
    fx, fy, cx, cy = intrinsics
    height, side, radius = circle.height, circle.side, circle.radius
    T, poses = T_world_camera, np.zeros((len(heights), 4, 4))
    down = T[2, 0] * (middle[0, 0] - cx) / fx + T[2, 1] * (middle[0, 1] - cy) / fy + T[2, 2]
    for i in range(len(heights)):
        radius_px = fx * radius * down / (heights[i] - T[2, 3])
        u = (middle[1, 0] + radius_px * middle[2, 0] - cx) / fx
        v = (middle[1, 1] + radius_px * middle[2, 1] - cy) / fy
        reach = (heights[i] - T[2, 3]) / (T[2, 0] * u + T[2, 1] * v + T[2, 2])
        for j in range(3):
            poses[i, j, 3] = T[j, 3] + reach * (T[j, 0] * u + T[j, 1] * v + T[j, 2])
        poses[i, 2, 3] -= side * height
        # Half a turn about x where the back is up.
        poses[i, 0, 0], poses[i, 1, 1], poses[i, 2, 2], poses[i, 3, 3] = 1.0, side, side, 1.0
    return poses


@njit(cache=True)
def _fit_arc(poses, points, T_camera_world, intrinsics, circle):
    """Fit poses to an arc in place, held by the priors on tilt and depth; False where it does not fit."""
    n = len(points)
    rows, residuals, good = np.empty((n, 6)), np.empty(n), np.ones(len(poses), np.bool_)
    for i in range(len(poses)):
        pose = poses[i]
        start = pose.copy()
        sight = np.empty(3)
        for j in range(3):
            sight[j] = T_camera_world[2, j]
        depth = 0.0
        for j in range(3):
            depth += sight[j] * pose[j, 3]
        depth += T_camera_world[2, 3]
        turned = np.zeros(3)
        count = 0
        for _ in range(ITERATIONS):
            T = T_camera_world @ pose
            count = rows_of_circle(T, T_camera_world, intrinsics, points, circle, rows, residuals, 0)
            if count < n // 2:
                break
            N, g = np.zeros((6, 6)), np.zeros(6)
            for r in range(count):
                for a in range(6):
                    g[a] += rows[r, a] * residuals[r]
                    for b in range(6):
                        N[a, b] += rows[r, a] * rows[r, b]
            N /= NOISE_PX**2
            g /= NOISE_PX**2
            along = 0.0
            for j in range(3):
                along += sight[j] * (pose[j, 3] - start[j, 3])
            stiff = 1 / (DEPTH_SIGMA * depth) ** 2
            for a in range(3):
                g[a] -= stiff * along * sight[a]
                g[3 + a] -= turned[a] / TILT_SIGMA_RAD**2
                N[3 + a, 3 + a] += 1 / TILT_SIGMA_RAD**2
                for b in range(3):
                    N[a, b] += stiff * sight[a] * sight[b]
            factorise(N)
            solve(N, g)
            for a in range(3):
                turned[a] += g[3 + a]
            turn_and_move(pose, g)
        spread = np.median(np.abs(residuals[:count])) if count >= n // 2 else np.inf
        good[i] = spread < LARGEST_RESIDUAL_PX and circle.side * _facing(T_camera_world @ pose) < 0
    return good


@njit(cache=True)
def _facing(T):
    """Negative where the part's z axis points towards the camera."""
    return T[0, 2] * T[0, 3] + T[1, 2] * T[1, 3] + T[2, 2] * T[2, 3]
