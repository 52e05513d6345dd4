"""Where to put a held piece down, and how to get there: free spots, several yaws, as flat as the arm can."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from robot.clearance import boxes_clearance, points_clearance
from robot.errors import UnreachableError
from robot.grasps import GraspPlan
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory, cartesian_path, joint_trajectory
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

_YAWS_RAD = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
_LEVELLINGS = (1.0, 0.75, 0.5, 0.25, 0.0)
_POINT_SPACING_M = 0.004
_CARRY_SAMPLE = 15  # rows between two looks at the carried piece
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
        rises_m: how much higher than the lift the carrying may go, the first that is free.
        carry_clearance_m: smallest distance of gripper and piece from walls and other pieces, while carried.
        loaded_speed: of the arm's limits, while something is held.
        empty_speed: of the arm's limits, on the way back.
        max_tries: how many ways that look free are tried for reach.
    """

    release_m: float = 0.003
    retreat_m: float = 0.06
    min_clearance_m: float = 0.0015
    gap_m: float = 0.006
    max_tilt_rad: float = float(np.radians(65))
    rises_m: tuple[float, ...] = (0.0, 0.08, 0.16)
    carry_clearance_m: float = 0.004
    loaded_speed: float = 0.7
    empty_speed: float = 1.0
    max_tries: int = 12


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Tray:
    """Where pieces are put down.

    Attributes:
        centre: (3,) middle of the upper surface of its floor, in the world.
        size_m: (2,) inner lengths along x and y.
        walls: its boards in the world, and those of whatever else stands around.
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
        carry: where it must be a rise, then through joint space, to above the spot.
        lower: straight down, until the piece almost touches.
        retreat: back along the tool's axis, then up.
        T_world_above: the tool centre point where the lowering begins.
        T_world_part: where the piece is meant to be when it is let go.
        flat: whether its axis then stands upright, so that it stays as it is.
    """

    carry: tuple[Trajectory, ...]
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
    tray = replace(tray, taken=_thinned(tray.taken))
    for rotation in _turns(plan, tray, parameters):
        if not _within_reach(kinematics, gripper, plan, rotation, tray):
            rejected["out of reach"] += 1
            continue
        spots = _Spots(plan, rotation, points_part, tray, gripper, parameters)
        spot = spots.first()
        if spot is None:
            rejected["no room"] += 1
            continue
        if tries == parameters.max_tries:
            break
        tries += 1
        placing = _motions(kinematics, gripper, plan, spots.lowered(spot), parameters, spots.blocked)
        if isinstance(placing, Placing):
            return PlacingChoice(placing, dict(rejected))
        rejected[placing] += 1
    return PlacingChoice(None, dict(rejected))


def _turns(plan: GraspPlan, tray: Tray, parameters: PlaceParameters) -> Iterator[Rotation]:
    """Orientations of the tool over the tray, those that lay the part flat first."""
    start = plan.T_world_lift.translation
    column = float(np.arctan2(tray.centre[1], tray.centre[0]) - np.arctan2(start[1], start[0]))
    lifted = plan.T_world_lift.rotation
    axis = (lifted * plan.T_tcp_part.rotation).as_matrix()[:, 2]
    upright = np.array([0.0, 0.0, 1.0 if axis[2] >= 0 else -1.0])
    turn = np.cross(axis, upright)
    sine = float(np.linalg.norm(turn))
    angle = float(np.arctan2(sine, axis @ upright))
    about = turn / sine if sine > 1e-9 else np.array([1.0, 0.0, 0.0])
    levelled = [Rotation.from_rotvec(share * angle * about) * lifted for share in _LEVELLINGS]
    allowed = [level for level in levelled if _tilt(level) <= max(parameters.max_tilt_rad, _tilt(lifted))]
    for level in allowed:
        for yaw in _YAWS_RAD:
            yield Rotation.from_euler("z", column + yaw) * level


def _thinned(points: Array) -> Array:
    """One point per cube of a grid that no finger slips through."""
    _, first = np.unique(np.floor(points / _POINT_SPACING_M).astype(np.int64), axis=0, return_index=True)
    return points[first]


def _within_reach(
    kinematics: ArmKinematics, gripper: GripperGeometry, plan: GraspPlan, rotation: Rotation, tray: Tray
) -> bool:
    """Whether the arm reaches the middle of the tray with the tool turned so, down there and up where it carries."""
    heights = float(tray.centre[2]) + 0.03, float(plan.T_world_lift.translation[2])
    poses = (RigidTransform.from_components([*tray.centre[:2], height], rotation) for height in heights)
    return all(kinematics.solutions(pose * gripper.T_flange_tcp.inv(), plan.lift.q[-1]) for pose in poses)


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
        self._T_tcp_part = plan.T_tcp_part
        held = RigidTransform.from_rotation(rotation) * self._T_tcp_part
        matrix = held.as_matrix()
        points = points_part @ matrix[:3, :3].T + matrix[:3, 3]
        self._middle = (points[:, :2].max(axis=0) + points[:, :2].min(axis=0)) / 2
        self._height = float(tray.centre[2]) + parameters.release_m - float(points[:, 2].min())
        flat = abs(matrix[2, 2]) > np.cos(FLAT_RAD)
        # What does not lie flat falls over to one side or the other.
        reach = np.linalg.norm(points[:, :2] - self._middle, axis=1).max()
        height = float(np.ptp(points[:, 2]))
        self._radius = float(reach) if flat else max(float(reach), 0.75 * height)
        self._open = gripper.boxes(plan.grasp.open_width_m)
        low, high = points_part.min(axis=0), points_part.max(axis=0)
        piece = Boxes(((low + high) / 2)[None], np.eye(3)[None], ((high - low) / 2)[None])
        self._loaded = gripper.boxes(plan.grasp.closed_width_m).joined(piece.moved(self._T_tcp_part))

    def blocked(self, turns: Array, places: Array) -> bool:
        """Whether gripper or piece come too near to something at poses of the tool (K, 3, 3), (K, 3)."""
        least, tray = self._parameters.carry_clearance_m, self._tray
        if boxes_clearance(self._loaded, turns, places, tray.walls, 2 * least).min() < least:
            return True
        return bool(points_clearance(self._loaded, turns, places, tray.taken, 2 * least).min() < least)

    def first(self) -> Array | None:
        """The first free spot (2,) in the order of the grid; None where the tray is full."""
        spots, taken = _grid(self._tray, self._radius), self._tray.taken
        if len(taken):
            apart = cKDTree(taken[:, :2]).query(spots)[0]
            spots = spots[apart >= self._radius + self._parameters.gap_m]
        return next((spot for some in np.array_split(spots, 1 + len(spots) // 8) for spot in self._clear(some)), None)

    def _clear(self, spots: Array) -> Array:
        """Those of the spots (N, 2) where the open gripper fits in beside walls and other pieces."""
        least = self._parameters.min_clearance_m
        places = np.column_stack([spots - self._middle, np.full(len(spots), self._height)])
        turns = np.broadcast_to(self._rotation.as_matrix(), (len(spots), 3, 3))
        free = boxes_clearance(self._open, turns, places, self._tray.walls, 2 * least) >= least
        spots, places, turns = spots[free], places[free], turns[free]
        return spots[points_clearance(self._open, turns, places, self._tray.taken, 2 * least) >= least]

    def lowered(self, spot: Array) -> RigidTransform:
        """T_world_tcp at which the piece is let go on a spot."""
        return RigidTransform.from_components([*(spot - self._middle), self._height], self._rotation)


def _grid(tray: Tray, radius: float) -> Array:
    """Places (N, 2) for discs of a radius, in rows along the long walls first: so the most of them fit in."""
    half = tray.size_m / 2 - radius - 0.003
    step = radius / 6
    x, y = (np.arange(-h, h + 1e-9, step) if h > 0 else np.zeros(1) for h in half)
    rows = y[np.argsort(-np.abs(y), kind="stable")]
    return tray.centre[:2] + np.stack(np.meshgrid(rows, x, indexing="ij")[::-1], axis=-1).reshape(-1, 2)


def _motions(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    plan: GraspPlan,
    lowered: RigidTransform,
    parameters: PlaceParameters,
    blocked: Callable[[Array, Array], bool],
) -> Placing | str:
    """The motions to a spot, or why there are none."""
    tcp, lifted = gripper.T_flange_tcp, plan.T_world_lift
    back = lowered * RigidTransform.from_translation([0.0, 0.0, -parameters.retreat_m])
    slow, fast = (kinematics.limits.scaled(s) for s in (parameters.loaded_speed, parameters.empty_speed))
    bearing = np.arctan2(lowered.translation[1], lowered.translation[0]) - np.arctan2(
        lifted.translation[1], lifted.translation[0]
    )
    q_lifted, why = plan.lift.q[-1], "out of reach"
    for rise in parameters.rises_m:
        height = float(lifted.translation[2]) + rise
        above = _raised(lowered, height)
        try:
            q_above = kinematics.inverse(above * tcp.inv(), q_lifted + bearing * np.eye(6)[0])
            carry = []
            if rise:
                up = (lifted, _raised(lifted, height))
                carry.append(cartesian_path(kinematics, up, q_lifted, T_flange_tool=tcp, limits=slow))
            carry.append(joint_trajectory(carry[-1].q[-1] if carry else q_lifted, q_above, slow))
            poses = [kinematics.forward(q) * tcp for q in carry[-1].q[::_CARRY_SAMPLE]]
            if blocked(np.array([p.rotation.as_matrix() for p in poses]), np.array([p.translation for p in poses])):
                why = "carry blocked"
                continue
            lower = cartesian_path(kinematics, (above, lowered), q_above, T_flange_tool=tcp, limits=slow)
            away = (lowered, back, _raised(back, float(lifted.translation[2])))
            retreat = cartesian_path(kinematics, away, lower.q[-1], T_flange_tool=tcp, limits=fast)
        except UnreachableError:
            continue
        T_world_part = lowered * plan.T_tcp_part
        flat = bool(abs(T_world_part.rotation.as_matrix()[2, 2]) > np.cos(FLAT_RAD))
        return Placing(tuple(carry), lower, retreat, above, T_world_part, flat)
    return why


def _raised(pose: RigidTransform, height: float) -> RigidTransform:
    """The pose lifted straight up to a height, or left where it is when it is higher."""
    lift = max(height - float(pose.translation[2]), 0.0)
    return RigidTransform.from_translation([0.0, 0.0, lift]) * pose
