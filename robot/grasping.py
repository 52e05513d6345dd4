"""Which piece to take, and how: collision-checked, reachable grasps."""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import joint_vector
from robot.clearance import boxes_clearance, points_clearance, swept_back
from robot.errors import UnreachableError
from robot.grasps import GraspChoice, GraspParameters, GraspPlan, OpenedGrasp, Piece, Rest
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import cartesian_line, cartesian_path
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

DEFAULT_PARAMETERS = GraspParameters()
_POINT_SPACING_M = 0.0025
_COLUMNS = 24  # across a piece, to find what lies upon it
_COVERED_COST = 4.0  # of a wholly covered piece, where each virtue counts up to one
_DESCENT_STEP_M = 0.005  # between two looks at the gripper on its way down to the straight approach


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Candidate:
    piece: int
    grasp: OpenedGrasp
    rotation: Array  # (3, 3) of T_world_tcp
    translation: Array  # (3,)
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
    finish: Callable[[GraspPlan], Rest | None] | None = None,
) -> GraspChoice[Rest]:
    """Choose the piece and the grasp that forgive most, among those that the arm can reach.

    Args:
        kinematics: the arm.
        gripper: the shape of the gripper.
        pieces: all localised pieces; each may be taken, the others are in the way.
        environment: bin walls, floor and the like in the world frame, open at the top.
        seed_q: (6,) where the arm is, in rad.
        parameters: what counts as good.
        finish: plans the rest of the task with a plan; where that gives None, the next best grasp is tried. Without
            it any plan will do.

    Returns:
        The plan and the rest, or None with the reasons.
    """
    seed = joint_vector(seed_q)
    rejected: list[Counter[str]] = [Counter() for _ in pieces]
    clouds = [_thinned(piece.points_world) for piece in pieces]
    obstacles = [
        np.concatenate([np.zeros((0, 3)), *(cloud for i, cloud in enumerate(clouds) if i != index)])
        for index in range(len(pieces))
    ]
    candidates = [
        candidate
        for index, piece in enumerate(pieces)
        for candidate in _candidates(
            index,
            piece,
            covered_share(clouds[index], obstacles[index]),
            gripper,
            environment,
            parameters,
            rejected[index],
        )
    ]
    tries = [0] * len(pieces)
    for candidate in _best_first(candidates, gripper, clouds, obstacles, parameters, rejected):
        why = rejected[candidate.piece]
        if tries[candidate.piece] == parameters.max_tries:
            why["not tried"] += 1
            continue
        tries[candidate.piece] += 1
        T_world_part = pieces[candidate.piece].T_world_part
        plan = _reach(candidate, T_world_part, kinematics, gripper, seed, parameters)
        if plan is None:
            why["out of reach"] += 1
            continue
        rest = None if finish is None else finish(plan)
        if finish is None or rest is not None:
            return GraspChoice(plan, rest, tuple(+counter for counter in rejected))
        why["of no use"] += 1
    return GraspChoice(None, None, tuple(+counter for counter in rejected))


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
    turn, origin = piece.T_world_part.rotation.as_matrix(), piece.T_world_part.translation
    for opened in piece.grasps:
        rotations, translations = turn @ opened.rotations, opened.translations @ turn.T + origin
        tilts = np.arccos(np.clip(-rotations[:, 2, 2], -1.0, 1.0))
        upright = np.flatnonzero(tilts <= parameters.max_tilt_rad)
        rejected["too tilted"] += len(tilts) - len(upright)
        tool = swept_back(_closing(gripper, opened), opened.approach_m)
        good = parameters.good_clearance_m
        clearances = boxes_clearance(tool, rotations[upright], translations[upright], environment, good)
        forgiven = min(opened.clearance_m / parameters.good_opening_m, 1.0)
        for number, clearance in zip(upright, clearances, strict=True):
            if clearance < parameters.min_clearance_m:
                rejected["collision"] += 1
                continue
            tilt = float(tilts[number])
            merit = piece.confidence + forgiven - tilt / parameters.max_tilt_rad - _COVERED_COST * covered
            yield _Candidate(index, opened, rotations[number], translations[number], float(clearance), tilt, merit)


def _best_first(
    candidates: Sequence[_Candidate],
    gripper: GripperGeometry,
    clouds: Sequence[Array],
    obstacles: Sequence[Array],
    parameters: GraspParameters,
    rejected: Sequence[Counter[str]],
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
        piece = candidate.piece
        clearance = min(
            candidate.clearance_m, _from_pieces(candidate, gripper, clouds[piece], obstacles[piece], parameters)
        )
        if clearance < parameters.min_clearance_m:
            rejected[piece]["collision"] += 1
            continue
        checked = replace(candidate, clearance_m=clearance, checked=True)
        heapq.heappush(queue, (-checked.score(parameters), next(number), checked))


def _from_pieces(
    candidate: _Candidate, gripper: GripperGeometry, own: Array, others: Array, parameters: GraspParameters
) -> float:
    """Clearance from the other pieces over the straight approach, and from all pieces on the way down to it.

    Cut at the good one. The way down is looked at step by step.
    """
    closing, good = _closing(gripper, candidate.grasp), parameters.good_clearance_m
    turn, place = candidate.rotation, candidate.translation
    tool = swept_back(closing, candidate.grasp.approach_m)
    near = float(points_clearance(tool, turn[None], place[None], others, good)[0])
    if near < parameters.min_clearance_m:
        return near
    start = place - candidate.grasp.approach_m * turn[:, 2]
    every = np.concatenate([own, others])
    halves = np.abs(closing.rotations.transpose(0, 2, 1) @ turn[2] * closing.half_sizes).sum(axis=1)
    lowest = float((closing.centres @ turn[2] - halves).min())
    height = min(parameters.free_height_m - start[2], float(every[:, 2].max()) - (start[2] + lowest))
    if height <= 0:
        return near
    rise = np.arange(_DESCENT_STEP_M, height + _DESCENT_STEP_M, _DESCENT_STEP_M)
    places = start + rise[:, None] * [0.0, 0.0, 1.0]
    turns = np.broadcast_to(turn, (len(places), 3, 3))
    return min(near, float(points_clearance(closing, turns, places, every, good).min()))


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
    T_world_part: RigidTransform,
    kinematics: ArmKinematics,
    gripper: GripperGeometry,
    seed: Array,
    parameters: GraspParameters,
) -> GraspPlan | None:
    """The motions of a candidate; None when the arm cannot do them."""
    tcp = RigidTransform.from_components(candidate.translation, Rotation.from_matrix(candidate.rotation))
    tool = gripper.T_flange_tcp
    via = tcp * RigidTransform.from_translation([0.0, 0.0, -candidate.grasp.approach_m])
    descent = max(parameters.free_height_m - float(via.translation[2]), 0.0)
    pregrasp = RigidTransform.from_translation([0.0, 0.0, descent]) * via
    lifted = RigidTransform.from_translation([0.0, 0.0, parameters.lift_m]) * tcp
    slow, loaded = (kinematics.limits.scaled(s) for s in (parameters.approach_speed, parameters.lift_speed))
    try:
        approach = cartesian_path(kinematics, (pregrasp, via, tcp), seed, T_flange_tool=tool, limits=slow)
        lift = cartesian_line(kinematics, tcp, lifted, approach.q[-1], T_flange_tool=tool, limits=loaded)
    except UnreachableError:
        return None
    return GraspPlan(
        candidate.piece,
        candidate.grasp,
        tcp.inv() * T_world_part,
        tcp,
        pregrasp,
        lifted,
        approach,
        lift,
        candidate.clearance_m,
        candidate.tilt_rad,
    )
