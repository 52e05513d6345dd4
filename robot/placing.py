"""Where to put a held piece down, and how to get there: free spots, several yaws, as flat as the arm can."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.clearance import boxes_clearance, points_clearance
from robot.errors import UnreachableError
from robot.grasps import GraspPlan
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory, cartesian_path, joint_trajectory
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

_YAWS_RAD = np.radians([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180])
_LEVELLINGS = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
FLAT_RAD = float(np.radians(20))


@dataclass(frozen=True)
class PlaceParameters:
    """How pieces are put down.

    Attributes:
        release_m: height over the surface at which the piece is let go.
        retreat_m: length of the way back along the tool's axis.
        min_clearance_m: smallest distance of the open gripper from walls and other pieces.
        gap_m: smallest distance between two pieces that were put down.
        max_tilt_rad: largest angle of the tool from straight down.
        loaded_speed: of the arm's limits, while something is held.
        empty_speed: of the arm's limits, on the way back.
        max_tries: how many ways that look free are tried for reach.
    """

    release_m: float = 0.003
    retreat_m: float = 0.06
    min_clearance_m: float = 0.0015
    gap_m: float = 0.006
    max_tilt_rad: float = float(np.radians(65))
    loaded_speed: float = 0.4
    empty_speed: float = 1.0
    max_tries: int = 12


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Tray:
    """Where pieces are put down.

    Attributes:
        centre: (3,) middle of the upper surface of its floor, in the world.
        size_m: (2,) inner lengths along x and y.
        walls: its boards in the world.
        taken: (N, 3) points on what already lies there, in the world.
    """

    centre: Array
    size_m: Array
    walls: Boxes
    taken: Array = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class Placing:
    """The motions from the end of the lift to the empty hand over the tray.

    Attributes:
        carry: through joint space, to above the spot.
        lower: straight down, until the piece almost touches.
        retreat: back along the tool's axis, then up.
        T_world_above: the tool centre point where the lowering begins.
        T_world_part: where the piece is meant to be when it is let go.
        flat: whether its axis then stands upright, so that it stays as it is.
    """

    carry: Trajectory
    lower: Trajectory
    retreat: Trajectory
    T_world_above: RigidTransform
    T_world_part: RigidTransform
    flat: bool


@dataclass(frozen=True, eq=False)
class PlacingChoice:
    """The outcome of planning.

    Attributes:
        placing: the motions, None where there are none.
        rejected: how many ways fell for which reason.
    """

    placing: Placing | None
    rejected: Mapping[str, int] = field(default_factory=dict)


def plan_placing(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    plan: GraspPlan,
    points_part: Array,
    tray: Tray,
    parameters: PlaceParameters = PlaceParameters(),
) -> PlacingChoice:
    """Find a free spot in the tray and a way to put the held piece down there.

    The lifted tool turns about the arm's column and then, where it must, about the vertical; it leans so far that the
    part's axis stands upright, or as near to that as the tool's tilt allows.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        plan: how the piece is held.
        points_part: (M, 3) on the piece's surface, in its own frame.
        tray: where to, and what lies there.
        parameters: what counts as good.
    """
    rejected: Counter[str] = Counter()
    tries = 0
    for rotation in _turns(plan, tray, parameters):
        spots = _Spots(plan, rotation, points_part, tray, gripper, parameters)
        spot = spots.first()
        if spot is None:
            rejected["no room"] += 1
            continue
        if tries == parameters.max_tries:
            break
        tries += 1
        placing = _motions(kinematics, gripper, plan, spots.lowered(spot), parameters)
        if placing is not None:
            return PlacingChoice(placing, dict(rejected))
        rejected["out of reach"] += 1
    return PlacingChoice(None, dict(rejected))


def _turns(plan: GraspPlan, tray: Tray, parameters: PlaceParameters) -> Iterator[Rotation]:
    """Orientations of the tool over the tray, those that lay the part flat first."""
    start = plan.T_world_lift.translation
    column = float(np.arctan2(tray.centre[1], tray.centre[0]) - np.arctan2(start[1], start[0]))
    lifted = plan.T_world_lift.rotation
    axis = (lifted * plan.taught.T_part_tcp.rotation.inv()).as_matrix()[:, 2]
    upright = np.array([0.0, 0.0, 1.0 if axis[2] >= 0 else -1.0])
    turn = np.cross(axis, upright)
    sine = float(np.linalg.norm(turn))
    angle = float(np.arctan2(sine, axis @ upright))
    about = turn / sine if sine > 1e-9 else np.array([1.0, 0.0, 0.0])
    levelled = [Rotation.from_rotvec(share * angle * about) * lifted for share in _LEVELLINGS]
    allowed = [level for level in levelled if _tilt(level) <= max(parameters.max_tilt_rad, _tilt(lifted))]
    for level in allowed[:2]:
        for yaw in _YAWS_RAD:
            yield Rotation.from_euler("z", column + yaw) * level


def _tilt(rotation: Rotation) -> float:
    """Angle of the tool's axis from straight down."""
    return float(np.arccos(np.clip(-rotation.as_matrix()[2, 2], -1.0, 1.0)))


class _Spots:
    """The free places in the tray for one orientation of the tool."""

    def __init__(
        self,
        plan: GraspPlan,
        rotation: Rotation,
        points_part: Array,
        tray: Tray,
        gripper: GripperGeometry,
        parameters: PlaceParameters,
    ) -> None:
        self._rotation, self._tray, self._parameters = rotation, tray, parameters
        self._T_tcp_part = plan.taught.T_part_tcp.inv()
        held = RigidTransform.from_rotation(rotation) * self._T_tcp_part
        matrix = held.as_matrix()
        points = points_part @ matrix[:3, :3].T + matrix[:3, 3]
        self._middle = (points[:, :2].max(axis=0) + points[:, :2].min(axis=0)) / 2
        self._bottom = float(points[:, 2].min())
        flat = abs(matrix[2, 2]) > np.cos(FLAT_RAD)
        # What does not lie flat falls over to one side or the other.
        reach = np.linalg.norm(points[:, :2] - self._middle, axis=1).max()
        height = float(np.ptp(points[:, 2]))
        self._radius = float(reach) if flat else max(float(reach), 0.75 * height)
        self._flat = bool(flat)
        self._open = gripper.boxes(plan.grasp.open_width_m)

    def first(self) -> Array | None:
        """The first free spot (2,) in the order of `_grid`; None where the tray is full."""
        taken, limit = self._tray.taken, self._radius + self._parameters.gap_m
        for spot in _grid(self._tray, self._radius):
            if len(taken) and np.hypot(*(taken[:, :2] - spot).T).min() < limit:
                continue
            if self._clear(spot):
                return spot
        return None

    def _clear(self, spot: Array) -> bool:
        """Whether the open gripper fits in beside walls and other pieces."""
        pose = self.lowered(spot)
        turn, place = pose.rotation.as_matrix()[None], pose.translation[None]
        least = self._parameters.min_clearance_m
        if boxes_clearance(self._open, turn, place, self._tray.walls, 2 * least)[0] < least:
            return False
        return bool(points_clearance(self._open, turn, place, self._tray.taken, 2 * least)[0] >= least)

    def lowered(self, spot: Array) -> RigidTransform:
        """T_world_tcp at which the piece is let go on a spot."""
        height = float(self._tray.centre[2]) + self._parameters.release_m - self._bottom
        return RigidTransform.from_components([*(spot - self._middle), height], self._rotation)


def _grid(tray: Tray, radius: float) -> Iterator[Array]:
    """Places for discs of a radius, corner first, so that they end up in rows."""
    half = tray.size_m / 2 - radius - 0.003
    step = radius / 4
    axes = [np.arange(-h, h + 1e-9, step) if h > 0 else np.zeros(1) for h in half]
    for x in axes[0]:
        for y in axes[1][::-1]:
            yield tray.centre[:2] + np.array([x, y])


def _motions(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    plan: GraspPlan,
    lowered: RigidTransform,
    parameters: PlaceParameters,
) -> Placing | None:
    tcp, height = gripper.T_flange_tcp, float(plan.T_world_lift.translation[2])
    above = _raised(lowered, height)
    back = lowered * RigidTransform.from_translation([0.0, 0.0, -parameters.retreat_m])
    slow, fast = (kinematics.limits.scaled(s) for s in (parameters.loaded_speed, parameters.empty_speed))
    q_lifted = plan.lift.q[-1]
    start = plan.T_world_lift.translation
    bearing = np.arctan2(above.translation[1], above.translation[0]) - np.arctan2(start[1], start[0])
    try:
        q_above = kinematics.inverse(above * tcp.inv(), q_lifted + bearing * np.eye(6)[0])
        carry = joint_trajectory(q_lifted, q_above, slow)
        lower = cartesian_path(kinematics, (above, lowered), q_above, T_flange_tool=tcp, limits=slow)
        retreat = cartesian_path(
            kinematics, (lowered, back, _raised(back, height)), lower.q[-1], T_flange_tool=tcp, limits=fast
        )
    except UnreachableError:
        return None
    T_world_part = lowered * plan.taught.T_part_tcp.inv()
    flat = abs(T_world_part.rotation.as_matrix()[2, 2]) > np.cos(FLAT_RAD)
    return Placing(carry, lower, retreat, above, T_world_part, bool(flat))


def _raised(pose: RigidTransform, height: float) -> RigidTransform:
    """The pose lifted straight up to a height, or left where it is when it is higher."""
    lift = max(height - float(pose.translation[2]), 0.0)
    return RigidTransform.from_translation([0.0, 0.0, lift]) * pose
