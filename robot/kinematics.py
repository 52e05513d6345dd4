"""Forward and inverse kinematics of the arm, from its MJCF alone."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mink
import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import PUMA_761, JointLimits, find, joint_vector
from robot.closed_form import SphericalWristArm
from robot.errors import UnreachableError
from vision.errors import InputError
from vision.frozen import read_only

Array = NDArray[np.float64]

POSITION_TOLERANCE_M = 2e-5
ROTATION_TOLERANCE_RAD = np.radians(0.005)
# Newton-like steps converge quadratically: going on to this norm costs one step more than the tolerance would.
_CONVERGED = 1e-8
_STEPS = 40
# A solution this near its seed on every joint needs no comparison with the other branches.
_NEAR_RAD = np.radians(75)
HOME_Q = read_only(np.radians([0.0, -45.0, 15.0, 0.0, 30.0, 0.0]))


class ArmKinematics:
    """Poses of the flange from joint angles and back.

    Owns its ``MjData``: a call never touches a running simulation, and equal arguments give equal results.
    """

    def __init__(self, model_or_path: Any = PUMA_761) -> None:
        """Take the arm.

        Args:
            model_or_path: the MJCF file of an arm alone (joints ``joint1`` ... ``joint6``, site ``flange``), or
                its ``mujoco.MjModel``.

        Raises:
            InputError: when it is not an arm alone.
        """
        self._model = _load(model_or_path)
        if self._model.nq != 6:
            raise InputError(
                "arm model",
                got=f"{self._model.nq} coordinates",
                expected="the six joints of an arm alone",
                do="Give the arm's own MJCF, not the composed cell.",
            )
        find(self._model, mujoco.mjtObj.mjOBJ_SITE, "flange")
        self.limits = JointLimits.from_model(self._model)
        self._configuration = mink.Configuration(self._model)
        self._task = mink.FrameTask("flange", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-6)
        self._closed_form = SphericalWristArm.of(self._model)
        self._bounds = [mink.ConfigurationLimit(self._model)]

    def forward(self, q: ArrayLike) -> RigidTransform:
        """T_world_flange at the joint angles q (6,) in rad.

        Raises:
            InputError: when q is not six finite numbers.
        """
        self._configuration.update(joint_vector(q))
        frame = self._configuration.get_transform_frame_to_world("flange", "site")
        return RigidTransform.from_components(frame.translation(), Rotation.from_matrix(frame.rotation().as_matrix()))

    def jacobian(self, q: ArrayLike, T_flange_tool: RigidTransform) -> Array:
        """(6, 6) from joint speeds to the velocity and angular velocity of a tool's origin in the world.

        Args:
            q: (6,) joint angles in rad.
            T_flange_tool: the tool on the flange.

        Raises:
            InputError: when q is not six finite numbers.
        """
        point = (self.forward(q) * T_flange_tool).translation
        linear, angular = np.zeros((3, 6)), np.zeros((3, 6))
        body = int(self._model.site_bodyid[find(self._model, mujoco.mjtObj.mjOBJ_SITE, "flange")])
        mujoco.mj_jac(self._model, self._configuration.data, linear, angular, point, body)
        return np.vstack([linear, angular])

    def inverse(self, T_world_flange: RigidTransform, seed_q: ArrayLike = HOME_Q) -> Array:
        """Joint angles that take the flange to a pose, near a seed.

        Args:
            T_world_flange: the wanted pose; met within 0.02 mm and 0.005 degrees.
            seed_q: (6,) where the arm is, in rad.

        Returns:
            (6,) joint angles in rad within the limits: of the solutions found from the seed and over the arm's elbow
            and wrist branches, the one nearest to the seed.

        Raises:
            InputError: when the pose or the seed is not finite.
            UnreachableError: when no solution is found.
        """
        found = self.solutions(T_world_flange, seed_q, first_if_near=True)
        if found:
            return found[0]
        position_m, angle_rad = self._closest_miss
        missed = f", missed by {position_m * 1e3:.2f} mm and {np.degrees(angle_rad):.2f} deg"
        raise UnreachableError(
            "flange pose",
            got=f"{T_world_flange.translation.round(3).tolist()} m{missed if np.isfinite(position_m) else ''}",
            expected="a pose within the reach and the joint limits of the arm",
            do="Move the target nearer to the arm, or turn it about the approach axis.",
        )

    def solutions(
        self, T_world_flange: RigidTransform, seed_q: ArrayLike = HOME_Q, *, first_if_near: bool = False
    ) -> list[Array]:
        """All distinct solutions found, nearest to the seed first; empty where the pose is out of reach.

        In closed form for arms like the PUMA, by descent from many starts for others.

        Args:
            T_world_flange: the wanted pose.
            seed_q: (6,) the angles to start from and to measure nearness by, in rad.
            first_if_near: return the seed's own solution alone when it lies within 75 degrees on every joint.

        Raises:
            InputError: when the pose or the seed is not finite.
        """
        seed = joint_vector(seed_q)
        if not np.isfinite(T_world_flange.as_matrix()).all():
            raise InputError("flange pose", got=T_world_flange.translation.tolist(), expected="finite numbers")
        self._closest_miss = (np.inf, np.inf)
        if self._closed_form is not None:
            exact = [self._unwind(q, seed) for q in self._closed_form.solutions(T_world_flange, seed)]
            return sorted((q for q in exact if self.limits.contain(q)), key=lambda q: float(np.linalg.norm(q - seed)))
        self._task.set_target(mink.SE3.from_matrix(T_world_flange.as_matrix()))
        found: list[Array] = []
        for start in self._starts(T_world_flange, seed):
            q = self._descend(start)
            if q is None:
                continue
            q = self._unwind(q, seed)
            if first_if_near and np.abs(q - seed).max() < _NEAR_RAD:
                return [q]
            if all(np.abs(q - other).max() > 1e-3 for other in found):
                found.append(q)
        return sorted(found, key=lambda q: float(np.linalg.norm(q - seed)))

    def _descend(self, start: Array) -> Array | None:
        """Gauss-Newton steps under the joint limits (mink's QP) from a start; None when they end elsewhere."""
        configuration = self._configuration
        configuration.update(np.clip(start, self.limits.lower, self.limits.upper))
        best = np.inf
        for step in range(_STEPS):
            error = self._task.compute_error(configuration)
            norm = float(np.linalg.norm(error))
            if norm < _CONVERGED:
                break
            if step % 10 == 9:
                if norm > 0.7 * best:
                    break
                best = norm
            velocity = mink.solve_ik(configuration, [self._task], 1.0, "daqp", damping=1e-9, limits=self._bounds)
            configuration.integrate_inplace(velocity, 1.0)
        error = self._task.compute_error(configuration)
        miss = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        self._closest_miss = min(self._closest_miss, miss, key=sum)
        if miss[0] > POSITION_TOLERANCE_M or miss[1] > ROTATION_TOLERANCE_RAD:
            return None
        return np.array(configuration.q)

    def _starts(self, T_world_flange: RigidTransform, seed: Array) -> Iterator[Array]:
        """The seed, then both shoulders, elbows and wrists roughly turned towards the target."""
        yield seed
        x, y, _ = T_world_flange.translation
        bearing = np.arctan2(y, x)
        for elbow in (-50.0, -130.0):
            for upper_arm in (-60.0, -120.0):
                for shoulder in (bearing, bearing + np.pi if bearing < 0 else bearing - np.pi):
                    for wrist_roll, bend in ((0.0, 50.0), (0.0, -50.0), (180.0, 50.0), (90.0, 50.0), (-90.0, 50.0)):
                        angles = np.radians([0.0, upper_arm, elbow, wrist_roll, bend, 0.0])
                        angles[0] = shoulder
                        yield angles

    def _unwind(self, q: Array, seed: Array) -> Array:
        """Add whole turns to bring each joint within its limits, as near to the seed as it can be."""
        turns = np.round((seed - q) / (2 * np.pi))[:, None] + np.array([0.0, -1.0, 1.0])
        turned = q[:, None] + 2 * np.pi * turns
        within = (turned >= self.limits.lower[:, None]) & (turned <= self.limits.upper[:, None])
        away = np.where(within, np.abs(turned - seed[:, None]), np.inf)
        best = turned[np.arange(6), np.argmin(away, axis=1)]
        return np.where(within.any(axis=1), best, q)


def _load(model_or_path: Any) -> Any:
    if not isinstance(model_or_path, (str, Path)):
        return model_or_path
    if not Path(model_or_path).is_file():
        raise InputError("arm MJCF", got=f"{str(model_or_path)!r}", expected="an existing file")
    return mujoco.MjModel.from_xml_path(str(model_or_path))
