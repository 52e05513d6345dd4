"""What is known of the errors of a calibration, and how unsure they make a pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.geometry.camera import View, camera_arrays
from vision.geometry.circle import cross

if TYPE_CHECKING:
    from vision.pose.observations import Observations

Array = NDArray[np.float64]
Index = NDArray[np.intp]


@dataclass(frozen=True)
class CalibrationError:
    """How large the errors of the cameras' poses and of the lens are on average; the errors themselves nobody knows.

    All zero, as by default, takes the calibration for exact. The sizes are what a calibration's own report or a
    repeated calibration tells: root mean square lengths and angles.

    Attributes:
        hand_eye_translation_m: of the camera's mounting, the same in its frame in all views.
        hand_eye_rotation_rad: angle of the same.
        arm_translation_m: of the position of the arm, another one in each view.
        lens_px: displacement in the image that the lens model leaves, where it is largest in the picture.
    """

    hand_eye_translation_m: float = 0.0
    hand_eye_rotation_rad: float = 0.0
    arm_translation_m: float = 0.0
    lens_px: float = 0.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise InputError(f"calibration error {name}", got=value, expected="a finite number >= 0")

    @property
    def is_zero(self) -> bool:
        """Whether the calibration counts as exact."""
        return not any(asdict(self).values())

    def pose_covariance(
        self, T_world_part: Array, seen: Observations, J: Array, weights: Array, N: Array, views: Sequence[View]
    ) -> Array:
        """What these errors add to the covariance (6, 6) of a pose that was refined by weighted least squares.

        Where the views contradict each other by more than edges are looked for, it is a matter of chance which of
        them the pose follows. What becomes of it when one view is left out tells how much that matters, in the
        measure of the jackknife.

        Args:
            T_world_part: 4x4 the pose.
            seen: the edge points that it was refined on.
            J: (N, 6) derivative of the projected points by the pose, over their sigma.
            weights: (N,) of the points, 0 to 1.
            N: (6, 6) the normal matrix, with whatever holds the pose besides the points.
            views: with distortion-free lenses.
        """
        if self.is_zero:
            return np.zeros((6, 6))
        points_world = seen.points_part @ T_world_part[:3, :3].T + T_world_part[:3, 3]
        shifts = self._shifts(J[:, :3] * seen.sigma_px[:, None], points_world, seen.of_view, views)
        shifts /= seen.sigma_px[:, None]
        held = N - J.T @ (weights[:, None] * J)

        def response(w: Array) -> Array:
            weighted = w[:, None] * J
            return np.asarray(np.linalg.solve(J.T @ weighted + held, weighted.T @ shifts))

        gain = response(weights)
        seeing = np.unique(seen.of_view)
        if len(seeing) == 1:
            return gain @ gain.T
        changes = [response(weights * (seen.of_view != v)) - gain for v in seeing]
        chance = sum(change @ change.T for change in changes) * (len(seeing) - 1) / len(seeing)
        return np.asarray(gain @ gain.T + chance)

    def _shifts(self, rows: Array, points_world: Array, view: Index, views: Sequence[View]) -> Array:
        """How far one standard deviation of each independent error moves projected points: (N, 9 + 3 V) pixels.

        Args:
            rows: (N, 3) derivative of that motion by the point's position in the world frame, pixels per metre.
            points_world: (N, 3) the points, metres.
            view: (N,) index of the view.
            views: with distortion-free lenses.
        """
        common = np.zeros((len(rows), 9))
        arm = np.zeros((len(rows), 3 * len(views)))
        cameras = camera_arrays(views)
        for index, (T_camera_world, intrinsics) in enumerate(
            zip(cameras.T_camera_world, cameras.intrinsics, strict=True)
        ):
            mine = np.flatnonzero(view == index)
            R = T_camera_world[:3, :3]
            row = rows[mine] @ R.T
            points = points_world[mine] @ R.T + T_camera_world[:3, 3]
            # Seen from a camera that is moved, all points move the other way; the sign does not matter here.
            common[mine, :3] = self.hand_eye_translation_m * row
            common[mine, 3:6] = self.hand_eye_rotation_rad * cross(points, row)
            common[mine, 6:] = self.lens_px * _lens_shifts(row, points, intrinsics)
            arm[mine, 3 * index : 3 * index + 3] = self.arm_translation_m * rows[mine]
        # A root mean square length is shared out evenly among three independent components.
        return np.hstack([common, arm]) / np.sqrt(3)


EXACT = CalibrationError()
"""A calibration without errors."""


def _lens_shifts(row: Array, points: Array, intrinsics: Array) -> Array:
    """Motion (N, 3) along the contour normals by OpenCV's k1, p1 and p2, each one pixel in the picture's corner.

    Args:
        row: (N, 3) derivative of the motion by the point's position in the camera frame.
        points: (N, 3) in the camera frame.
        intrinsics: fx, fy, cx, cy; the principal point is taken for the picture's centre.
    """
    focal, centre = intrinsics[:2], intrinsics[2:]
    per_unit = row[:, :2] * points[:, 2:]  # by the position in the plane at depth 1, where distortion is defined
    fields = _distortion(points[:, :2] / points[:, 2:])
    in_corner = _distortion((centre + 0.5)[None] / focal) * focal
    along_normal = np.einsum("ni,kni->nk", per_unit, fields)
    return np.asarray(along_normal / np.linalg.norm(in_corner, axis=2).T)


def _distortion(points: Array) -> Array:
    """Displacement (3, N, 2) of points (N, 2) in the plane at depth 1, for k1, p1 and p2 of one."""
    x, y = points.T
    squared = x**2 + y**2
    radial = points * squared[:, None]
    return np.stack(
        [
            radial,
            np.column_stack([2 * x * y, squared + 2 * y**2]),
            np.column_stack([squared + 2 * x**2, 2 * x * y]),
        ]
    )
