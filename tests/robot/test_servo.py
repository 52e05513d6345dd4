"""The wrist's sensor, and the servo that its forces drive."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from robot.kinematics import ArmKinematics
from robot.servo import CartesianServo
from robot.wrist import WristSensor

Q = np.radians([-15.0, -40.0, 10.0, 5.0, 40.0, 20.0])
TOOL = RigidTransform.from_translation([0.0, 0.0, 0.2])


def test_jacobian_is_the_derivative_of_the_forward_kinematics(kinematics: ArmKinematics) -> None:
    jacobian, step = kinematics.jacobian(Q, TOOL), 1e-6
    for joint in range(6):
        ends = [kinematics.forward(Q + side * step * np.eye(6)[joint]) * TOOL for side in (-1, 1)]
        moved = (ends[1].translation - ends[0].translation) / (2 * step)
        turned = (ends[1].rotation * ends[0].rotation.inv()).as_rotvec() / (2 * step)
        np.testing.assert_allclose(jacobian[:, joint], [*moved, *turned], atol=1e-7)


def test_the_tool_moves_as_wanted_along_its_own_axes(kinematics: ArmKinematics) -> None:
    servo = CartesianServo(kinematics, Q, TOOL)
    before = servo.T_world_tool
    for _ in range(500):
        servo.step(np.array([0.002, 0, 0.004, 0, 0, 0]), 0.002)
    moved = before.inv() * servo.T_world_tool
    np.testing.assert_allclose(moved.translation, [0.002, 0, 0.004], atol=1e-4)
    assert moved.rotation.magnitude() < 2e-3


def test_the_servo_keeps_its_share_of_the_limits(kinematics: ArmKinematics) -> None:
    servo, limits = CartesianServo(kinematics, Q, TOOL, speed=0.3), kinematics.limits.scaled(0.3)
    commands = [servo.step(np.array([5.0, 0, 0, 0, 0, 0]), 0.002) for _ in range(50)]
    assert all((np.abs(qd) <= limits.velocity * (1 + 1e-9)).all() for _, qd, _ in commands)
    assert all((np.abs(qdd) <= limits.acceleration * (1 + 1e-9)).all() for *_, qdd in commands)


def test_the_wrist_feels_weight_until_tared_and_then_what_pushes(make_cell: Any) -> None:
    cell = make_cell()
    cell.arm.place(np.radians([-15.0, -2.0, -3.0, 0.0, 5.0, 75.0]))  # the tool looks straight down
    cell.wait(0.3)
    wrist = WristSensor(cell.model, cell.data, "arm/gripper/")
    weight = 9.81 * cell.model.body_subtreemass[cell.model.body("arm/gripper/gripper_base").id]
    np.testing.assert_allclose(wrist.wrench().force, [0, 0, weight], atol=0.1)
    wrist.tare()
    assert wrist.force_n() == 0
    cell.data.xfrc_applied[cell.model.body("arm/gripper/finger_left").id, 2] = 10.0
    cell.wait(0.5)
    np.testing.assert_allclose(wrist.wrench().force, [0, 0, -10], atol=0.05)
