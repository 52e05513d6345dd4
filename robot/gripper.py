"""The handle on the MJCF parallel gripper inside a running simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from robot.arm import find
from vision.errors import InputError

_FINGERS = ("finger_left", "finger_right")
# A finger that moves slower than this has arrived, be it at its target or at a piece.
_AT_REST_M_S = 2e-3
# Nearer than this to an end stop, the fingers rest on the stop and not on a piece.
_END_STOP_M = 3e-4


@dataclass(frozen=True)
class FingerContacts:
    """How hard each finger presses on something.

    Attributes:
        left_n: sum of the normal forces on the left finger in N.
        right_n: the same on the right finger.
    """

    left_n: float
    right_n: float


class Gripper:
    """Two mirrored fingers driven by one force-limited position actuator.

    The control value is the gap between the fingers' inner faces. Commands return at once: step the simulation until
    `at_rest`. The force limit is set in the model, so that model must not be shared between running simulations.
    """

    def __init__(self, model: Any, data: Any, prefix: str = "") -> None:
        """Find the gripper.

        Args:
            model: ``mujoco.MjModel``.
            data: its ``mujoco.MjData``.
            prefix: what the composition put before the gripper's names, for example ``"arm/gripper/"``.

        Raises:
            InputError: when the model has no such gripper.
        """
        self._model, self._data = model, data
        self._actuator = find(model, mujoco.mjtObj.mjOBJ_ACTUATOR, prefix + "gripper")
        self._tendon = find(model, mujoco.mjtObj.mjOBJ_TENDON, prefix + "gap")
        bodies = [find(model, mujoco.mjtObj.mjOBJ_BODY, prefix + name) for name in _FINGERS]
        joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, prefix + name) for name in _FINGERS]
        self._finger_of_geom = {
            int(geom): finger
            for finger, body in enumerate(bodies)
            for geom in np.flatnonzero(model.geom_bodyid == body)
        }
        self.max_width_m = float(model.jnt_range[joints, 1].sum())
        self.max_force_n = float(model.actuator_forcerange[self._actuator, 1])
        self._shut, self._wide = (float(bound) for bound in model.actuator_ctrlrange[self._actuator])

    @property
    def width_m(self) -> float:
        """The measured gap between the fingers' inner faces in m."""
        return float(self._data.ten_length[self._tendon])

    @property
    def force_n(self) -> float:
        """The force of the drive on each finger in N, positive when it opens."""
        return float(self._data.actuator_force[self._actuator])

    @property
    def at_rest(self) -> bool:
        """Whether the fingers stand still."""
        return abs(float(self._data.ten_velocity[self._tendon])) < _AT_REST_M_S

    def open_to(self, width_m: float) -> None:
        """Move the fingers to a gap, with the full force.

        Raises:
            InputError: when the gap is outside the stroke.
        """
        if not 0 <= width_m <= self.max_width_m:
            raise InputError("gripper gap (m)", got=width_m, expected=f"0 ... {self.max_width_m}")
        self._drive(width_m, self.max_force_n)

    def close_with(self, force_n: float) -> None:
        """Close until something (or the other finger) resists with this force per finger: an outside grip.

        Raises:
            InputError: when the force is not positive or above the gripper's.
        """
        self._drive(self._shut, force_n)

    def expand_with(self, force_n: float) -> None:
        """Open until something (or the end stop) resists with this force per finger: an inside grip.

        Raises:
            InputError: when the force is not positive or above the gripper's.
        """
        self._drive(self._wide, force_n)

    def finger_contacts(self, body: str | None = None) -> FingerContacts:
        """The contact forces on the fingers.

        Args:
            body: count only contacts with this body; all contacts when None.

        Raises:
            InputError: when the model has no such body.
        """
        wanted = None if body is None else find(self._model, mujoco.mjtObj.mjOBJ_BODY, body)
        pressed = [0.0, 0.0]
        wrench = np.zeros(6)
        for index in range(self._data.ncon):
            geoms = self._data.contact[index].geom
            for geom, other in (geoms, geoms[::-1]):
                finger = self._finger_of_geom.get(int(geom))
                if finger is None or (wanted is not None and self._model.geom_bodyid[other] != wanted):
                    continue
                mujoco.mj_contactForce(self._model, self._data, index, wrench)
                pressed[finger] += float(wrench[0])
        return FingerContacts(*pressed)

    def holding(self, body: str | None = None, min_force_n: float = 1.0) -> bool:
        """Whether both fingers grip something: contact on both, and the gap not at an end stop.

        Args:
            body: the body that has to be gripped; anything when None.
            min_force_n: what each finger must press with.

        Raises:
            InputError: when the model has no such body.
        """
        contacts = self.finger_contacts(body)
        at_end_stop = not _END_STOP_M < self.width_m < self.max_width_m - _END_STOP_M
        return not at_end_stop and min(contacts.left_n, contacts.right_n) >= min_force_n

    def _drive(self, target_m: float, force_n: float) -> None:
        if not 0 < force_n <= self.max_force_n:
            raise InputError("grip force (N)", got=force_n, expected=f"above 0, at most {self.max_force_n}")
        self._model.actuator_forcerange[self._actuator] = (-force_n, force_n)
        self._data.ctrl[self._actuator] = target_m
