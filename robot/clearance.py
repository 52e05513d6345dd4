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


def boxes_clearance(
    tool: Boxes, rotations: Array, translations: Array, obstacles: Boxes, up_to_m: float = np.inf
) -> Array:
    """A lower bound of the distance between the tool and box obstacles, per pose (separating axis theorem).

    Args:
        tool: the tool's boxes in its own frame.
        rotations: (K, 3, 3) of the tool's poses.
        translations: (K, 3) in m.
        obstacles: boxes in the poses' reference frame.
        up_to_m: larger distances do not matter and are cut to this; saves most of the time.

    Returns:
        (K,) in m: exact where face meets face, too small (never too large) elsewhere; negative for overlap;
        ``up_to_m`` without obstacles.
    """
    nearest = np.full(len(rotations), up_to_m)
    if not len(obstacles) or not len(rotations):
        return nearest
    centres = translations[:, None] + np.einsum("kij,tj->kti", rotations, tool.centres)
    axes = np.einsum("kij,tjl->ktil", rotations, tool.rotations)
    # The obstacles' own axes tell most pairs apart already.
    seen = np.einsum("oji,ktjl->ktoil", obstacles.rotations, axes)
    apart = np.abs(np.einsum("oji,ktoj->ktoi", obstacles.rotations, centres[:, :, None] - obstacles.centres))
    reach = np.einsum("ktoil,tl->ktoi", np.abs(seen), tool.half_sizes) + obstacles.half_sizes
    gaps = (apart - reach).max(axis=-1)
    pose, box, obstacle = np.nonzero(gaps < up_to_m)
    others = obstacles.rotations[obstacle], obstacles.half_sizes[obstacle]
    between = obstacles.centres[obstacle] - centres[pose, box]
    exact = _separation(between, axes[pose, box], tool.half_sizes[box], *others)
    np.minimum.at(nearest, pose, exact)
    return nearest


def _separation(between: Array, axes: Array, half: Array, other_axes: Array, other_half: Array) -> Array:
    """(P,) largest gap over the 15 separating axes of pairs of boxes."""
    crossed = np.cross(axes[:, :, :, None], other_axes[:, :, None, :], axisa=1, axisb=1, axisc=1)
    crossed = crossed.reshape(len(axes), 3, 9)
    length = np.linalg.norm(crossed, axis=1, keepdims=True)
    usable = length > 1e-6
    crossed = np.where(usable, crossed / np.where(usable, length, 1.0), other_axes[:, :, :1])
    candidates = np.concatenate([axes, other_axes, crossed], axis=2)
    apart = np.abs(np.einsum("pia,pi->pa", candidates, between))
    reach = np.einsum("pab,pb->pa", np.abs(np.einsum("pia,pib->pab", candidates, axes)), half)
    other_reach = np.einsum("pab,pb->pa", np.abs(np.einsum("pia,pib->pab", candidates, other_axes)), other_half)
    return np.asarray((apart - reach - other_reach).max(axis=1))
