"""From velocities of a tool to commands of the joints, step by step."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform

from robot.arm import joint_vector
from robot.kinematics import ArmKinematics

Array = NDArray[np.float64]

_DAMPING = 1e-4


class CartesianServo:
    """Moves the commanded joint angles so that a tool moves with a wanted velocity."""

    def __init__(
        self, kinematics: ArmKinematics, q: ArrayLike, T_flange_tool: RigidTransform, speed: float = 0.3
    ) -> None:
        """Begin.

        Args:
            kinematics: the arm.
            q: (6,) where it is commanded to be now, in rad.
            T_flange_tool: the tool on the flange.
            speed: of the joints' limits.
        """
        self._kinematics, self._T_flange_tool = kinematics, T_flange_tool
        self._limits = kinematics.limits.scaled(speed)
        self._q, self._qd = joint_vector(q).copy(), np.zeros(6)

    @property
    def T_world_tool(self) -> RigidTransform:  # noqa: N802
        """Where the tool is commanded to be."""
        return self._kinematics.forward(self._q) * self._T_flange_tool

    def step(self, twist: Array, dt_s: float) -> tuple[Array, Array, Array]:
        """Angles, speeds and accelerations to command for the next time step.

        Args:
            twist: (6,) velocity in m/s and angular velocity in rad/s of the tool, in its own frame.
            dt_s: length of the step.
        """
        jacobian = self._kinematics.jacobian(self._q, self._T_flange_tool)
        rotation = self.T_world_tool.rotation.as_matrix()
        wanted = np.concatenate([rotation @ twist[:3], rotation @ twist[3:]])
        square = jacobian @ jacobian.T + _DAMPING**2 * np.eye(6)
        speeds = jacobian.T @ np.linalg.solve(square, wanted)
        speeds /= max(1.0, float((np.abs(speeds) / self._limits.velocity).max()))
        change = np.clip(speeds - self._qd, -self._limits.acceleration * dt_s, self._limits.acceleration * dt_s)
        q, acceleration = self._q, change / dt_s
        self._qd = self._qd + change
        self._q = np.clip(q + dt_s * self._qd, self._limits.lower, self._limits.upper)
        return q, self._qd, acceleration
