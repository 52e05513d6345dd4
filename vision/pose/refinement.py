"""From observed edges to the pose: robust refinement over all views, and what its result is worth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vision.frozen import frozen_arrays
from vision.geometry.camera import CameraArrays, View, camera_arrays
from vision.kernels import njit
from vision.model.projection import moved, rotated
from vision.pose.calibration import EXACT, CalibrationError
from vision.pose.edge_errors import USUAL, EdgeErrors
from vision.pose.observations import Observations

Array = NDArray[np.float64]

LEAST_CURVATURE = 0.1  # of the cost, over that of the normal matrix


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Refinement:
    """The outcome of a refinement: 4x4 pose, covariance as in PoseEstimate, residuals in sigma, weights 0 to 1."""

    T_world_part: Array
    covariance: Array
    residuals: Array
    weights: Array
    residual_px: float


def refine_pose(
    T_world_part: Array,
    observe: Callable[[Array, int], Observations],
    views: Sequence[View],
    *,
    iterations: int,
    inplane: bool,
    robust_scale: float = 3.0,
    calibration: CalibrationError = EXACT,
    edge_errors: EdgeErrors = USUAL,
) -> Refinement | None:
    """Gauss-Newton on the distances of edge points along the contour normals, with Tukey's weights.

    Args:
        T_world_part: 4x4 start.
        observe: measures again at every iterate; gets the pose and the iteration's number.
        views: the views that ``Observations.of_view`` counts.
        iterations: number of steps.
        inplane: False holds the rotation about the part's z axis, which coaxial circles cannot tell.
        robust_scale: residual, in robust standard deviations, beyond which an edge point is ignored.
        calibration: how unsure the views' poses and lens are, which the covariance then includes.
        edge_errors: the errors that many edges share, which it includes, too.

    Returns:
        None when too few edge points are left.
    """
    T: Array = T_world_part.copy()
    cameras = camera_arrays(views)
    for iteration in range(iterations):
        seen = observe(T, iteration)
        if len(seen.of_view) < 12:
            return None
        J, residuals = _linearise(T, seen, cameras)
        scale = max(1.4826 * float(np.median(np.abs(residuals))), 0.3)
        u = np.clip(residuals / (robust_scale * scale), -1, 1)
        weights = (1 - u**2) ** 2
        N = J.T @ (weights[:, None] * J)
        if not inplane:
            # A stiff spring about the axis: the normal matrix would be singular there.
            axis = np.concatenate([np.zeros(3), T[:3, 2]])
            N += 1e12 * np.outer(axis, axis)
        N += 1e-9 * np.diag(np.diag(N))
        step = np.asarray(np.linalg.solve(N, J.T @ (weights * residuals)), dtype=np.float64)
        T = _moved(T, step)
    shared = _systematic(J, weights, seen, T[:3, 2], edge_errors)
    unsure = calibration.pose_covariance(T, seen, J, weights, N, views)
    added = (_common_shift(T, cameras, edge_errors.common_px), unsure)
    return _outcome(T, N, J, residuals, weights, seen, inplane, shared, added)


def _linearise(T: Array, seen: Observations, cameras: CameraArrays) -> tuple[Array, Array]:
    """Rows d(residual)/d(translation, rotation) and the residuals, both over sigma."""
    J, residuals = np.empty((len(seen.of_view), 6)), np.empty(len(seen.of_view))
    _write_rows(T, cameras, seen, J, residuals)
    return J, residuals


@njit(cache=True, error_model="numpy")
def _write_rows(T, cameras, seen, J, residuals):
    """Write what :func:`_linearise` returns."""
    pixels, normals, sigma_px = seen.pixels, seen.normals, seen.sigma_px
    for i in range(len(seen.of_view)):
        M, (fx, fy, cx, cy) = cameras.T_camera_world[seen.of_view[i]], cameras.intrinsics[seen.of_view[i]]
        ax, ay, az = rotated(T, seen.points_part[i])
        x, y, z = moved(M, (ax + T[0, 3], ay + T[1, 3], az + T[2, 3]))
        # The normal component of the projection's derivative, in the camera frame and then in the world frame.
        gx, gy = normals[i, 0] * fx, normals[i, 1] * fy
        gz = -(gx * x + gy * y) / z
        gx, gy, gz = gx / z, gy / z, gz / z
        rx, ry, rz = rotated(M.T, (gx, gy, gz))
        row = (rx, ry, rz, ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx)
        for j in range(6):
            J[i, j] = row[j] / sigma_px[i]
        du, dv = pixels[i, 0] - (fx * x / z + cx), pixels[i, 1] - (fy * y / z + cy)
        residuals[i] = (normals[i, 0] * du + normals[i, 1] * dv) / sigma_px[i]


def _moved(T: Array, step: Array) -> Array:
    out = T.copy()
    out[:3, 3] += step[:3]
    out[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3]
    return out


def _outcome(
    T: Array,
    N: Array,
    J: Array,
    residuals: Array,
    weights: Array,
    seen: Observations,
    inplane: bool,
    shared: Array,
    added: Sequence[Array],
) -> Refinement:
    kept = max(float(weights.sum()), 1.0)
    # The sandwich of an M-estimator: Tukey's psi is w r, its derivative sqrt(w) (5 sqrt(w) - 4).
    slope = np.sqrt(weights) * (5 * np.sqrt(weights) - 4)
    inverse = _inverse_curvature(J.T @ ((slope - weights)[:, None] * J), N)
    psi = weights * residuals
    spread = (J * (psi**2)[:, None]).T @ J + shared
    covariance = sum(added, start=inverse @ spread @ inverse)
    if not inplane:
        axis = np.concatenate([np.zeros(3), T[:3, 2]])
        covariance = covariance + np.pi**2 / 3 * np.outer(axis, axis)  # uniform over the circle
    rms = float(np.sqrt(weights @ (residuals * seen.sigma_px) ** 2 / kept))
    return Refinement(T, covariance, residuals, weights, rms)


def _inverse_curvature(change: Array, N: Array) -> Array:
    """Inverse of N + change (6, 6), no direction of which is let fall below a share of the normal matrix N.

    Where many edges are half rejected the curvature of the robust cost comes out near zero or negative, which tells
    nothing of how well they hold the pose.
    """
    root = np.linalg.inv(np.linalg.cholesky(N))
    shares, directions = np.linalg.eigh(np.eye(6) + root @ change @ root.T)
    back = root.T @ directions
    return np.asarray(back / np.maximum(shares, LEAST_CURVATURE) @ back.T)


def _systematic(J: Array, weights: Array, seen: Observations, axis: Array, errors: EdgeErrors) -> Array:
    """What errors common to many edge points add to the covariance of the right-hand side Jᵀ W r.

    Light and shade shift the edges of one picture together, widen or narrow one rim in it, and the taught positions
    of holes turn the part about its axis; all are far above the noise of single points, which averages out over
    hundreds of them.
    """
    rows = (weights / seen.sigma_px)[:, None] * J
    turn = J[:, 3:] @ axis * seen.sigma_px
    tells = np.abs(turn) > 1e-3 * np.abs(turn).max()
    turn /= max(float(np.sqrt(np.mean(turn[tells] ** 2))), 1e-9) if tells.any() else 1.0
    # How far the images of a circle's points move when it is lifted along the axis by one pixel's footprint.
    footprint = 1 / max(float(np.linalg.norm(J[:, :3] * seen.sigma_px[:, None], axis=1).max()), 1e-9)
    lift = J[:, :3] @ axis * seen.sigma_px * footprint
    # Whatever moves many points in common adds the square of its sum over them.
    moved = np.stack([np.ones(len(turn)), *seen.normals.T, turn, lift])
    views, circles = int(seen.of_view.max()) + 1, int(seen.circle.max()) + 1
    sums = np.zeros((views, circles, len(moved), 6))
    _add_by_rim(rows, moved, seen.of_view, seen.circle, sums)
    of_rim, of_view, of_circle = sums.reshape(-1, *sums.shape[2:]), sums.sum(axis=1), sums.sum(axis=0)
    common = np.vstack(
        [
            errors.swell_px * of_rim[:, 0],
            *(errors.rim_shift_px * of_rim[:, 1:3]),
            *(errors.shift_px * of_view[:, 1:3]),
            errors.twist_px * of_view[:, 3],
            errors.lift_px * of_circle[:, 4],
        ]
    )
    return common.T @ common


@njit(cache=True)
def _add_by_rim(rows, moved, of_view, circle, sums):
    """Add rows (N, 6) times each of ``moved`` (M, N) to the sums (V, C, M, 6) of a point's view and circle."""
    for i in range(len(rows)):
        out = sums[of_view[i], circle[i]]
        for m in range(len(moved)):
            for j in range(6):
                out[m, j] += moved[m, i] * rows[i, j]


def _common_shift(T: Array, cameras: CameraArrays, sigma_px: float) -> Array:
    """Covariance (6, 6) of an error across the line of sight that is the same in all views, as light makes it."""
    eyes = [-M[:3, :3].T @ M[:3, 3] for M in cameras.T_camera_world]
    sight = T[:3, 3] - np.mean(eyes, axis=0)
    distance = np.linalg.norm(sight)
    sigma = sigma_px * distance / cameras.intrinsics[0, 0]
    out = np.zeros((6, 6))
    out[:3, :3] = sigma**2 * (np.eye(3) - np.outer(sight, sight) / distance**2)
    return out
