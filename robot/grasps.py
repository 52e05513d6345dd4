"""Values of grasp planning: what was taught, what lies there, what is good, and the plan."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from robot.trajectory import Trajectory
from vision.frozen import frozen_arrays
from vision.model.grasp import GraspCoordinates

Array = NDArray[np.float64]
Rest = TypeVar("Rest")


@dataclass(frozen=True, eq=False)
@frozen_arrays
class OpenedGrasp:
    """A taught grasp with a gap between the fingers that lets them pass the part on the way to it.

    Attributes:
        grasp: the taught grasp.
        open_width_m: the fingers' gap on the way.
        closed_width_m: the fingers' gap when they touch.
        clearance_m: distance of the gripper from the part itself over the approach: the error it forgives.
        approach_m: length of the straight approach along the tool's axis, over which the fingers reach the part.
        rotations: (K, 3, 3) of T_part_tcp of all copies, see ``robot.grasp_opening.copies_in_part``.
        translations: (K, 3) of the same in m.
    """

    grasp: GraspCoordinates
    open_width_m: float
    closed_width_m: float
    clearance_m: float
    approach_m: float
    rotations: Array
    translations: Array


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Piece:
    """A localised piece: a thing to take, and an obstacle while others are taken.

    Attributes:
        T_world_part: where it lies.
        grasps: how it may be held; none for a mere obstacle.
        points_part: (M, 3) points on its surface in m, dense enough for no finger (4 x 10 mm) to slip between.
        confidence: how sure its pose is, 0 to 1.
    """

    T_world_part: RigidTransform
    grasps: tuple[OpenedGrasp, ...]
    points_part: Array
    confidence: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_part", np.array(self.points_part, dtype=float).reshape(-1, 3))

    @property
    def points_world(self) -> Array:
        """(M, 3) the surface points in the world."""
        matrix = self.T_world_part.as_matrix()
        return np.asarray(self.points_part @ matrix[:3, :3].T + matrix[:3, 3])


@dataclass(frozen=True)
class GraspParameters:
    """What counts as a good grasp.

    Attributes:
        free_height_m: where the tool centre point is this high (world z), the arm moves freely: the approach begins
            there, straight down, and turns to the tool's axis where the fingers reach the part.
        lift_m: height of the straight lift along the world's z axis.
        min_clearance_m: smallest distance from everything but the piece itself.
        good_clearance_m: more distance than this is worth nothing.
        good_opening_m: more distance from the piece itself than this is worth nothing.
        max_tilt_rad: largest angle between the approach and straight down.
        max_covered: largest share of the piece that other pieces may lie upon.
        max_tries: how many of the best collision-free grasps of a piece are tried for reach.
        approach_speed: of the arm's limits, for the straight approach.
        lift_speed: of the arm's limits, for the straight lift.
    """

    free_height_m: float = 0.0
    lift_m: float = 0.15
    min_clearance_m: float = 0.0015
    good_clearance_m: float = 0.015
    good_opening_m: float = 0.003
    max_tilt_rad: float = float(np.radians(60))
    max_covered: float = 0.25
    max_tries: int = 12
    approach_speed: float = 0.7
    lift_speed: float = 0.7


@dataclass(frozen=True, eq=False)
class GraspPlan:
    """A grasp that can be carried out.

    Attributes:
        piece: index of the piece to take.
        grasp: which of its grasps, and how wide to open for it.
        T_tcp_part: the piece in the hand, as it will be held.
        T_world_tcp: the tool centre point when gripping.
        T_world_pregrasp: where the straight approach starts.
        T_world_lift: where the straight lift ends.
        approach: from the pre-grasp to the grasp; its first row is the joint position to move to.
        lift: from the grasp to the lift.
        clearance_m: distance from everything but the piece over the approach, cut at the good clearance.
        tilt_rad: angle of the approach from straight down.
    """

    piece: int
    grasp: OpenedGrasp
    T_tcp_part: RigidTransform
    T_world_tcp: RigidTransform
    T_world_pregrasp: RigidTransform
    T_world_lift: RigidTransform
    approach: Trajectory
    lift: Trajectory
    clearance_m: float
    tilt_rad: float

    @property
    def taught(self) -> GraspCoordinates:
        """The grasp as it was taught."""
        return self.grasp.grasp

    @property
    def q_pregrasp(self) -> Array:
        """(6,) joint angles at the pre-grasp in rad."""
        return np.array(self.approach.q[0])

    @property
    def q_grasp(self) -> Array:
        """(6,) joint angles at the grasp in rad."""
        return np.array(self.approach.q[-1])


@dataclass(frozen=True, eq=False)
class GraspChoice(Generic[Rest]):
    """The outcome of planning.

    Attributes:
        plan: the best grasp, or None where there is none.
        rest: what is done with the piece once it is lifted, None where there is no plan.
        rejected_by_piece: for every piece, how many of its candidates fell for which reason.
    """

    plan: GraspPlan | None
    rest: Rest | None
    rejected_by_piece: tuple[Mapping[str, int], ...] = ()

    @property
    def rejected(self) -> dict[str, int]:
        """How many candidates of all pieces fell for which reason."""
        return dict(sum(map(Counter, self.rejected_by_piece), Counter()))
