from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from robot.errors import UnreachableError
from robot.kinematics import HOME_Q, ArmKinematics
from robot.trajectory import Trajectory, cartesian_line, joint_trajectory
from vision.errors import InputError

LIMITS = ArmKinematics().limits
TOOL = RigidTransform.from_translation([0, 0, 0.155])


def assert_within_limits(trajectory: Trajectory) -> None:
    """Finite differences are means of the derivatives, so they may not exceed the limits either."""
    rates = trajectory.q
    for limit in (LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk):
        rates = np.diff(rates, axis=0) / trajectory.dt_s
        # The last row is put onto the goal a fraction of a time step early.
        assert (np.abs(rates[:-3]) <= limit * (1 + 1e-4) + 1e-3).all()


@given(st.lists(st.floats(0, 1), min_size=12, max_size=12))
@settings(max_examples=30, deadline=None)
def test_joint_move_obeys(numbers: list[float]) -> None:
    start, goal = LIMITS.lower + np.reshape(numbers, (2, 6)) * (LIMITS.upper - LIMITS.lower)
    trajectory = joint_trajectory(start, goal, LIMITS)
    np.testing.assert_array_equal(trajectory.q[0], start)
    np.testing.assert_array_equal(trajectory.q[-1], goal)
    np.testing.assert_array_equal(trajectory.qd[[0, -1]], 0)
    assert LIMITS.contain(trajectory.q)
    assert_within_limits(trajectory)


def test_no_move_is_one_row() -> None:
    assert len(joint_trajectory(HOME_Q, HOME_Q, LIMITS)) == 1


def test_half_speed_takes_twice_as_long() -> None:
    goal = HOME_Q + 0.5
    full, half = (joint_trajectory(HOME_Q, goal, LIMITS.scaled(speed), dt_s=1e-4) for speed in (1.0, 0.5))
    assert half.duration_s == pytest.approx(2 * full.duration_s, abs=4e-4)


def test_bad_joint_moves() -> None:
    with pytest.raises(InputError, match="goal of the joint move"):
        joint_trajectory(HOME_Q, np.full(6, 9.0), LIMITS)
    with pytest.raises(InputError, match="speed"):
        LIMITS.scaled(0)
    with pytest.raises(InputError, match="time step"):
        joint_trajectory(HOME_Q, HOME_Q + 0.1, LIMITS, dt_s=0)


def test_line_is_straight_and_obeys(kinematics: ArmKinematics) -> None:
    turn = Rotation.from_euler("x", np.pi)
    start = RigidTransform.from_components([0.75, 0.1, 0.40], turn)
    goal = RigidTransform.from_components([0.80, 0.0, 0.12], Rotation.from_euler("y", 0.2) * turn)
    trajectory = cartesian_line(kinematics, start, goal, HOME_Q, T_flange_tool=TOOL)
    tool = [kinematics.forward(q) * TOOL for q in trajectory.q]
    points = np.array([pose.translation for pose in tool])
    along = goal.translation - start.translation
    along /= np.linalg.norm(along)
    offsets = points - start.translation
    assert np.linalg.norm(offsets - np.outer(offsets @ along, along), axis=1).max() < 2e-5
    assert (np.diff(offsets @ along) > -1e-9).all()
    np.testing.assert_allclose(tool[0].as_matrix(), start.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(tool[-1].as_matrix(), goal.as_matrix(), atol=1e-6)
    assert_within_limits(trajectory)
    np.testing.assert_allclose(np.diff(trajectory.q, axis=0)[:-1] / trajectory.dt_s, trajectory.qd[1:-1], atol=0.02)


def test_line_of_no_length(kinematics: ArmKinematics) -> None:
    pose = kinematics.forward(HOME_Q)
    assert len(cartesian_line(kinematics, pose, pose, HOME_Q)) == 1


def test_line_out_of_reach(kinematics: ArmKinematics) -> None:
    pose = kinematics.forward(HOME_Q)
    with pytest.raises(UnreachableError):
        cartesian_line(kinematics, pose, RigidTransform.from_translation([1.5, 0, 0]) * pose, HOME_Q)


def test_line_through_a_wrist_singularity_is_refused(kinematics: ArmKinematics) -> None:
    """Passing a straight wrist sideways needs an infinitely fast turn of joint 4."""
    q = np.radians([0, -45, 15, 0, 1, 0])
    pose = kinematics.forward(q)
    swing = RigidTransform.from_rotation(Rotation.from_euler("xy", [2, -2], degrees=True))
    wrist = RigidTransform.from_translation([0, 0, -0.125])
    with pytest.raises(UnreachableError, match="a joint turns"):
        cartesian_line(kinematics, pose, pose * wrist * swing * wrist.inv(), q)
