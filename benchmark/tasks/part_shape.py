"""What the robot knows of a part's shape: where its surface is, and how it may be held."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from trimesh import load_mesh
from trimesh.sample import sample_surface_even

from benchmark.models import load_model
from benchmark.world.parts import get_part, vertices
from robot.grasp_opening import opened_grasps
from robot.grasps import OpenedGrasp
from robot.gripper_geometry import GripperGeometry

Array = NDArray[np.float64]

SURFACE_SPACING_M = 0.004
FEWEST_SURFACE_POINTS = 2500


@cache
def surface_points(part: str) -> Array:
    """Points (N, 3) spread evenly over a part's surface, in its frame: what the gripper may not run into."""
    mesh = load_mesh(get_part(part).visual_mesh, process=False)
    count = max(FEWEST_SURFACE_POINTS, round(mesh.area / SURFACE_SPACING_M**2))
    points, _ = sample_surface_even(mesh, count, seed=0)
    return np.asarray(np.vstack([points, vertices(get_part(part))[::8]]))


@cache
def opened_grasps_of(
    part: str, gripper_xml: Path, approach_m: float, models: str | None = None
) -> tuple[OpenedGrasp, ...]:
    """The taught grasps of a part that the gripper can reach past the part itself; see `opened_grasps`."""
    taught = load_model(part, models).grasps
    return opened_grasps(GripperGeometry.from_mjcf(gripper_xml), taught, surface_points(part), approach_m)
