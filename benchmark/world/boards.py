"""The boards of the open boxes in a compiled cell, as the robot's planner takes them."""

from __future__ import annotations

import mujoco
import numpy as np

from robot.gripper_geometry import Boxes

SIDES = ("floor", "front", "back", "left", "right")


def boards(model: mujoco.MjModel, box: str) -> Boxes:
    """Floor and walls of the ``bin`` or the ``tray`` in the world frame; they stand still and axis-parallel."""
    geoms = [model.geom(f"{box}_{side}") for side in SIDES]
    centres = [model.body_pos[int(geom.bodyid[0])] + geom.pos for geom in geoms]
    return Boxes(np.array(centres), np.repeat(np.eye(3)[None], len(geoms), axis=0), np.array([g.size for g in geoms]))
