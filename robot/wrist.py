"""The force and torque that the arm feels at its wrist."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from robot.arm import find
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

_SENSORS = ("wrist_force", "wrist_torque")


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Wrench:
    """Force and torque that the surroundings exert on the tool, in the frame of the wrist and about its origin.

    Attributes:
        force: (3,) in N.
        torque: (3,) in Nm.
    """

    force: Array
    torque: Array

    @property
    def force_n(self) -> float:
        """Length of the force."""
        return float(np.linalg.norm(self.force))


class WristSensor:
    """The six-axis sensor between the flange and the tool.

    It feels the weight of tool and load, too: `tare` takes what it feels now, at this orientation, for nothing.
    """

    def __init__(self, model: Any, data: Any, prefix: str = "") -> None:
        """Find the sensor.

        Args:
            model: ``mujoco.MjModel``.
            data: its ``mujoco.MjData``.
            prefix: what the composition put before the gripper's names, for example ``"arm/gripper/"``.

        Raises:
            InputError: when the model has no such sensor.
        """
        self._data = data
        sensors = [find(model, mujoco.mjtObj.mjOBJ_SENSOR, prefix + name) for name in _SENSORS]
        self._slices = [slice(int(model.sensor_adr[s]), int(model.sensor_adr[s]) + 3) for s in sensors]
        self._bias = np.zeros(6)

    def tare(self) -> None:
        """Take what is felt now for nothing."""
        self._bias = self._raw()

    def wrench(self) -> Wrench:
        """What is felt beyond the last tare."""
        felt = self._raw() - self._bias
        return Wrench(felt[:3], felt[3:])

    def force_n(self) -> float:
        """Length of the force beyond the last tare, in N."""
        force = self._data.sensordata[self._slices[0]] + self._bias[:3]
        return float(np.sqrt(force @ force))

    def _raw(self) -> Array:
        # MuJoCo tells what the tool exerts on the wrist; its surroundings exert it on the tool.
        return -np.concatenate([self._data.sensordata[part] for part in self._slices])
