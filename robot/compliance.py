"""Giving way to forces: admittance, and the spiral that looks for a bore."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robot.wrist import Wrench

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Admittance:
    """Velocities that forces bring about: the tool moves as if it were drawn through something viscous.

    Attributes:
        side_ns_m: force per velocity across the tool's axis.
        axial_ns_m: the same along it.
        tilt_nms: torque per angular velocity.
        most_m_s: largest velocity.
        most_rad_s: largest angular velocity.
    """

    side_ns_m: float = 2.0e4
    axial_ns_m: float = 1.0e4
    tilt_nms: float = 300.0
    most_m_s: float = 0.01
    most_rad_s: float = 0.05

    def twist(self, felt: Wrench, press_n: float) -> Array:
        """(6,) velocity of the tool in its own frame, pressing along its axis.

        Args:
            felt: at the tool's tip, in the tool's frame.
            press_n: wanted force on the surroundings along the axis.
        """
        force = felt.force + np.array([0.0, 0.0, press_n])
        velocity = force / [self.side_ns_m, self.side_ns_m, self.axial_ns_m]
        turning = felt.torque / self.tilt_nms * [1.0, 1.0, 0.0]
        return np.concatenate(
            [np.clip(velocity, -self.most_m_s, self.most_m_s), np.clip(turning, -self.most_rad_s, self.most_rad_s)]
        )


@dataclass(frozen=True)
class Spiral:
    """Archimedes' spiral, run through at an even speed.

    Attributes:
        pitch_m: between two turns.
        speed_m_s: along it.
        most_m: radius at which it ends.
    """

    pitch_m: float
    speed_m_s: float = 0.003
    most_m: float = 0.0015

    def velocity(self, seconds: float) -> Array | None:
        """(2,) velocity in m/s after a time; None when the end is reached."""
        growth = self.pitch_m / (2 * np.pi)
        turn = np.sqrt(2 * self.speed_m_s * max(seconds, 0.0) / growth) + 1e-6
        if growth * turn > self.most_m:
            return None
        direction = np.array([np.cos(turn) - turn * np.sin(turn), np.sin(turn) + turn * np.cos(turn)])
        return np.asarray(self.speed_m_s * direction / np.linalg.norm(direction))


def at_tip(felt: Wrench, tip_m: float) -> Wrench:
    """A wrench at the wrist as it is at a point so far out along the tool's axis."""
    arm = np.array([0.0, 0.0, tip_m])
    return Wrench(felt.force, felt.torque - np.cross(arm, felt.force))
