"""How a peg on the tool comes to a few millimetres above a bore."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from robot.clearance import boxes_clearance
from robot.errors import UnreachableError
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory, cartesian_path

MOST_TILT_RAD = float(np.radians(45))
HOVER_M = 0.004
_YAWS_RAD = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
_LEAST_CLEARANCE_M = 0.002


@dataclass(frozen=True, eq=False)
class BoreApproach:
    """A way to a bore.

    Attributes:
        approach: down to the hover pose; its first row is where to move to.
        T_world_bore: the origin is the centre of the entry, z points into the bore.
        T_world_start: the tool centre point where the approach begins.
    """

    approach: Trajectory
    T_world_bore: RigidTransform
    T_world_start: RigidTransform


def approach_bore(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    T_world_bore: RigidTransform,
    tip_m: float,
    environment: Boxes,
    seed_q: ArrayLike,
    free_height_m: float,
) -> BoreApproach | None:
    """The first way that is free and within reach, None where there is none.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        T_world_bore: the origin is the centre of the entry, z points into the bore.
        tip_m: of the peg, beyond the tool centre point.
        environment: walls in the world frame.
        seed_q: (6,) where the arm is, in rad.
        free_height_m: where the tool centre point is this high, the arm moves freely.
    """
    axis = T_world_bore.rotation.as_matrix()[:, 2]
    if -axis[2] < np.cos(MOST_TILT_RAD):
        return None
    closed = gripper.boxes(0.0)
    for yaw in _YAWS_RAD:
        turned = T_world_bore * RigidTransform.from_rotation(Rotation.from_euler("z", yaw))
        hover = turned * RigidTransform.from_translation([0.0, 0.0, -HOVER_M - tip_m])
        rise = max(free_height_m - float(hover.translation[2]), 0.0) + tip_m
        start = RigidTransform.from_translation([0.0, 0.0, rise]) * hover
        place, turn = hover.translation[None], hover.rotation.as_matrix()[None]
        if boxes_clearance(closed, turn, place, environment, 2 * _LEAST_CLEARANCE_M)[0] < _LEAST_CLEARANCE_M:
            continue
        limits = kinematics.limits.scaled(0.6)
        try:
            approach = cartesian_path(
                kinematics, (start, hover), seed_q, T_flange_tool=gripper.T_flange_tcp, limits=limits
            )
        except UnreachableError:
            continue
        return BoreApproach(approach, T_world_bore, start)
    return None
