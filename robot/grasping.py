"""Which piece to take, and how: collision-checked, reachable grasps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import joint_vector
from robot.clearance import boxes_clearance, points_clearance, swept_back
from robot.errors import UnreachableError
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory, cartesian_line
from vision.errors import InputError

Array = NDArray[np.float64]

_POINT_SPACING_M = 0.0025


@dataclass(frozen=True, eq=False)
class TaughtGrasp:
    """Where to hold a part.

    Attributes:
        name: a label for people.
        T_part_tcp: the tool centre point on the part (z approach, x opening direction).
        width_m: size of what is gripped, along x: outer size for an outside grip, bore for an inside grip.
        kind: close on the outside or open on the inside.
        copies: how many equally spaced rotations about the part's z axis are equally good.
    """

    name: str
    T_part_tcp: RigidTransform
    width_m: float
    kind: Literal["outside", "inside"]
    copies: int = 1

    def __post_init__(self) -> None:
        if self.kind not in ("outside", "inside"):
            raise InputError(f"kind of grasp {self.name}", got=self.kind, expected="outside or inside")
        if not self.width_m > 0 or self.copies < 1:
            raise InputError(
                f"grasp {self.name}", got=f"width {self.width_m} m, {self.copies} copies", expected="both above zero"
            )

    def __reduce__(self) -> tuple[object, ...]:
        """Rebuild through the constructor, which checks the values."""
        return (TaughtGrasp, (self.name, self.T_part_tcp, self.width_m, self.kind, self.copies))


@dataclass(frozen=True, eq=False)
class Piece:
    """A localised piece: a thing to take, and an obstacle while others are taken.

    Attributes:
        T_world_part: where it lies.
        grasps: how it may be held; none for a mere obstacle.
        points_part: (M, 3) points on its surface in m, dense enough for no finger (4 x 10 mm) to slip between.
    """

    T_world_part: RigidTransform
    grasps: tuple[TaughtGrasp, ...]
    points_part: Array

    def __post_init__(self) -> None:
        points = np.array(self.points_part, dtype=float).reshape(-1, 3)
        points.flags.writeable = False
        object.__setattr__(self, "points_part", points)

    def __reduce__(self) -> tuple[object, ...]:
        """Run the constructor again after unpickling, so that the array stays read-only."""
        return (Piece, (self.T_world_part, self.grasps, self.points_part))

    @property
    def points_world(self) -> Array:
        """(M, 3) the surface points in the world."""
        return np.asarray(self.T_world_part.apply(self.points_part)).reshape(-1, 3)


@dataclass(frozen=True)
class GraspSettings:
    """What counts as a good grasp.

    Attributes:
        approach_m: length of the straight approach along the tool's axis.
        lift_m: height of the straight lift along the world's z axis.
        opening_m: extra opening on each side before gripping.
        min_clearance_m: smallest distance from everything but the piece itself.
        good_clearance_m: more distance than this is worth nothing.
        max_tilt_rad: largest angle between the approach and straight down.
        max_tries: how many of the best collision-free grasps are tried for reach.
    """

    approach_m: float = 0.10
    lift_m: float = 0.15
    opening_m: float = 0.004
    min_clearance_m: float = 0.0015
    good_clearance_m: float = 0.015
    max_tilt_rad: float = float(np.radians(45))
    max_tries: int = 30


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """A grasp that can be carried out.

    Attributes:
        piece: index of the piece to take.
        grasp: which of its grasps.
        T_world_tcp: the tool centre point when gripping.
        T_world_pregrasp: where the straight approach starts.
        T_world_lift: where the straight lift ends.
        open_width_m: the fingers' gap on the way to the piece.
        approach: from the pre-grasp to the grasp; its first row is the joint position to move to.
        lift: from the grasp to the lift.
        clearance_m: distance from everything but the piece over the approach, cut at the good clearance.
        tilt_rad: angle of the approach from straight down.
    """

    piece: int
    grasp: TaughtGrasp
    T_world_tcp: RigidTransform
    T_world_pregrasp: RigidTransform
    T_world_lift: RigidTransform
    open_width_m: float
    approach: Trajectory
    lift: Trajectory
    clearance_m: float
    tilt_rad: float

    @property
    def q_pregrasp(self) -> Array:
        """(6,) joint angles at the pre-grasp in rad."""
        return np.array(self.approach.q[0])

    @property
    def q_grasp(self) -> Array:
        """(6,) joint angles at the grasp in rad."""
        return np.array(self.approach.q[-1])


@dataclass(frozen=True, eq=False)
class GraspChoice:
    """The outcome of planning.

    Attributes:
        plan: the best grasp, or None where there is none.
        rejected: how many candidates fell for which reason.
    """

    plan: GraspPlan | None
    rejected: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class _Candidate:
    piece: int
    grasp: TaughtGrasp
    T_world_tcp: RigidTransform
    open_width_m: float
    clearance_m: float
    tilt_rad: float


def plan_grasp(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    pieces: Sequence[Piece],
    environment: Boxes,
    seed_q: ArrayLike,
    settings: GraspSettings = GraspSettings(),
) -> GraspChoice:
    """Choose the piece and the grasp with the best mixture of clearance and verticality that the arm can reach.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        pieces: all localised pieces; each may be taken, the others are in the way.
        environment: bin walls, floor and the like in the world frame.
        seed_q: (6,) where the arm is, in rad.
        settings: what counts as good.

    Returns:
        The plan, or None with the reasons.
    """
    seed = joint_vector(seed_q)
    rejected: Counter[str] = Counter()
    clouds = [_thinned(piece.points_world) for piece in pieces]
    candidates = [
        candidate
        for index in range(len(pieces))
        for candidate in _free(index, gripper, pieces, clouds, environment, settings, rejected)
    ]
    candidates.sort(key=lambda c: _score(c, settings), reverse=True)
    for candidate in candidates[: settings.max_tries]:
        plan = _reach(candidate, kinematics, gripper, seed, settings)
        if plan is not None:
            return GraspChoice(plan, dict(rejected))
        rejected["out of reach"] += 1
    rejected["not tried"] += max(0, len(candidates) - settings.max_tries)
    return GraspChoice(None, {reason: count for reason, count in rejected.items() if count})


def _score(candidate: _Candidate, settings: GraspSettings) -> float:
    clearance = min(candidate.clearance_m / settings.good_clearance_m, 1.0)
    return clearance - candidate.tilt_rad / settings.max_tilt_rad


def _free(
    index: int,
    gripper: GripperGeometry,
    pieces: Sequence[Piece],
    clouds: Sequence[Array],
    environment: Boxes,
    settings: GraspSettings,
    rejected: Counter[str],
) -> Iterator[_Candidate]:
    """The grasps of one piece that collide with nothing."""
    own = clouds[index]
    obstacles = np.concatenate([np.zeros((0, 3)), *(cloud for i, cloud in enumerate(clouds) if i != index)])
    for grasp in pieces[index].grasps:
        width = _open_width(grasp, gripper, settings)
        if width is None:
            rejected["wider than the gripper"] += 1
            continue
        poses = _copies(pieces[index].T_world_part, grasp)
        rotations, translations = poses.rotation.as_matrix(), poses.translation
        tilts = np.arccos(np.clip(-rotations[:, 2, 2], -1.0, 1.0))
        upright = np.flatnonzero(tilts <= settings.max_tilt_rad)
        rejected["too tilted"] += len(tilts) - len(upright)
        if not len(upright):
            continue
        clearances = _clearances(
            gripper, width, rotations[upright], translations[upright], own, obstacles, environment, settings
        )
        for number, clearance in zip(upright, clearances, strict=True):
            if clearance < settings.min_clearance_m:
                rejected["collision"] += 1
            else:
                yield _Candidate(index, grasp, poses[int(number)], width, float(clearance), float(tilts[number]))


def _open_width(grasp: TaughtGrasp, gripper: GripperGeometry, settings: GraspSettings) -> float | None:
    """The gap on the way to the piece; None when the grasp is beyond the gripper."""
    if grasp.kind == "inside":
        closed = grasp.width_m - 2 * gripper.finger_thickness_m
        return max(0.0, closed - 2 * settings.opening_m) if 0 < closed <= gripper.max_width_m else None
    return (
        min(gripper.max_width_m, grasp.width_m + 2 * settings.opening_m)
        if grasp.width_m < gripper.max_width_m
        else None
    )


def _copies(T_world_part: RigidTransform, grasp: TaughtGrasp) -> RigidTransform:
    """T_world_tcp of all copies about the part's axis, each also with the gripper turned half round."""
    angles = 2 * np.pi * np.arange(grasp.copies) / grasp.copies
    turns = Rotation.from_rotvec(np.repeat(angles, 2)[:, None] * [0.0, 0.0, 1.0])
    flips = Rotation.from_rotvec(np.tile([0.0, np.pi], grasp.copies)[:, None] * [0.0, 0.0, 1.0])
    turned = T_world_part * RigidTransform.from_rotation(turns) * grasp.T_part_tcp
    return turned * RigidTransform.from_rotation(flips)


def _clearances(
    gripper: GripperGeometry,
    width_m: float,
    rotations: Array,
    translations: Array,
    own: Array,
    obstacles: Array,
    environment: Boxes,
    settings: GraspSettings,
) -> Array:
    """(K,) smallest clearance over the straight approach, cut at the good one; the cheap checks go first."""
    tool = swept_back(gripper.boxes(width_m), settings.approach_m)
    good = settings.good_clearance_m
    clearances = np.minimum(boxes_clearance(tool, rotations, translations, environment), good)
    # The fingers are meant to touch the piece itself; the palm and the camera are not.
    for boxes, points in ((gripper.palm, own), (tool, obstacles)):
        free = np.flatnonzero(clearances >= settings.min_clearance_m)
        found = points_clearance(boxes, rotations[free], translations[free], points, good)
        clearances[free] = np.minimum(clearances[free], found)
    return clearances


def _thinned(points: Array) -> Array:
    """One point per cube of a grid that no finger slips through."""
    _, first = np.unique(np.floor(points / _POINT_SPACING_M).astype(np.int64), axis=0, return_index=True)
    return points[first]


def _reach(
    candidate: _Candidate, kinematics: ArmKinematics, gripper: GripperGeometry, seed: Array, settings: GraspSettings
) -> GraspPlan | None:
    """The motions of a candidate; None when the arm cannot do them."""
    tcp = candidate.T_world_tcp
    pregrasp = tcp * RigidTransform.from_translation([0.0, 0.0, -settings.approach_m])
    lifted = RigidTransform.from_translation([0.0, 0.0, settings.lift_m]) * tcp
    tool = gripper.T_flange_tcp
    try:
        approach = cartesian_line(kinematics, pregrasp, tcp, seed, T_flange_tool=tool)
        lift = cartesian_line(kinematics, tcp, lifted, approach.q[-1], T_flange_tool=tool)
    except UnreachableError:
        return None
    return GraspPlan(
        candidate.piece,
        candidate.grasp,
        tcp,
        pregrasp,
        lifted,
        candidate.open_width_m,
        approach,
        lift,
        candidate.clearance_m,
        candidate.tilt_rad,
    )
