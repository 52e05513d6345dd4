"""Motion in time: jerk-limited joint moves, and straight lines of a tool."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import ruckig
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform, Slerp

from robot.arm import JointLimits, joint_vector
from robot.errors import UnreachableError
from robot.kinematics import ArmKinematics
from vision.errors import InputError
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

DEFAULT_DT_S = 0.002  # of the physics: a coarser staircase would shake the arm at every step
CORNER_M = 0.015
_LINE_STEP_M = 0.004
_LINE_STEP_RAD = np.radians(1.0)
_NO_STEP = 1e-6
# Between two neighbouring poses of a line no joint may turn further: the branch changed or the wrist is singular.
_MAX_JOINT_STEP_RAD = 0.15


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Trajectory:
    """Joint angles and speeds at equal time steps, from rest to rest.

    Attributes:
        q: (N, 6) joint angles in rad; the first row is the start, the last the goal.
        qd: (N, 6) joint speeds in rad/s.
        dt_s: the time between two rows in s.
    """

    q: Array
    qd: Array
    dt_s: float

    def __post_init__(self) -> None:
        for name in ("q", "qd"):
            values = np.array(getattr(self, name), dtype=float)
            if values.ndim != 2 or values.shape[1] != 6 or values.shape != np.shape(self.q):
                raise InputError(f"trajectory {name}", got=values.shape, expected="(N, 6), both alike")
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.q)

    @property
    def duration_s(self) -> float:
        """Time from the first row to the last."""
        return (len(self.q) - 1) * self.dt_s

    def commands(self) -> Iterator[tuple[Array, Array, Array]]:
        """What to command in each time step: angles at its beginning, speeds at its end, accelerations over it."""
        ends = np.vstack([self.qd[1:], np.zeros((1, 6))])
        return zip(self.q, ends, (ends - self.qd) / self.dt_s, strict=True)


def joint_trajectory(
    q_start: ArrayLike, q_goal: ArrayLike, limits: JointLimits, dt_s: float = DEFAULT_DT_S
) -> Trajectory:
    """The fastest move between two joint positions, all joints arriving together.

    Args:
        q_start: (6,) in rad.
        q_goal: (6,) in rad.
        limits: what the joints may do; see `JointLimits.scaled` for slower moves.
        dt_s: time step of the result in s.

    Raises:
        InputError: when an end is not six finite numbers within the limits.
    """
    ends = joint_vector(q_start), joint_vector(q_goal)
    for name, q in zip(("start", "goal"), ends, strict=True):
        if not limits.contain(q, tolerance_rad=1e-3):
            raise InputError(
                f"{name} of the joint move (deg)",
                got=np.degrees(q).round(2).tolist(),
                expected=f"within {limits.range_deg}",
            )
    q, qd = _rest_to_rest(*ends, limits.velocity, limits.acceleration, limits.jerk, dt_s)
    return Trajectory(q, qd, dt_s)


def cartesian_line(
    kinematics: ArmKinematics,
    T_world_start: RigidTransform,
    T_world_goal: RigidTransform,
    seed_q: ArrayLike,
    *,
    T_flange_tool: RigidTransform | None = None,
    limits: JointLimits | None = None,
    dt_s: float = DEFAULT_DT_S,
) -> Trajectory:
    """A straight line of the tool's origin at an evenly turning orientation.

    The line is followed by dense inverse kinematics from the seed on; ruckig then times the way along it, so slowly
    that no joint exceeds its limits.

    Args:
        kinematics: the arm.
        T_world_start: the tool's pose at the start.
        T_world_goal: the tool's pose at the end.
        seed_q: (6,) joint angles near (or at) the start, in rad.
        T_flange_tool: the tool on the flange; the flange itself when None.
        limits: what the joints may do; the arm's own when None.
        dt_s: time step of the result in s.

    Raises:
        InputError: when an argument is not finite.
        UnreachableError: when a pose on the line is out of reach, or the line meets a wrist singularity.
    """
    return cartesian_path(
        kinematics, (T_world_start, T_world_goal), seed_q, T_flange_tool=T_flange_tool, limits=limits, dt_s=dt_s
    )


def cartesian_path(
    kinematics: ArmKinematics,
    waypoints: Sequence[RigidTransform],
    seed_q: ArrayLike,
    *,
    T_flange_tool: RigidTransform | None = None,
    limits: JointLimits | None = None,
    dt_s: float = DEFAULT_DT_S,
) -> Trajectory:
    """Straight lines of the tool's origin from waypoint to waypoint in one go, their corners cut a little.

    Args:
        kinematics: the arm.
        waypoints: at least two poses of the tool in the world; corners are rounded by a parabola that begins and ends
            `CORNER_M`, or half a line's length, from the waypoint.
        seed_q: (6,) joint angles near (or at) the start, in rad.
        T_flange_tool: the tool on the flange; the flange itself when None.
        limits: what the joints may do; the arm's own when None.
        dt_s: time step of the result in s.

    Raises:
        InputError: when an argument is not finite.
        UnreachableError: when a pose on the way is out of reach, or the way meets a wrist singularity.
    """
    limits = kinematics.limits if limits is None else limits
    T_tool_flange = RigidTransform.identity() if T_flange_tool is None else T_flange_tool.inv()
    fractions, poses = _way(waypoints)
    rows = _follow(kinematics, poses, T_tool_flange, joint_vector(seed_q))
    if np.abs(rows - rows[0]).max() < 1e-9:
        return Trajectory(rows[:1], np.zeros((1, 6)), dt_s)
    path = CubicSpline(fractions, rows)
    along, speed = _along(path, limits, dt_s)
    q = np.asarray(path(along[:, 0]))
    q[0], q[-1] = rows[0], rows[-1]
    return Trajectory(q, np.asarray(path(along[:, 0], 1)) * speed, dt_s)


def _way(waypoints: Sequence[RigidTransform]) -> tuple[Array, list[RigidTransform]]:
    """Closely spaced poses along the lines with rounded corners, and where each is between 0 and 1."""
    start, poses = waypoints[0], list[RigidTransform]()
    for number in range(1, len(waypoints) - 1):
        here = waypoints[number]
        before, after = (_towards(here, waypoints[number + step], CORNER_M) for step in (-1, 1))
        poses += _line(start, before)[:-1] + _corner(before, here, after)[:-1]
        start = after
    poses += _line(start, waypoints[-1])
    steps = np.array([_distance(one, other) for one, other in itertools.pairwise(poses)])
    moved = np.concatenate([[True], steps > _NO_STEP])
    along = np.concatenate([[0.0], np.cumsum(steps)])[moved]
    return along / max(along[-1], _NO_STEP), [pose for pose, new in zip(poses, moved, strict=True) if new]


def _towards(here: RigidTransform, there: RigidTransform, distance_m: float) -> RigidTransform:
    """The pose on the line between two that lies so far from the first, at most half the way."""
    length = float(np.linalg.norm(there.translation - here.translation))
    share = 0.5 if length < 2 * distance_m else distance_m / length
    return _between(here, there, np.array([share]))[0]


def _distance(one: RigidTransform, other: RigidTransform) -> float:
    """Between two poses, in steps of a line."""
    angle = float((one.rotation.inv() * other.rotation).magnitude())
    moved = float(np.linalg.norm(other.translation - one.translation))
    return max(moved / _LINE_STEP_M, angle / _LINE_STEP_RAD)


def _corner(before: RigidTransform, corner: RigidTransform, after: RigidTransform) -> list[RigidTransform]:
    """A parabola that touches both lines."""
    shares = np.linspace(0.0, 1.0, 2 + int(np.ceil(_distance(before, corner) + _distance(corner, after))))
    turns = _between(before, after, shares)
    a, b, c = (pose.translation for pose in (before, corner, after))
    return [
        RigidTransform.from_components((1 - s) ** 2 * a + 2 * s * (1 - s) * b + s**2 * c, turn.rotation)
        for s, turn in zip(shares, turns, strict=True)
    ]


def _line(T_start: RigidTransform, T_goal: RigidTransform) -> list[RigidTransform]:
    """Closely spaced poses from the start to the goal."""
    steps = max(4, int(np.ceil(_distance(T_start, T_goal))))
    return _between(T_start, T_goal, np.linspace(0.0, 1.0, steps + 1))


def _between(T_start: RigidTransform, T_goal: RigidTransform, fractions: Array) -> list[RigidTransform]:
    turns = Slerp([0.0, 1.0], RigidTransform.concatenate([T_start, T_goal]).rotation)(fractions)
    points = T_start.translation + fractions[:, None] * (T_goal.translation - T_start.translation)
    return [RigidTransform.from_components(point, turn) for point, turn in zip(points, turns, strict=True)]


def _follow(
    kinematics: ArmKinematics, poses: list[RigidTransform], T_tool_flange: RigidTransform, seed: Array
) -> Array:
    rows = [kinematics.inverse(poses[0] * T_tool_flange, seed)]
    for index, pose in enumerate(poses[1:], start=1):
        rows.append(kinematics.inverse(pose * T_tool_flange, rows[-1]))
        jump = float(np.abs(rows[-1] - rows[-2]).max())
        if jump > _MAX_JOINT_STEP_RAD:
            raise UnreachableError(
                "straight line",
                got=f"a joint turns {np.degrees(jump):.1f} deg within {100 / (len(poses) - 1):.1f} % of it,"
                f" at {100 * index / (len(poses) - 1):.0f} %",
                expected=f"at most {np.degrees(_MAX_JOINT_STEP_RAD):.1f} deg",
                do="Tilt the tool, start from another joint position, or move through joint space.",
            )
    return np.array(rows)


def _along(path: CubicSpline, limits: JointLimits, dt_s: float) -> tuple[Array, Array]:
    """The fraction s (N, 1) along q(s) and its speed at every time step, as fast as every joint's limits allow.

    What a straight path in joint space would allow is slowed down by what the bends add: a motion that takes k times
    as long has k times smaller speeds, k² times smaller accelerations and k³ times smaller jerks.
    """
    first = np.abs(path(np.linspace(0.0, 1.0, 4 * len(path.x)), 1)).max(axis=0) + 1e-12

    def timed(slower: float) -> tuple[Array, Array]:
        velocity, acceleration, jerk = (
            np.array([(limit / first).min() / slower**power])
            for power, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1)
        )
        return _rest_to_rest(np.zeros(1), np.ones(1), velocity, acceleration, jerk, dt_s)

    return timed(_excess(path, timed(1.0)[0][:, 0], limits, dt_s))


def _excess(path: CubicSpline, along: Array, limits: JointLimits, dt_s: float) -> float:
    """By how much a motion along a path has to be slowed down to keep the limits; 1 where it keeps them."""
    rates, slower = np.asarray(path(along)), 1.0
    for power, limit in enumerate((limits.velocity, limits.acceleration, limits.jerk), start=1):
        rates = np.diff(rates, axis=0) / dt_s
        # The last step is a fraction of one.
        if len(rates) > 2:
            slower = max(slower, float((np.abs(rates[:-2]) / limit).max()) ** (1 / power))
    return slower


def _rest_to_rest(
    start: Array, goal: Array, velocity: Array, acceleration: Array, jerk: Array, dt_s: float
) -> tuple[Array, Array]:
    """Positions and speeds (N, D) of the time-optimal jerk-limited move."""
    if not dt_s > 0:
        raise InputError("time step (s)", got=dt_s, expected="above zero")
    query = ruckig.InputParameter(len(start))
    query.current_position, query.target_position = start.tolist(), goal.tolist()
    query.max_velocity, query.max_acceleration, query.max_jerk = (
        velocity.tolist(),
        acceleration.tolist(),
        jerk.tolist(),
    )
    profile = ruckig.Trajectory(len(start))
    result = ruckig.Ruckig(len(start), dt_s).calculate(query, profile)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise InputError("motion", got=f"ruckig's {result}", expected="a feasible move", do="Check the limits.")
    count = int(np.ceil(profile.duration / dt_s - 1e-9)) + 1
    samples = [profile.at_time(min(i * dt_s, profile.duration)) for i in range(count)]
    positions, speeds = np.array([s[0] for s in samples]), np.array([s[1] for s in samples])
    positions[0], positions[-1], speeds[-1] = start, goal, 0.0
    return positions.reshape(count, -1), speeds.reshape(count, -1)
