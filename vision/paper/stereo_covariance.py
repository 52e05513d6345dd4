"""How sure a pose by stereo is: the scatter of its triangulated points, carried into the pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.model.vision_model import SalientCircles
from vision.pose.stereo import POINTS_PER_ELLIPSE, rim_correspondences

Array = NDArray[np.float64]

FREE_PARAMETERS = 5  # of an ellipse: so many of its points are independent
TURN_RAD = np.radians(2.0)  # standard deviation of the turn that the supporting features tell
LEAST_RESIDUAL = 1e-4  # of the largest circle's radius


def stereo_covariance(
    T_world_part: Array,
    matches: NDArray[np.intp],
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    circles: SalientCircles,
) -> tuple[Array, float]:
    """The covariance (6, 6) of a pose by stereo, and the root mean square distance of its points, in pixels.

    The arguments are those of `vision.pose.stereo.pose_by_stereo`. Rows are translation in metres and rotation vector
    in radians, in the world frame and about the part's origin. Errors of the calibration are not in it.
    """
    of_part, of_world, _ = rim_correspondences(T_world_part, matches, features, views, circles)
    arms = of_part @ T_world_part[:3, :3].T
    off = of_world - (arms + T_world_part[:3, 3])
    variance = max(float((off**2).sum(axis=1).mean()) / 3, (LEAST_RESIDUAL * float(circles.radius.max())) ** 2)
    information = np.zeros((6, 6))
    for arm in arms:
        cross = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
        J = np.hstack([np.eye(3), -cross])
        information += J.T @ J
    information *= FREE_PARAMETERS / POINTS_PER_ELLIPSE / variance
    axis = T_world_part[:3, 2]
    # Points of coaxial circles keep the hypothesis's turn: what they seem to tell of it is taken out again.
    free = np.eye(6)
    free[3:, 3:] -= np.outer(axis, axis)
    information = free @ information @ free
    information[3:, 3:] += np.outer(axis, axis) / TURN_RAD**2
    depth_m = float(np.linalg.norm(views[0].T_world_camera.translation - T_world_part[:3, 3]))
    px_per_m = views[0].camera.fx / depth_m
    return np.asarray(np.linalg.inv(information), dtype=np.float64), float(
        np.sqrt((off**2).sum(axis=1).mean()) * px_per_m
    )
