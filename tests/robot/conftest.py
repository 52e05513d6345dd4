"""Small scenes and shared objects for the robot's tests, composed without the benchmark."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import PUMA_761, Arm
from robot.gripper import Gripper
from robot.gripper_geometry import PARALLEL_GRIPPER, GripperGeometry
from robot.kinematics import ArmKinematics
from robot.trajectory import Trajectory


@dataclass
class Cell:
    """A running scene: the floor, the arm at the origin, the gripper on its flange, extra bodies."""

    bodies: str = ""

    def __post_init__(self) -> None:
        world = mujoco.MjSpec.from_string(f"""
          <mujoco>
            <option integrator="implicitfast" timestep="0.002" cone="elliptic" impratio="10" noslip_iterations="3"/>
            <worldbody><geom name="floor" type="plane" size="3 3 0.1"/>{self.bodies}</worldbody>
          </mujoco>""")
        arm, gripper = (mujoco.MjSpec.from_file(str(path)) for path in (PUMA_761, PARALLEL_GRIPPER))
        arm.attach(gripper, prefix="gripper/", site=arm.site("flange"))
        world.attach(arm, prefix="arm/", frame=world.worldbody.add_frame())
        self.model = world.compile()
        self.data = mujoco.MjData(self.model)
        self.arm = Arm(self.model, self.data, "arm/")
        self.gripper = Gripper(self.model, self.data, "arm/gripper/")

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / self.model.opt.timestep)):
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)

    def run(self, trajectory: Trajectory) -> None:
        for command in trajectory.commands():
            self.arm.command(*command)
            self.wait(trajectory.dt_s)

    def site(self, name: str) -> RigidTransform:
        site = self.data.site(name)
        return RigidTransform.from_components(site.xpos, Rotation.from_matrix(site.xmat.reshape(3, 3)))

    def body(self, name: str) -> RigidTransform:
        body = self.data.body(name)
        return RigidTransform.from_components(body.xpos, Rotation.from_matrix(body.xmat.reshape(3, 3)))


@pytest.fixture(scope="session")
def make_cell() -> type[Cell]:
    return Cell


@pytest.fixture(scope="session")
def kinematics() -> ArmKinematics:
    return ArmKinematics()


@pytest.fixture(scope="session")
def geometry() -> GripperGeometry:
    return GripperGeometry.from_mjcf()
