"""How far boxes stay from other boxes and from points, for many poses at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from robot.gripper_geometry import Boxes

Array = NDArray[np.float64]


def points_clearance(
    tool: Boxes, rotations: Array, translations: Array, points: Array, up_to_m: float = np.inf
) -> Array:
    """Signed distance of the nearest point to the tool, per pose.

    Args:
        tool: the tool's boxes in its own frame.
        rotations: (K, 3, 3) of the tool's poses.
        translations: (K, 3) in m.
        points: (N, 3) obstacles in the poses' reference frame.
        up_to_m: larger distances do not matter and are cut to this; saves most of the time.

    Returns:
        (K,) distances in m, negative inside the tool; ``up_to_m`` without points.
    """
    nearest = np.full(len(rotations), up_to_m)
    if not len(points):
        return nearest
    in_tool = (points[None] - translations[:, None]) @ rotations
    low, high = _bounds(tool)
    x, y, z = np.moveaxis((in_tool > low - up_to_m) & (in_tool < high + up_to_m), -1, 0)
    near = x & y & z  # numpy reduces short axes slowly
    pose_of, candidates = np.nonzero(near)[0], in_tool[near]
    for centre, rotation, half in zip(tool.centres, tool.rotations, tool.half_sizes, strict=True):
        outside = np.abs((candidates - centre) @ rotation) - half
        beyond = np.maximum(outside, 0.0)
        deepest = np.maximum(np.maximum(outside[:, 0], outside[:, 1]), outside[:, 2])
        distance = np.sqrt(np.einsum("nk,nk->n", beyond, beyond)) + np.minimum(deepest, 0.0)
        np.minimum.at(nearest, pose_of, distance)
    return nearest


def swept_back(tool: Boxes, distance_m: float) -> Boxes:
    """Axis-parallel boxes that contain the tool all the way while it retreats along its -z axis."""
    extents = np.einsum("nij,nj->ni", np.abs(tool.rotations), tool.half_sizes)
    back = np.array([0.0, 0.0, distance_m / 2])
    return Boxes(tool.centres - back, np.broadcast_to(np.eye(3), tool.rotations.shape), extents + back)


def _bounds(tool: Boxes) -> tuple[Array, Array]:
    extents = np.einsum("nij,nj->ni", np.abs(tool.rotations), tool.half_sizes)
    return (tool.centres - extents).min(axis=0), (tool.centres + extents).max(axis=0)


def boxes_clearance(tool: Boxes, rotations: Array, translations: Array, obstacles: Boxes) -> Array:
    """A lower bound of the distance between the tool and box obstacles, per pose (separating axis theorem).

    Args:
        tool: the tool's boxes in its own frame.
        rotations: (K, 3, 3) of the tool's poses.
        translations: (K, 3) in m.
        obstacles: boxes in the poses' reference frame.

    Returns:
        (K,) in m: exact where face meets face, too small (never too large) elsewhere; negative for overlap; inf
        without obstacles.
    """
    nearest = np.full(len(rotations), np.inf)
    for centre, rotation, half in zip(tool.centres, tool.rotations, tool.half_sizes, strict=True):
        centres = rotations @ centre + translations
        axes = rotations @ rotation
        for other_centre, other_axes, other_half in zip(
            obstacles.centres, obstacles.rotations, obstacles.half_sizes, strict=True
        ):
            gaps = _separation(centres, axes, half, other_centre, other_axes, other_half)
            nearest = np.minimum(nearest, gaps)
    return nearest


def _separation(
    centres: Array, axes: Array, half: Array, other_centre: Array, other_axes: Array, other_half: Array
) -> Array:
    """(K,) largest gap over the 15 separating axes of boxes against one box."""
    others = np.broadcast_to(other_axes, axes.shape)
    crossed = np.cross(axes[:, :, :, None], others[:, :, None, :], axisa=1, axisb=1, axisc=1).reshape(len(axes), 3, 9)
    length = np.linalg.norm(crossed, axis=1, keepdims=True)
    usable = length > 1e-6
    crossed = np.where(usable, crossed / np.where(usable, length, 1.0), others[:, :, :1])
    candidates = np.concatenate([axes, others, crossed], axis=2)
    apart = np.abs(np.einsum("kia,ki->ka", candidates, other_centre - centres))
    reach = np.einsum("kab,b->ka", np.abs(np.einsum("kia,kib->kab", candidates, axes)), half)
    other_reach = np.einsum("kab,b->ka", np.abs(np.einsum("kia,ib->kab", candidates, other_axes)), other_half)
    return (apart - reach - other_reach).max(axis=1)
