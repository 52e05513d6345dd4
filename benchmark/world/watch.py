"""Watches every physics step: whether the arm keeps its limits, how deep and how hard the robot presses on things."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmark.world.cell import ARM_PREFIX, WorkCell

Array = NDArray[np.float64]

_AFTER_CONTACT_STEPS = 25  # the arm rings on for so long after something touched it


@dataclass(frozen=True)
class Watched:
    """The worst of all steps so far.

    Attributes:
        speed: measured joint speed over its limit, worst joint, while the robot touches nothing.
        acceleration: the same of the acceleration.
        jerk: the same of the jerk.
        loaded_speed: measured joint speed over its limit while the robot touches or holds something.
        loaded_acceleration: the same of the acceleration.
        penetration_m: deepest contact of the robot with anything.
        forces_n: by body that the robot touched, the largest sum of their normal forces in N.
    """

    speed: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    loaded_speed: float = 0.0
    loaded_acceleration: float = 0.0
    penetration_m: float = 0.0
    forces_n: Mapping[str, float] = field(default_factory=dict)


class StepWatch:
    """Call it after every physics step, then read `worst`."""

    def __init__(self, cell: WorkCell) -> None:
        """Watch a cell from now on."""
        self._model, self._data, self._arm = cell.model, cell.data, cell.arm
        names = [cell.model.body(int(body)).name for body in cell.model.geom_bodyid]
        self._body_of_geom = np.array(names)
        self._robot = np.array([name.startswith(ARM_PREFIX) for name in names])
        self._dt = float(cell.model.opt.timestep)
        self.restart()

    def restart(self) -> None:
        """Forget what was seen."""
        self._rates: list[Array] = []
        self._quiet_steps = _AFTER_CONTACT_STEPS
        self._free, self._loaded = np.zeros(3), np.zeros(3)
        self._depth = 0.0
        self._forces: dict[str, float] = {}

    @property
    def worst(self) -> Watched:
        """The worst of all steps since the beginning."""
        speed, acceleration, jerk = (float(share) for share in self._free)
        loaded_speed, loaded_acceleration = (float(share) for share in self._loaded[:2])
        return Watched(
            speed,
            acceleration,
            jerk,
            loaded_speed,
            loaded_acceleration,
            self._depth,
            dict(self._forces),
        )

    def __call__(self) -> None:
        """Look at the step that was just made."""
        touching = self._contacts()
        self._quiet_steps = 0 if touching else self._quiet_steps + 1
        self._rates = [*self._rates[-2:], self._arm.joint_velocities]
        if len(self._rates) < 3:
            return
        limits, (first, second, third) = self._arm.limits, self._rates
        acceleration = (third - second) / self._dt
        jerk = (acceleration - (second - first) / self._dt) / self._dt
        shares = [
            float((np.abs(value) / limit).max())
            for value, limit in (
                (third, limits.velocity),
                (acceleration, limits.acceleration),
                (jerk, limits.jerk),
            )
        ]
        worst = self._free if self._quiet_steps > _AFTER_CONTACT_STEPS else self._loaded
        np.maximum(worst, shares, out=worst)

    def _contacts(self) -> bool:
        """Take note of the robot's contacts; returns whether there are any."""
        if not self._data.ncon:
            return False
        geoms = self._data.contact.geom
        ours = self._robot[geoms].any(axis=1) & ~self._robot[geoms].all(axis=1)
        if not ours.any():
            return False
        self._depth = max(self._depth, -float(self._data.contact.dist[ours].min()))
        forces: dict[str, float] = {}
        wrench = np.zeros(6)
        for index in np.flatnonzero(ours):
            mujoco.mj_contactForce(self._model, self._data, int(index), wrench)
            one, other = geoms[index]
            body = str(self._body_of_geom[other if self._robot[one] else one])
            forces[body] = forces.get(body, 0.0) + float(wrench[0])
        for body, force in forces.items():
            self._forces[body] = max(self._forces.get(body, 0.0), force)
        return True
