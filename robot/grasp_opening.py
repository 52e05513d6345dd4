"""How wide to open for a grasp, so that the fingers pass the part that they are about to hold.

All of it happens in the part's frame, so it is the same wherever the part lies.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.clearance import points_clearance, swept_back
from robot.grasps import OpenedGrasp
from robot.gripper_geometry import GripperGeometry
from vision.model.grasp import GraspCoordinates

Array = NDArray[np.float64]

MARGINS_M = (0.0006, 0.001, 0.002, 0.004)
LEAST_CLEARANCE_M = 0.0004
_MOST_CLEARANCE_M = 0.005
_FREE_OF_PART_M = 0.008  # between the fingers' ends and the part where the straight approach begins
_SAME, _FLIPPED = (RigidTransform.from_rotation(Rotation.from_euler("z", turn)) for turn in (0.0, np.pi))


def opened_grasps(
    gripper: GripperGeometry, grasps: Sequence[GraspCoordinates], points_part: ArrayLike, approach_m: float
) -> tuple[OpenedGrasp, ...]:
    """The grasps that the gripper can reach past the part itself, each with every opening worth trying.

    A wider opening is worth trying only if it leaves more room: beside a wall or inside a cup it may leave less.

    Args:
        gripper: its shape.
        grasps: as taught.
        points_part: (N, 3) points on the part's surface in m, closer together than the clearances that matter.
        approach_m: length of the longest straight approach; where the fingers leave the part sooner, it is shorter.

    Returns:
        In the order of the grasps, the narrowest opening first; grasps that never clear the part are left out.
    """
    points = np.asarray(points_part, dtype=float)
    return tuple(opened for grasp in grasps for opened in _openings(gripper, grasp, points, approach_m))


def copies_in_part(grasp: GraspCoordinates) -> RigidTransform:
    """T_part_tcp of all copies about the part's axis, each also with the gripper turned half round: a stack."""
    poses = grasp.poses()
    return RigidTransform.concatenate([pose * flip for pose in poses for flip in (_SAME, _FLIPPED)])


def _openings(
    gripper: GripperGeometry, grasp: GraspCoordinates, points: Array, approach_m: float
) -> list[OpenedGrasp]:
    inside = grasp.kind == "inside"
    closed = grasp.width_m - 2 * gripper.finger_thickness_m * inside
    poses = copies_in_part(grasp)
    rotations, translations = poses.rotation.as_matrix(), np.asarray(poses.translation)
    straight = min(approach_m, _depth(gripper, rotations[0], translations[0], points) + _FREE_OF_PART_M)
    found: list[OpenedGrasp] = []
    most = 0.0
    for margin in MARGINS_M:
        width = closed - 2 * margin if inside else closed + 2 * margin
        if not 0 <= width <= gripper.max_width_m:
            continue
        tool = swept_back(gripper.boxes(width), straight)
        clearance = float(points_clearance(tool, rotations, translations, points, _MOST_CLEARANCE_M).min())
        if clearance < LEAST_CLEARANCE_M:
            break  # what is in the way here is in the way of a wider opening when the fingers close
        if clearance > most:
            found.append(OpenedGrasp(grasp, width, closed, clearance, straight, rotations, translations))
            most = 1.1 * clearance
    return found


def _depth(gripper: GripperGeometry, rotation: Array, translation: Array, points: Array) -> float:
    """How far the fingers' ends are beyond the first point of the part that they meet, along the approach."""
    if not len(points):
        return 0.0
    fingers = gripper.left
    ends = float(
        (fingers.centres[:, 2] + np.einsum("nj,nj->n", np.abs(fingers.rotations[:, 2]), fingers.half_sizes)).max()
    )
    return ends - float(((points - translation) @ rotation[:, 2]).min())
