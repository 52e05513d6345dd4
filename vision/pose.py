"""From matched features to the pose: quaternion absolute orientation, then robust refinement over all views."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.camera import View
from vision.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """Where a part is, as far as the images tell.

    Attributes:
        part: name of the part.
        T_world_part: its pose.
        covariance: (6, 6) of (translation in metres, rotation vector in radians), both in the world frame and about
            the part's origin.
        score: edge support of the pose, 0 to 1.
        process: "region" or "group", the extractor whose features made the hypothesis; "dual" after joint refinement.
        residual_px: root mean square distance of the edge points used from the projected model.
        views: number of views that support the pose.
        inplane_known: whether supporting features settled the rotation about the part's axis.
    """

    part: str
    T_world_part: RigidTransform
    covariance: Array
    score: float
    process: str
    residual_px: float
    views: int
    inplane_known: bool


@dataclass(frozen=True, eq=False)
class Observations:
    """Edge points matched to points of the model.

    Attributes:
        view: (N,) index of the view.
        points_part: (N, 3) model points in the part's frame, metres.
        pixels: (N, 2) where their edge was seen.
        normals: (N, 2) unit normals of the projected contour: only the distance along them is known.
        sigma_px: (N,) standard deviation of that distance.
    """

    view: NDArray[np.intp]
    points_part: Array
    pixels: Array
    normals: Array
    sigma_px: Array


@dataclass(frozen=True, eq=False)
class Refinement:
    """The outcome of a refinement: 4x4 pose, covariance as in PoseEstimate, residuals in sigma, weights 0 to 1."""

    T_world_part: Array
    covariance: Array
    residuals: Array
    weights: Array
    residual_px: float


def absolute_orientation(
    points_part: ArrayLike, points_world: ArrayLike, weights: ArrayLike | None = None
) -> RigidTransform:
    """T_world_part that best carries points of the part onto points in the world (Section 7; the quaternion method).

    The unit quaternion is the eigenvector of the largest eigenvalue of Horn's 4x4 matrix (J. Opt. Soc. Am. A 4(4),
    1987).

    Args:
        points_part: (N, 3), N >= 3, not all on one line.
        points_world: (N, 3).
        weights: (N,) or None for equal ones.

    Raises:
        InputError: for fewer than three points, or points on a line.
    """
    a, b = np.asarray(points_part, dtype=float), np.asarray(points_world, dtype=float)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1:] != (3,) or len(a) < 3:
        raise InputError("point pairs", got=f"{a.shape} and {b.shape}", expected="two (N, 3) arrays with N >= 3")
    w = np.ones(len(a)) if weights is None else np.asarray(weights, dtype=float)
    w = w / w.sum()
    mean_a, mean_b = w @ a, w @ b
    a, b = a - mean_a, b - mean_b
    spread = np.linalg.svd(a * np.sqrt(w)[:, None], compute_uv=False)
    if spread[1] < 1e-9 * max(spread[0], 1e-12):
        raise InputError("points of the part", got="points on a line", expected="points that span a plane")
    S = (w[:, None] * a).T @ b
    trace = np.trace(S)
    delta = np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
    N = np.zeros((4, 4))
    N[0, 0] = trace
    N[0, 1:] = N[1:, 0] = delta
    N[1:, 1:] = S + S.T - trace * np.eye(3)
    w0, x, y, z = np.linalg.eigh(N)[1][:, -1]
    rotation = Rotation.from_quat([x, y, z, w0])
    return RigidTransform.from_components(mean_b - rotation.as_matrix() @ mean_a, rotation)


def refine_pose(
    T_world_part: Array,
    observe: Callable[[Array, int], Observations],
    views: Sequence[View],
    *,
    iterations: int,
    inplane: bool,
    robust_scale: float = 3.0,
) -> Refinement | None:
    """Gauss-Newton on the distances of edge points along the contour normals, with Tukey's weights.

    Args:
        T_world_part: 4x4 start.
        observe: measures again at every iterate; gets the pose and the iteration's number.
        views: the views that ``Observations.view`` counts.
        iterations: number of steps.
        inplane: False holds the rotation about the part's z axis, which coaxial circles cannot tell.
        robust_scale: residual, in robust standard deviations, beyond which an edge point is ignored.

    Returns:
        None when too few edge points are left.
    """
    T = T_world_part.copy()
    cameras = [(np.linalg.inv(v.T_world_camera.as_matrix()), v.camera.matrix) for v in views]
    outcome: Refinement | None = None
    for iteration in range(iterations):
        seen = observe(T, iteration)
        if len(seen.view) < 12:
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
        step = np.linalg.solve(N, J.T @ (weights * residuals))
        T = _moved(T, step)
        outcome = _outcome(T, N, residuals, weights, seen, inplane)
    return outcome


def _linearise(T: Array, seen: Observations, cameras: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Rows d(residual)/d(translation, rotation) and the residuals, both over sigma."""
    arm = seen.points_part @ T[:3, :3].T
    points_world = arm + T[:3, 3]
    J = np.empty((len(seen.view), 6))
    residuals = np.empty(len(seen.view))
    for index, (T_camera_world, K) in enumerate(cameras):
        mine = np.flatnonzero(seen.view == index)
        R = T_camera_world[:3, :3]
        x, y, z = (points_world[mine] @ R.T + T_camera_world[:3, 3]).T
        n = seen.normals[mine]
        # The normal component of the projection's derivative, in the camera frame and then in the world frame.
        row = np.column_stack(
            [n[:, 0] * K[0, 0], n[:, 1] * K[1, 1], -(n[:, 0] * K[0, 0] * x + n[:, 1] * K[1, 1] * y) / z]
        )
        row = row / z[:, None] @ R
        projected = np.column_stack([K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]])
        J[mine, :3] = row
        J[mine, 3:] = np.cross(arm[mine], row)
        residuals[mine] = np.einsum("ij,ij->i", n, seen.pixels[mine] - projected)
    return J / seen.sigma_px[:, None], residuals / seen.sigma_px


def _moved(T: Array, step: Array) -> Array:
    out = T.copy()
    out[:3, 3] += step[:3]
    out[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix() @ T[:3, :3]
    return out


def _outcome(T: Array, N: Array, residuals: Array, weights: Array, seen: Observations, inplane: bool) -> Refinement:
    kept = max(float(weights.sum()), 1.0)
    variance = max(float(weights @ residuals**2) / max(kept - 6, 1.0), 1e-4)
    covariance = np.linalg.inv(N) * variance
    if not inplane:
        axis = np.concatenate([np.zeros(3), T[:3, 2]])
        covariance = covariance + np.pi**2 / 3 * np.outer(axis, axis)  # uniform over the circle
    rms = float(np.sqrt(weights @ (residuals * seen.sigma_px) ** 2 / kept))
    return Refinement(T, covariance, residuals, weights, rms)
