"""Where a parallel gripper can hold each part.

The TCP frame has z along the approach (out of the gripper), x along the opening of the fingers, and its origin
between the finger tips, 5 mm behind their ends. The tips are 4 mm thick along x and 10 mm wide along y; from 35 mm
behind their ends on the fingers grow thicker. Here every grasp says where the finger ends are.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.model.grasp import GraspCoordinates, GraspKind

FINGER_WIDTH_MM = 10.0
TCP_BEHIND_ENDS_MM = 5.0
FREE_TURNS = 12  # copies of a grasp that may turn freely about z
SIDE_TURNS = 24  # of one from the side: with fewer, none is upright enough to stay off the floor

Grasps = tuple[GraspCoordinates, ...]
Vector = Sequence[float] | NDArray[np.float64]
X = (1.0, 0.0, 0.0)
FRONT, BACK = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)  # approach directions towards the front and the back of a part


def grasps_of(name: str) -> Grasps:
    """All grasps of a part, the preferred ones first."""
    return {"hub": _hub, "cover1": _cover1, "cover2": _cover2}[name]()


def _hub() -> Grasps:
    between_cooling_holes = np.radians(9.0)
    return (
        _grasp("bore_front", (0.0, 0.0, 8.0), FRONT, X, _chord(32.0), "inside", FREE_TURNS),
        _grasp("bore_back", (0.0, 0.0, 23.5), BACK, X, _chord(32.0), "inside", FREE_TURNS),
        *_radial("rim", 97.0, -19.0, between_cooling_holes, opening="axial", gap=14.0, copies=20),
    )


def _cover1() -> Grasps:
    return (
        _grasp("outside_front", (0.0, 0.0, -4.5), FRONT, X, 30.0, "outside", FREE_TURNS),
        _grasp("outside_back", (0.0, 0.0, 3.5), BACK, X, 30.0, "outside", FREE_TURNS),
        *_wall("wall_back", 13.4, 15.0, -2.5, azimuth=0.0, copies=FREE_TURNS),
        *_radial("side", -9.0, -1.4, 0.0, opening="tangential", gap=30.0, copies=SIDE_TURNS),
        _grasp("boss_front", (0.0, 0.0, 5.1), FRONT, X, 16.0, "outside", FREE_TURNS),
        *_leaning(
            "lean", 8.0, -1.4, gap=30.0, front={30: FREE_TURNS, 60: FREE_TURNS}, back={30: FREE_TURNS, 60: FREE_TURNS}
        ),
        *_radial("rim", 10.5, -1.4, 0.0, opening="axial", gap=11.2, copies=SIDE_TURNS),
    )


def _cover2() -> Grasps:
    between_ribs = np.radians(30.0)
    x = (float(np.cos(between_ribs)), float(np.sin(between_ribs)), 0.0)
    return (
        _grasp("outside_front", (0.0, 0.0, -11.0), FRONT, x, 65.0, "outside", 6),
        _grasp("outside_back", (0.0, 0.0, 7.0), BACK, x, 65.0, "outside", 6),
        _grasp("bore_front", (0.0, 0.0, 1.5), FRONT, x, _chord(9.5), "inside", FREE_TURNS),
        _grasp("bore_back", (0.0, 0.0, 11.5), BACK, x, _chord(9.5), "inside", FREE_TURNS),
        *_wall("wall_back", 29.9, 32.5, -1.0, azimuth=between_ribs, copies=6),
        *_radial("side", -10.0, 1.5, 0.0, opening="tangential", gap=65.0, copies=FREE_TURNS),
        _grasp("boss_front", (0.0, 0.0, 10.3), FRONT, x, 30.0, "outside", 6),
        _grasp("boss_back", (0.0, 0.0, 3.0), BACK, x, 30.0, "outside", 6),
        # From the back the fingers pass beside an ear, and reach no further towards the edge.
        *_leaning("lean", 9.0, 2.0, gap=65.0, front={30: 6, 60: 6}, back={60: 3}),
        *_radial("rim", 27.5, -3.0, between_ribs, opening="axial", gap=22.0, copies=6),
    )


def _radial(name: str, radius: float, z: float, azimuth: float, *, opening: str, gap: float, copies: int) -> Grasps:
    """Approach towards the axis, with the fingers opening along z or along the tangent."""
    outward = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    x = np.array([0.0, 0.0, 1.0]) if opening == "axial" else np.array([-outward[1], outward[0], 0.0])
    ends = radius * outward + np.array([0.0, 0.0, z])
    return (_grasp(name, ends, -outward, x, gap, "outside", copies),)


def _leaning(
    name: str, beyond: float, z: float, *, gap: float, front: dict[int, int], back: dict[int, int]
) -> Grasps:
    """On two opposite sides of the outline, approaching between the radial and the axial direction.

    The fingers' flat faces touch the outline along a line, whichever way they lean along it: so a piece that leans or
    stands on edge can be taken from above. `front` and `back` give the copies by the angle in degrees from the radial
    direction.
    """
    grasps = []
    for face, side, leans in (("front", -1.0, front), ("back", 1.0, back)):
        for lean, copies in leans.items():
            approach = np.array([-np.cos(np.radians(lean)), 0.0, side * np.sin(np.radians(lean))])
            ends = np.array([0.0, 0.0, z]) + beyond * approach
            grasps.append(_grasp(f"{name}_{lean}_{face}", ends, approach, (0.0, 1.0, 0.0), gap, "outside", copies))
    return tuple(grasps)


def _wall(name: str, inner: float, outer: float, z: float, *, azimuth: float, copies: int) -> Grasps:
    """One finger inside the open cup and one outside."""
    inner_contact = _chord(inner) / 2
    x = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    ends = (inner_contact + outer) / 2 * x + np.array([0.0, 0.0, z])
    return (_grasp(name, ends, BACK, x, outer - inner_contact, "outside", copies),)


def _chord(radius: float) -> float:
    """Distance in mm between the flat outer faces of two fingers whose edges touch a bore from inside."""
    return float(2 * np.sqrt(radius**2 - (FINGER_WIDTH_MM / 2) ** 2))


def _grasp(
    name: str, ends_mm: Vector, approach: Vector, x: Vector, gap: float, kind: GraspKind, copies: int
) -> GraspCoordinates:
    """A grasp whose finger ends are level with a point on the part; the TCP lies a little behind them."""
    rotation = Rotation.from_matrix(np.column_stack([x, np.cross(approach, x), approach]))
    origin_mm = np.asarray(ends_mm) - TCP_BEHIND_ENDS_MM * np.asarray(approach)
    return GraspCoordinates(
        name, RigidTransform.from_components(origin_mm * 1e-3, rotation), gap * 1e-3, kind, copies
    )
