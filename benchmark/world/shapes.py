"""Solid geometry of revolved parts: lathed profiles, cutters, and their exact convex decomposition.

Lengths are in millimetres here, as on a drawing; ``benchmark.world.assets`` converts to metres. z is the axis of
revolution and profiles are (r, z) polygons that run counter-clockwise in the (r, z) plane.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from manifold3d import CrossSection, Manifold

Point = tuple[float, float]

HOLE_SEGMENTS = 48
BEYOND = 1.0  # cutters reach this far out of the material, so that no two faces coincide


def arc(centre: Point, radius: float, start_deg: float, stop_deg: float, steps: int = 8) -> list[Point]:
    """Points of a circular arc in the plane, both ends included; it may run either way."""
    angles = np.radians(np.linspace(start_deg, stop_deg, steps + 1))
    return [(centre[0] + radius * float(np.cos(a)), centre[1] + radius * float(np.sin(a))) for a in angles]


def lathe(profile: Sequence[Point], segments: int) -> Manifold:
    """The solid of revolution of a closed (r, z) profile, with a vertex at angle zero."""
    return CrossSection([list(profile)]).revolve(segments)


def drill(radius: float, bottom: float, top: float, chamfer: float = 0.0, segments: int = HOLE_SEGMENTS) -> Manifold:
    """Cutter on the z axis for a through hole from z = bottom to top, with 45 degree chamfers at both mouths."""
    mouth = radius + chamfer
    return lathe(
        [
            (0.0, bottom - BEYOND),
            (mouth, bottom - BEYOND),
            (mouth, bottom),
            (radius, bottom + chamfer),
            (radius, top - chamfer),
            (mouth, top),
            (mouth, top + BEYOND),
            (0.0, top + BEYOND),
        ],
        segments,
    )


def prism(outline: CrossSection, bottom: float, top: float) -> Manifold:
    """The outline in x, y extruded from z = bottom to top."""
    return outline.extrude(top - bottom).translate((0.0, 0.0, bottom))


def disc(x: float, y: float, radius: float, segments: int = HOLE_SEGMENTS) -> CrossSection:
    """A filled circle in the x, y plane."""
    return CrossSection.circle(radius, segments).translate((x, y))


def arc_slot(radius: float, half_width: float, half_angle_deg: float) -> CrossSection:
    """A slot with round ends that follows the circle of the given radius, centred on the x axis."""
    outer = arc((0.0, 0.0), radius + half_width, -half_angle_deg, half_angle_deg, 12)
    inner = arc((0.0, 0.0), radius - half_width, half_angle_deg, -half_angle_deg, 12)
    ends = [arc((radius, 0.0), half_width, a, b, 16)[1:-1] for a, b in ((0.0, 180.0), (-180.0, 0.0))]
    caps = [_turned(end, angle) for end, angle in zip(ends, (half_angle_deg, -half_angle_deg), strict=True)]
    return CrossSection([outer + caps[0] + inner + caps[1]])


def radial_slot(inner: tuple[float, float], outer: tuple[float, float]) -> CrossSection:
    """The hull of two circles on the x axis, each given as (distance from the axis, radius)."""
    return CrossSection.batch_hull([disc(inner[0], 0.0, inner[1]), disc(outer[0], 0.0, outer[1])])


def ring_of(solid: Manifold, count: int, start_deg: float = 0.0) -> Manifold:
    """Union of `count` copies of a solid, equally spaced about z."""
    return Manifold.compose([solid.rotate((0.0, 0.0, start_deg + 360.0 * k / count)) for k in range(count)])


def rotations(solid: Manifold, count: int, start_deg: float = 0.0) -> list[Manifold]:
    """The copies of `ring_of`, one by one."""
    return [solid.rotate((0.0, 0.0, start_deg + 360.0 * k / count)) for k in range(count)]


def convex_ring(profile: Sequence[Point], sectors: int, steps: int, *, bore: bool = False) -> list[Manifold]:
    """Convex sectors that together fill the ring swept by a convex (r, z) profile.

    The outside of each sector is a polygon of `steps` edges whose mean radius is that of the profile. The inside has
    to be one chord per sector.

    Args:
        profile: convex polygon of (r, z) in mm.
        sectors: number of equal pieces.
        steps: edges of the outer polygon within each sector.
        bore: the chords touch the inner circle from outside, so that a round peg of the nominal diameter just fits;
            otherwise they have its mean radius.
    """
    width = 2 * np.pi / sectors
    innermost = min(r for r, _ in profile)
    points = []
    for radius, z in profile:
        edges = 1 if radius <= innermost else steps
        half_edge = width / edges / 2
        touching = bore and edges == 1
        vertex = radius / (np.cos(half_edge) if touching else _mean_radius(half_edge))
        for angle in np.linspace(-width / 2, width / 2, edges + 1):
            points.append((vertex * np.cos(angle), vertex * np.sin(angle), z))
    return rotations(hull(points), sectors)


def hull(points: Iterable[Sequence[float]]) -> Manifold:
    """The convex hull of points (x, y, z)."""
    return Manifold.hull_points(np.array(list(points), dtype=float))


def box(low: Sequence[float], high: Sequence[float]) -> Manifold:
    """An axis-parallel box between two opposite corners."""
    return Manifold.cube([b - a for a, b in zip(low, high, strict=True)]).translate(tuple(low))


def _turned(points: Sequence[Point], angle_deg: float) -> list[Point]:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return [(float(c * x - s * y), float(s * x + c * y)) for x, y in points]


def _mean_radius(half_edge: float) -> float:
    """Mean radius over the angle of a regular polygon of vertex radius 1; half_edge in radians."""
    c = np.cos(half_edge)
    return float(c * np.log(1 / c + np.tan(half_edge)) / half_edge)
