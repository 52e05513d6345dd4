"""The handle on the MJCF arm inside a running simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

SCENES = Path(__file__).resolve().parents[1] / "assets" / "scenes"
PUMA_761 = SCENES / "puma761.xml"
JOINT_NAMES = tuple(f"joint{i}" for i in range(1, 7))


@dataclass(frozen=True, eq=False)
@frozen_arrays
class JointLimits:
    """What the six joints may do.

    Attributes:
        lower: (6,) smallest joint angles in rad.
        upper: (6,) largest joint angles in rad.
        velocity: (6,) largest speeds in rad/s.
        acceleration: (6,) largest accelerations in rad/s².
        jerk: (6,) largest jerks in rad/s³.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jerk: Array

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "acceleration", "jerk"):
            values = np.array(getattr(self, name), dtype=float)
            if values.shape != (6,) or not np.isfinite(values).all():
                raise InputError(f"{name} limits of the joints", got=values.tolist(), expected="6 finite numbers")
            object.__setattr__(self, name, values)
        if (self.lower >= self.upper).any() or min(
            self.velocity.min(), self.acceleration.min(), self.jerk.min()
        ) <= 0:
            raise InputError("joint limits", got=self, expected="lower < upper and rates > 0")

    @classmethod
    def from_model(cls, model: Any, prefix: str = "") -> JointLimits:
        """Read from the joint ranges and the custom numerics ``joint_velocity`` etc. of an arm's MJCF.

        Args:
            model: ``mujoco.MjModel`` that holds the arm.
            prefix: what the composition put before the arm's names, for example ``"puma761/"``.

        Raises:
            InputError: when the model does not hold them.
        """
        joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, prefix + name) for name in JOINT_NAMES]
        rates = []
        for name in ("joint_velocity", "joint_acceleration", "joint_jerk"):
            numeric = find(model, mujoco.mjtObj.mjOBJ_NUMERIC, prefix + name)
            start = model.numeric_adr[numeric]
            rates.append(model.numeric_data[start : start + model.numeric_size[numeric]])
        lower, upper = model.jnt_range[joints].T
        return cls(lower, upper, *rates)

    def scaled(self, speed: float) -> JointLimits:
        """The same limits with the time axis stretched by 1 / speed (0 < speed <= 1)."""
        if not 0 < speed <= 1:
            raise InputError("speed", got=speed, expected="a fraction of full speed in (0, 1]")
        return JointLimits(
            self.lower, self.upper, self.velocity * speed, self.acceleration * speed**2, self.jerk * speed**3
        )

    @property
    def range_deg(self) -> str:
        """The position limits for people, in degrees."""
        return f"{np.degrees(self.lower).round(1).tolist()} ... {np.degrees(self.upper).round(1).tolist()}"

    def contain(self, q: ArrayLike, tolerance_rad: float = 1e-6) -> bool:
        """Whether the joint angles (..., 6) all lie within the position limits."""
        q = np.asarray(q, dtype=float)
        return bool(((q >= self.lower - tolerance_rad) & (q <= self.upper + tolerance_rad)).all())


class Arm:
    """Six joints and their position actuators in a composed model.

    The object holds addresses only: the state lives in ``data``.
    """

    def __init__(self, model: Any, data: Any, prefix: str = "") -> None:
        """Find the arm.

        Args:
            model: ``mujoco.MjModel``.
            data: its ``mujoco.MjData``.
            prefix: what the composition put before the arm's names, for example ``"puma761/"``.

        Raises:
            InputError: when the model has no such arm.
        """
        self._model, self._data = model, data
        joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, prefix + name) for name in JOINT_NAMES]
        self._actuators = [find(model, mujoco.mjtObj.mjOBJ_ACTUATOR, prefix + name) for name in JOINT_NAMES]
        self._flange = find(model, mujoco.mjtObj.mjOBJ_SITE, prefix + "flange")
        self._qpos, self._dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self._stiffness = model.actuator_gainprm[self._actuators, 0]
        self._lead = -model.actuator_biasprm[self._actuators, 2] / self._stiffness
        self.limits = JointLimits.from_model(model, prefix)

    @property
    def joint_positions(self) -> Array:
        """(6,) joint angles in rad, a copy."""
        return np.array(self._data.qpos[self._qpos])

    @property
    def joint_velocities(self) -> Array:
        """(6,) joint speeds in rad/s, a copy."""
        return np.array(self._data.qvel[self._dof])

    @property
    def T_world_flange(self) -> RigidTransform:  # noqa: N802
        """Where the flange truly is (of the last forward pass): the simulator's truth, not for localizers."""
        rotation = Rotation.from_matrix(self._data.site_xmat[self._flange].reshape(3, 3))
        return RigidTransform.from_components(self._data.site_xpos[self._flange], rotation)

    @property
    def commanded_positions(self) -> Array:
        """(6,) joint angles in rad that were last commanded at rest, a copy; a load sags below them."""
        return np.array(self._data.ctrl[self._actuators])

    def command(self, q: ArrayLike, qd: ArrayLike | None = None, qdd: ArrayLike | None = None) -> None:
        """Set the actuators' targets.

        Args:
            q: (6,) joint angles in rad.
            qd: (6,) the reference's speed in rad/s; with it the arm follows a moving reference without the lag
                that the actuators' damping causes.
            qdd: (6,) the reference's acceleration in rad/s²; with it without the lag that the inertia of the arm
                and its tool causes. What the gripper holds is not known and is left to the actuators.

        Raises:
            InputError: when the angles are not six, not finite, or outside the joints' limits.
        """
        q = joint_vector(q)
        if not self.limits.contain(q, tolerance_rad=1e-3):
            raise InputError(
                "commanded joint angles (deg)",
                got=np.degrees(q).round(2).tolist(),
                expected=f"within {self.limits.range_deg}",
            )
        ahead = np.zeros(6) if qd is None else self._lead * joint_vector(qd)
        if qdd is not None:
            ahead = ahead + self._inertial_torque(joint_vector(qdd)) / self._stiffness
        self._data.ctrl[self._actuators] = q + ahead

    def _inertial_torque(self, qdd: Array) -> Array:
        """(6,) torques in Nm that accelerate the arm, at the joint angles of the last step."""
        acceleration, torque = np.zeros(self._model.nv), np.zeros(self._model.nv)
        acceleration[self._dof] = qdd
        mujoco.mj_mulM(self._model, self._data, torque, acceleration)
        return np.asarray(torque[self._dof])

    def place(self, q: ArrayLike) -> None:
        """Put the joints at q (6,) in rad, at rest and commanded there: for setting up a scene, not for moving."""
        self.command(q)
        self._data.qpos[self._qpos] = joint_vector(q)
        self._data.qvel[self._dof] = 0.0


def joint_vector(q: ArrayLike) -> Array:
    """Six finite joint values as an array.

    Raises:
        InputError: when they are not.
    """
    vector = np.asarray(q, dtype=float)
    if vector.shape != (6,) or not np.isfinite(vector).all():
        raise InputError("joint values", got=vector.tolist(), expected="6 finite numbers")
    return vector


def find(model: Any, kind: Any, name: str) -> int:
    """The id of a named object.

    Raises:
        InputError: when the model has none of that name.
    """
    index = int(mujoco.mj_name2id(model, kind, name))
    if index < 0:
        what = kind.name.removeprefix("mjOBJ_").lower()
        raise InputError(
            f"MuJoCo model's {what}", got=f"no {name!r}", expected="an object of that name", do="Check the prefix."
        )
    return index
