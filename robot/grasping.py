"""Which piece to take, and how: collision-checked, reachable grasps."""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from robot.arm import joint_vector
from robot.clearance import boxes_clearance, points_clearance, swept_back
from robot.errors import UnreachableError
from robot.grasp_opening import copies_in_part
from robot.grasps import GraspChoice, GraspParameters, GraspPlan, OpenedGrasp, Piece
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import cartesian_line

Array = NDArray[np.float64]

DEFAULT_PARAMETERS = GraspParameters()
_POINT_SPACING_M = 0.0025
_COLUMNS = 24  # across a piece, to find what lies upon it
_COVERED_COST = 4.0  # of a wholly covered piece, where each virtue counts up to one


@dataclass(frozen=True, eq=False)
class _Candidate:
    piece: int
    grasp: OpenedGrasp
    T_world_tcp: RigidTransform
    clearance_m: float  # from the environment alone until `checked`, then from the other pieces too
    tilt_rad: float
    merit: float  # what the clearance has no part in
    checked: bool = False

    def score(self, parameters: GraspParameters) -> float:
        return self.merit + min(self.clearance_m / parameters.good_clearance_m, 1.0)


def plan_grasp(
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    pieces: Sequence[Piece],
    environment: Boxes,
    seed_q: ArrayLike,
    parameters: GraspParameters = DEFAULT_PARAMETERS,
    usable: Callable[[GraspPlan], bool] = lambda _: True,
) -> GraspChoice:
    """Choose the piece and the grasp that forgive most, among those that the arm can reach.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        pieces: all localised pieces; each may be taken, the others are in the way.
        environment: bin walls, floor and the like in the world frame.
        seed_q: (6,) where the arm is, in rad.
        parameters: what counts as good.
        usable: whether the rest of the task can be done with a plan; if not, the next best one is tried.

    Returns:
        The plan, or None with the reasons.
    """
    seed = joint_vector(seed_q)
    rejected: Counter[str] = Counter()
    clouds = [_thinned(piece.points_world) for piece in pieces]
    obstacles = [
        np.concatenate([np.zeros((0, 3)), *(cloud for i, cloud in enumerate(clouds) if i != index)])
        for index in range(len(pieces))
    ]
    candidates = [
        candidate
        for index, piece in enumerate(pieces)
        for candidate in _candidates(
            index, piece, covered_share(clouds[index], obstacles[index]), gripper, environment, parameters, rejected
        )
    ]
    tries = 0
    for candidate in _best_first(candidates, gripper, obstacles, parameters, rejected):
        if tries == parameters.max_tries:
            rejected["not tried"] += 1
            continue
        tries += 1
        plan = _reach(candidate, kinematics, gripper, seed, parameters)
        if plan is not None and usable(plan):
            return GraspChoice(plan, +rejected)
        rejected["out of reach" if plan is None else "of no use"] += 1
    return GraspChoice(None, +rejected)


def covered_share(points: Array, others: Array) -> float:
    """How much of a piece, seen from above, lies under other pieces.

    Args:
        points: (M, 3) on the piece, in the world.
        others: (N, 3) on the other pieces.

    Returns:
        The share of the vertical columns over the piece in which something else is higher.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    size = max(float((high - low).max()) / _COLUMNS, 1e-6)

    def tops(cloud: Array) -> Array:
        inside = ((cloud[:, :2] >= low) & (cloud[:, :2] <= high)).all(axis=1)
        column, row = ((cloud[inside, :2] - low) / size).astype(np.intp).T
        heights = np.full((_COLUMNS + 1, _COLUMNS + 1), -np.inf)
        np.maximum.at(heights, (column, row), cloud[inside, 2])
        return heights

    own = tops(points)
    occupied = np.isfinite(own)
    return float((tops(others) > own)[occupied].mean())


def _candidates(
    index: int,
    piece: Piece,
    covered: float,
    gripper: GripperGeometry,
    environment: Boxes,
    parameters: GraspParameters,
    rejected: Counter[str],
) -> Iterator[_Candidate]:
    """The grasps of one piece that do not collide with the environment."""
    if covered > parameters.max_covered:
        rejected["under other pieces"] += len(piece.grasps)
        return
    for opened in piece.grasps:
        poses = piece.T_world_part * copies_in_part(opened.grasp)
        rotations, translations = poses.rotation.as_matrix(), np.asarray(poses.translation)
        tilts = np.arccos(np.clip(-rotations[:, 2, 2], -1.0, 1.0))
        upright = np.flatnonzero(tilts <= parameters.max_tilt_rad)
        rejected["too tilted"] += len(tilts) - len(upright)
        tool = swept_back(_closing(gripper, opened), parameters.approach_m)
        clearances = boxes_clearance(tool, rotations[upright], translations[upright], environment)
        forgiven = min(opened.clearance_m / parameters.good_opening_m, 1.0)
        for number, clearance in zip(upright, clearances, strict=True):
            if clearance < parameters.min_clearance_m:
                rejected["collision"] += 1
                continue
            tilt = float(tilts[number])
            merit = piece.confidence + forgiven - tilt / parameters.max_tilt_rad - _COVERED_COST * covered
            room = min(float(clearance), parameters.good_clearance_m)
            yield _Candidate(index, opened, poses[int(number)], room, tilt, merit)


def _best_first(
    candidates: Sequence[_Candidate],
    gripper: GripperGeometry,
    obstacles: Sequence[Array],
    parameters: GraspParameters,
    rejected: Counter[str],
) -> Iterator[_Candidate]:
    """The candidates that also miss the other pieces, best first.

    The other pieces can only lower a score, and checking them is what takes the time: it is put off until a candidate
    leads.
    """
    number = itertools.count()
    queue = [(-c.score(parameters), next(number), c) for c in candidates]
    heapq.heapify(queue)
    while queue:
        _, _, candidate = heapq.heappop(queue)
        if candidate.checked:
            yield candidate
            continue
        clearance = min(
            candidate.clearance_m, _from_pieces(candidate, gripper, obstacles[candidate.piece], parameters)
        )
        if clearance < parameters.min_clearance_m:
            rejected["collision"] += 1
            continue
        checked = replace(candidate, clearance_m=clearance, checked=True)
        heapq.heappush(queue, (-checked.score(parameters), next(number), checked))


def _from_pieces(
    candidate: _Candidate, gripper: GripperGeometry, obstacles: Array, parameters: GraspParameters
) -> float:
    """Clearance from the other pieces over the straight approach, cut at the good one."""
    tool = swept_back(_closing(gripper, candidate.grasp), parameters.approach_m)
    matrix = candidate.T_world_tcp.as_matrix()
    found = points_clearance(tool, matrix[None, :3, :3], matrix[None, :3, 3], obstacles, parameters.good_clearance_m)
    return float(found[0])


def _closing(gripper: GripperGeometry, opened: OpenedGrasp) -> Boxes:
    """The gripper, with the fingers thickened by the way that they travel between open and closed."""
    open_, shut = gripper.boxes(opened.open_width_m), gripper.boxes(opened.closed_width_m)
    # The fingers' boxes are axis-parallel and travel along x alone, so the union is a box.
    travelled = np.abs(open_.centres - shut.centres) / 2
    return Boxes((open_.centres + shut.centres) / 2, open_.rotations, open_.half_sizes + travelled)


def _thinned(points: Array) -> Array:
    """One point per cube of a grid that no finger slips through."""
    _, first = np.unique(np.floor(points / _POINT_SPACING_M).astype(np.int64), axis=0, return_index=True)
    return points[first]


def _reach(
    candidate: _Candidate,
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    seed: Array,
    parameters: GraspParameters,
) -> GraspPlan | None:
    """The motions of a candidate; None when the arm cannot do them."""
    tcp, tool = candidate.T_world_tcp, gripper.T_flange_tcp
    pregrasp = tcp * RigidTransform.from_translation([0.0, 0.0, -parameters.approach_m])
    lifted = RigidTransform.from_translation([0.0, 0.0, parameters.lift_m]) * tcp
    slow, loaded = (kinematics.limits.scaled(s) for s in (parameters.approach_speed, parameters.lift_speed))
    try:
        approach = cartesian_line(kinematics, pregrasp, tcp, seed, T_flange_tool=tool, limits=slow)
        lift = cartesian_line(kinematics, tcp, lifted, approach.q[-1], T_flange_tool=tool, limits=loaded)
    except UnreachableError:
        return None
    return GraspPlan(
        candidate.piece,
        candidate.grasp,
        tcp,
        pregrasp,
        lifted,
        approach,
        lift,
        candidate.clearance_m,
        candidate.tilt_rad,
    )
