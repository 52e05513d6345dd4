"""Tipping over what stands on edge and cannot be gripped: press on its upper edge and drag it to the free side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import joint_vector
from robot.clearance import boxes_clearance, points_clearance
from robot.errors import UnreachableError
from robot.grasps import Piece
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory, cartesian_path
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

LEAST_LEAN_RAD = float(np.radians(40))  # a part whose axis leans less than this lies flat
FINGER_ENDS_M = 0.005  # beyond the tool centre point
_ABOVE_M = 0.006
_ON_THE_EDGE_M = 0.002
_HALF_FINGER_M = 0.005
# The fingers rest on no more than this of the piece: further in, the edge would rise against them as it tips.
_OVERLAP_M = 0.002
_PRESS_M = 0.003
_TIP_RAD = float(np.radians(50))
_YAWS_RAD = np.radians([0, 45, 90, 135, 180, -135, -90, -45])
_ARC_STEPS = 8
_NEAR_M = 0.0015
_GRAZING_M = 0.003  # what a piece seems to sink into the floor while it turns about a point near its lowest edge
_TOUCHING_SHARE = 0.03  # of a piece's surface: what leans on its neighbour touches it somewhere all the way
_LEAST_CLEARANCE_M = 0.001
_SPEED, _DRAG_SPEED = 0.6, 0.3


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Tip:
    """A piece to be tipped over.

    Attributes:
        piece: its index.
        approach: down to a little above its edge; the first row is where to move to.
        press: down onto the edge, and further: it ends where the edge is felt.
        arc: (N, 3) steps in the world from there to the free side, as the edge takes them.
        T_world_start: the tool centre point where the approach begins.
    """

    piece: int
    approach: Trajectory
    press: Trajectory
    arc: Array
    T_world_start: RigidTransform


def plan_tip(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    pieces: Sequence[Piece],
    environment: Boxes,
    seed_q: ArrayLike,
    free_height_m: float,
    deeper_m: float = 0.0,
) -> Tip | None:
    """The first piece on edge that closed fingers can drag over, the highest first; None where there is none.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        pieces: all localised pieces.
        environment: bin walls, floor and the like in the world frame.
        seed_q: (6,) where the arm is, in rad.
        free_height_m: where the tool centre point is this high, the arm moves freely.
        deeper_m: how much lower than the edge the fingers are dragged, to press harder on it.
    """
    clouds = [piece.points_world for piece in pieces]
    order = sorted(range(len(pieces)), key=lambda index: -float(clouds[index][:, 2].max()))
    for index in order:
        axis = pieces[index].T_world_part.rotation.as_matrix()[:, 2]
        if abs(axis[2]) > np.cos(LEAST_LEAN_RAD):
            continue
        others = np.concatenate([np.zeros((0, 3)), *(c for i, c in enumerate(clouds) if i != index)])
        for arc, fallen in _arcs(clouds[index], axis):
            if _hits(fallen, environment, others):
                continue
            arc[1:, 2] -= deeper_m
            tip = _tip(index, arc, kinematics, gripper, environment, others, joint_vector(seed_q), free_height_m)
            if tip is not None:
                return tip
    return None


def _hits(points: Array, environment: Boxes, others: Array) -> bool:
    """Whether a piece on its way over meets a wall or another piece."""
    inside = points_clearance(environment, np.eye(3)[None], np.zeros((1, 3)), points, _NEAR_M)[0]
    if inside < -_GRAZING_M:
        return True
    return len(others) > 0 and float((cKDTree(others).query(points)[0] < _NEAR_M).mean()) > _TOUCHING_SHARE


def _arcs(points: Array, axis: Array) -> Iterator[tuple[Array, Array]]:
    """For either way to fall, where the fingers' ends go, (N, 3), and points on the piece when it has half fallen.

    The side to which the piece leans already comes first.
    """
    along = axis[:2] / np.linalg.norm(axis[:2])
    top, bottom = float(points[:, 2].max()), float(points[:, 2].min())
    upper = points[points[:, 2] > top - _ON_THE_EDGE_M]
    lower = points[points[:, 2] < bottom + _ON_THE_EDGE_M]
    lean = float((upper[:, :2].mean(axis=0) - lower[:, :2].mean(axis=0)) @ along)
    for side in sorted((1.0, -1.0), key=lambda side: -side * lean):
        edge = upper[np.argmax(side * upper[:, :2] @ along)]
        pivot = lower[np.argmax(side * lower[:, :2] @ along)]
        out, up = side * float((edge - pivot)[:2] @ along), float(edge[2] - pivot[2])
        turns = np.linspace(0.0, _TIP_RAD, _ARC_STEPS)
        outs = out * np.cos(turns) + up * np.sin(turns)
        ups = up * np.cos(turns) + (_OVERLAP_M - out) * np.sin(turns)
        start = np.array([*(edge[:2] + (_HALF_FINGER_M - _OVERLAP_M) * side * along), edge[2]])
        steps = np.column_stack([(outs - out)[:, None] * (side * along)[None], ups - up])
        about = np.cross([0.0, 0.0, 1.0], [*(side * along), 0.0])
        half = Rotation.from_rotvec(0.7 * _TIP_RAD * about)
        yield start + steps, half.apply(points - pivot) + pivot


def _tip(
    index: int,
    arc: Array,
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    environment: Boxes,
    others: Array,
    seed: Array,
    free_height_m: float,
) -> Tip | None:
    closed, tool = gripper.boxes(0.0), gripper.T_flange_tcp
    limits, slow = kinematics.limits.scaled(_SPEED), kinematics.limits.scaled(_DRAG_SPEED)
    places = arc + np.array([0.0, 0.0, FINGER_ENDS_M - _PRESS_M])
    for yaw in _YAWS_RAD:
        turn = Rotation.from_euler("zx", [yaw, np.pi])
        turns = np.broadcast_to(turn.as_matrix(), (len(places), 3, 3))
        least = _LEAST_CLEARANCE_M
        if boxes_clearance(closed, turns, places, environment, 2 * least).min() < least:
            continue
        if points_clearance(closed, turns, places, others, 2 * least).min() < least:
            continue
        poses = [RigidTransform.from_components(place, turn) for place in places]
        over = RigidTransform.from_components(places[0] + [0.0, 0.0, _ABOVE_M], turn)
        start = RigidTransform.from_components([*places[0][:2], max(free_height_m, places[0][2] + _ABOVE_M)], turn)
        try:
            approach = cartesian_path(kinematics, (start, over), seed, T_flange_tool=tool, limits=limits)
            press = cartesian_path(kinematics, (over, poses[0]), approach.q[-1], T_flange_tool=tool, limits=slow)
            drag_along(kinematics, gripper, poses[0], press.q[-1], arc - arc[0])
        except UnreachableError:
            continue
        return Tip(index, approach, press, arc - arc[0], start)
    return None


def drag_along(
    kinematics: ArmKinematics, gripper: GripperGeometry, T_world_tcp: RigidTransform, seed_q: ArrayLike, arc: Array
) -> Trajectory:
    """Take the fingers along an arc.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        T_world_tcp: where they are.
        seed_q: (6,) the same in joint angles, in rad.
        arc: (N, 3) steps in the world, in m.

    Raises:
        UnreachableError: the arm cannot.
    """
    poses = [RigidTransform.from_translation(step) * T_world_tcp for step in arc]
    limits = kinematics.limits.scaled(_DRAG_SPEED)
    return cartesian_path(kinematics, poses, seed_q, T_flange_tool=gripper.T_flange_tcp, limits=limits)
