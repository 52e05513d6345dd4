from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from robot.arm import Arm, JointLimits
from robot.kinematics import HOME_Q, ArmKinematics
from robot.trajectory import joint_trajectory
from vision.errors import InputError

OVER_THE_BIN = np.radians([-15.0, -2.0, -3.0, 0.0, 5.0, 75.0])
HIGH = np.radians([0.0, -70.0, -30.0, 20.0, 80.0, 0.0])
TOOL = RigidTransform.from_translation([0, 0, 0.155])


@pytest.mark.parametrize("goal", [OVER_THE_BIN, HIGH])
def test_arm_arrives_and_carries(make_cell: Any, kinematics: ArmKinematics, goal: np.ndarray) -> None:
    """With gravity compensated the arm stands where it is told; 5 kg bend it by less than a millimetre."""
    cell = make_cell()
    cell.arm.place(HOME_Q)
    worst = 0.0
    move = joint_trajectory(HOME_Q, goal, kinematics.limits)
    for q, qd in zip(move.q, move.qd, strict=True):
        cell.arm.command(q, qd)
        cell.wait(move.dt_s)
        worst = max(worst, np.linalg.norm(cell.arm.T_world_flange.translation - kinematics.forward(q).translation))
    assert worst < 1e-2
    cell.wait(0.5)
    wanted = (kinematics.forward(goal) * TOOL).translation
    np.testing.assert_allclose(cell.site("arm/gripper/tcp").translation, wanted, atol=1e-6)
    cell.data.xfrc_applied[cell.model.body("arm/gripper/gripper_base").id, 2] = -5 * 9.81
    cell.wait(1.0)
    sag = np.linalg.norm(cell.site("arm/gripper/tcp").translation - wanted)
    assert 1e-5 < sag < 1e-3


def test_speed_feed_forward_removes_the_lag(make_cell: Any, kinematics: ArmKinematics) -> None:
    lag = {}
    move = joint_trajectory(HOME_Q, OVER_THE_BIN, kinematics.limits)
    for forward in (True, False):
        cell = make_cell()
        cell.arm.place(HOME_Q)
        worst = 0.0
        for q, qd in zip(move.q, move.qd, strict=True):
            cell.arm.command(q, qd if forward else None)
            cell.wait(move.dt_s)
            worst = max(worst, float(np.abs(cell.arm.joint_positions - q).max()))
        lag[forward] = worst
    assert lag[True] < lag[False] / 5


@pytest.mark.parametrize("goal", [OVER_THE_BIN, HIGH])
def test_the_measured_motion_keeps_the_limits(make_cell: Any, kinematics: ArmKinematics, goal: np.ndarray) -> None:
    """As seen by the joints themselves, step for step; the commands are those of every physics step."""
    cell, limits = make_cell(), kinematics.limits
    cell.arm.place(HOME_Q)
    speeds = []
    for command in joint_trajectory(HOME_Q, goal, limits).commands():
        cell.arm.command(*command)
        cell.wait(cell.model.opt.timestep)
        speeds.append(cell.arm.joint_velocities)
    rates = np.array(speeds)
    for limit in (limits.velocity, limits.acceleration, limits.jerk):
        share = np.abs(rates / limit).max()
        assert 0.9 < share < 1.1
        rates = np.diff(rates, axis=0) / cell.model.opt.timestep


def test_joint_state_and_flange_agree_with_the_kinematics(make_cell: Any, kinematics: ArmKinematics) -> None:
    cell = make_cell()
    cell.arm.place(HIGH)
    cell.wait(0.1)
    np.testing.assert_allclose(cell.arm.joint_positions, HIGH, atol=1e-7)
    np.testing.assert_allclose(cell.arm.joint_velocities, 0, atol=1e-7)
    np.testing.assert_allclose(cell.arm.T_world_flange.as_matrix(), kinematics.forward(HIGH).as_matrix(), atol=1e-6)


def test_the_arm_stands_on_the_floor_without_touching_itself(make_cell: Any) -> None:
    cell = make_cell()
    cell.arm.place(np.radians([0, -90, 40, 0, 90, 0]))
    cell.wait(0.01)
    assert cell.data.ncon == 0


def test_the_arm_meets_what_stands_in_its_way(make_cell: Any, kinematics: ArmKinematics) -> None:
    cell = make_cell('<body name="wall" pos="0.9 0.19 1.6"><geom type="box" size="0.05 0.3 0.4"/></body>')
    cell.arm.place(np.radians([0, -45, -45, 0, 0, 0]))
    cell.wait(0.01)
    names = {cell.model.body(cell.model.geom_bodyid[g]).name for c in cell.data.contact for g in c.geom}
    assert "wall" in names
    assert "arm/forearm" in names


def test_bad_input(make_cell: Any) -> None:
    cell = make_cell()
    with pytest.raises(InputError, match="commanded joint angles"):
        cell.arm.command(np.full(6, 7.0))
    with pytest.raises(InputError, match="6 finite numbers"):
        cell.arm.command([0.0, 0.0])
    with pytest.raises(InputError, match="no 'joint1'"):
        Arm(cell.model, cell.data)
    with pytest.raises(InputError, match="lower < upper"):
        JointLimits(np.ones(6), np.zeros(6), np.ones(6), np.ones(6), np.ones(6))
