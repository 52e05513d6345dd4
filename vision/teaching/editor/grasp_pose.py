"""A grasp as a person thinks of it: where, from which side, how the fingers are turned; and grasps for a circle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from vision.geometry.circle import Circle

_UPRIGHT = 1e-6
GRIP_DEPTH = 0.1  # of the radius: how far beyond the rim the finger tips reach


@dataclass(frozen=True)
class GraspPose:
    """Where the tool centre point is, and how it is turned: about z, then tilted, then turned about its own axis.

    Attributes:
        x_mm: position in the part's frame.
        y_mm: the same.
        z_mm: the same.
        tilt_deg: 180 comes from the front (against z), 90 from the side, 0 from the back.
        azimuth_deg: the side that a tilted approach goes towards.
        turn_deg: of the fingers about the approach axis.
    """

    x_mm: float
    y_mm: float
    z_mm: float
    tilt_deg: float = 180.0
    azimuth_deg: float = 0.0
    turn_deg: float = 0.0

    @classmethod
    def of(cls, T_part_tcp: RigidTransform) -> GraspPose:
        """The pose in these terms; where approach and axis are parallel, all the turning is of the fingers."""
        R = T_part_tcp.rotation.as_matrix()
        tilt = np.arctan2(np.hypot(R[0, 2], R[1, 2]), R[2, 2])
        if np.hypot(R[0, 2], R[1, 2]) > _UPRIGHT:
            azimuth, turn = np.arctan2(R[1, 2], R[0, 2]), np.arctan2(R[2, 1], -R[2, 0])
        else:
            azimuth, turn = 0.0, np.arctan2(R[1, 0], R[1, 1])
        angles = np.degrees([tilt, azimuth, turn]).round(6) + 0.0
        x, y, z = (1e3 * np.asarray(T_part_tcp.translation)).round(6) + 0.0
        return cls(float(x), float(y), float(z), float(angles[0]), float(angles[1]), float(angles[2]))

    def transform(self) -> RigidTransform:
        """T_part_tcp, the pose of the tool centre point."""
        angles = [self.azimuth_deg, self.tilt_deg, self.turn_deg]
        rotation = Rotation.from_euler("ZYZ", angles, degrees=True)
        return RigidTransform.from_components(np.array([self.x_mm, self.y_mm, self.z_mm]) / 1e3, rotation)


def grasp_on(circle: Circle, kind: str) -> tuple[GraspPose, float]:
    """A grasp on a circle and its width in metres.

    Args:
        circle: in the part's frame.
        kind: "outside" closes around it, "inside" opens in it; both reach a little below the rim. "rim" takes the
            wall at the circle between the fingers, one of them inside.
    """
    front = circle.normal[2] >= 0
    below = circle.centre - GRIP_DEPTH * circle.radius_m * circle.normal
    tilt = 180.0 if front else 0.0
    x, y, z = (1e3 * below).round(3)
    if kind == "rim":
        return GraspPose(round(x + 1e3 * circle.radius_m, 3), y, z, tilt), round(0.15 * circle.radius_m, 5)
    return GraspPose(x, y, z, tilt), round(2 * circle.radius_m, 5)


def bore_at(circle: Circle) -> RigidTransform:
    """The frame of a bore that a circle is the entry of: z into it."""
    rotation = Rotation.from_euler("x", 180.0 if circle.normal[2] >= 0 else 0.0, degrees=True)
    return RigidTransform.from_components(circle.centre.round(6), rotation)
