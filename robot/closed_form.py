"""Inverse kinematics in closed form, for arms like the PUMA: a shoulder, an elbow, and a wrist whose axes meet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from robot.arm import JOINT_NAMES, find

Array = NDArray[np.float64]

_AXES = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 1, 0], [0, 0, -1]], dtype=float)
_FLANGE = np.diag([1.0, -1.0, -1.0])  # at zero the flange looks down
_STRAIGHT = 1e-9  # sine of the wrist's bend below which only the sum of the outer two angles counts


@dataclass(frozen=True)
class SphericalWristArm:
    """The lengths of such an arm, in m; at zero the upper arm lies along x and the forearm hangs down.

    Attributes:
        height: of the shoulder.
        offset: of the upper arm beside the shoulder's axis, along y.
        upper_arm: from shoulder to elbow.
        forearm: from elbow to wrist.
        flange: from the wrist's centre to the flange.
    """

    height: float
    offset: float
    upper_arm: float
    forearm: float
    flange: float

    @classmethod
    def of(cls, model: Any) -> SphericalWristArm | None:
        """Read from a model of an arm alone; None where its joints are arranged in another way."""
        joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in JOINT_NAMES]
        bodies = model.jnt_bodyid[joints]
        site = find(model, mujoco.mjtObj.mjOBJ_SITE, "flange")
        turned = np.zeros(9)
        mujoco.mju_quat2Mat(turned, model.site_quat[site])
        steps = np.vstack([model.body_pos[bodies], model.site_pos[site]])
        lengths = np.array(
            [
                [0, 0, steps[0, 2]],
                [0, steps[1, 1], 0],
                [steps[2, 0], 0, 0],
                [0, 0, steps[3, 2]],
                [0, 0, 0],
                [0, 0, 0],
                [0, 0, steps[6, 2]],
            ]
        )
        alike = (
            np.allclose(steps, lengths)
            and np.allclose(model.jnt_axis[joints], _AXES)
            and np.allclose(model.jnt_pos[joints], 0)
            and np.allclose(model.body_quat[bodies], [1, 0, 0, 0])
            and np.allclose(turned.reshape(3, 3), _FLANGE)
            and min(steps[2, 0], -steps[3, 2], -steps[6, 2]) > 0
        )
        return (
            cls(*map(float, (steps[0, 2], steps[1, 1], steps[2, 0], -steps[3, 2], -steps[6, 2]))) if alike else None
        )

    def solutions(self, T_world_flange: RigidTransform, seed: Array) -> list[Array]:
        """All joint angles (6,) that take the flange there, whatever the joints' limits; at most eight.

        Args:
            T_world_flange: the wanted pose.
            seed: (6,) settles how a straight wrist shares its turn between its outer joints.
        """
        rotation = T_world_flange.rotation.as_matrix()
        wrist = T_world_flange.translation - self.flange * rotation[:, 2] - [0.0, 0.0, self.height]
        radial = float(np.hypot(*wrist[:2]))
        if radial < abs(self.offset):
            return []
        along = np.sqrt(radial**2 - self.offset**2)
        found = []
        for x in (along, -along):
            q1 = np.arctan2(wrist[1], wrist[0]) - np.arctan2(self.offset, x)
            for q2, q3 in self._elbows(x, float(wrist[2])):
                forearm = _turned(q1, q2 + q3)
                for angles in _wrists(forearm.T @ rotation @ _FLANGE.T, seed):
                    found.append(np.array([q1, q2, q3, *angles]))
        return found

    def _elbows(self, x: float, z: float) -> list[tuple[float, float]]:
        """Angles of the second and third joint, elbow up and down, for a wrist in the arm's plane."""
        a, d = self.upper_arm, self.forearm
        sine = (a**2 + d**2 - x**2 - z**2) / (2 * a * d)
        if abs(sine) > 1:
            return []
        both = []
        for q3 in (float(np.arcsin(sine)), float(np.pi - np.arcsin(sine))):
            q2 = np.arctan2(-z, x) - np.arctan2(d * np.cos(q3), a - d * sine)
            both.append((float(q2), q3))
        return both


def _turned(about_z: float, about_y: float) -> Array:
    """A turn about y, then about z."""
    (cz, sz), (cy, sy) = ((np.cos(angle), np.sin(angle)) for angle in (about_z, about_y))
    return np.array([[cz * cy, -sz, cz * sy], [sz * cy, cz, sz * sy], [-sy, 0.0, cy]])


def _wrists(turn: Array, seed: Array) -> list[tuple[float, float, float]]:
    """The two ways to share a turn among the wrist's joints."""
    sine = float(np.hypot(turn[0, 2], turn[1, 2]))
    if sine < _STRAIGHT:
        together = np.arctan2(turn[1, 0], turn[0, 0]) * np.sign(turn[2, 2])
        bend = 0.0 if turn[2, 2] > 0 else np.pi
        rest = -float(together) - float(seed[3]) if bend == 0.0 else float(together) + float(seed[3])
        return [(float(seed[3]), float(bend), rest)]
    return [
        (
            -float(np.arctan2(side * turn[1, 2], side * turn[0, 2])),
            float(np.arctan2(side * sine, turn[2, 2])),
            -float(np.arctan2(side * turn[2, 1], -side * turn[2, 0])),
        )
        for side in (1.0, -1.0)
    ]
