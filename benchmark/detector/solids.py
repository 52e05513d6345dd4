"""What stands in a rendered scene: round solids whose elliptic edges are known, and clutter without any.

A round solid is a stack of coaxial cylinders or a sphere. Every circle on it is handed out as a circle in space, and
so is the outline of a sphere: the rays that touch a sphere touch it along a circle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from vision.frozen import frozen_arrays
from vision.geometry.circle import Circle

Array = NDArray[np.float64]

GRAIN = "grain"  # name of the texture of things, where they have one
_DARKEST, _BRIGHTEST = 0.08, 0.95  # albedo
_THINNEST_M = 1e-3
_WEDGE = "-1 -1 -1  1 -1 -1  -1 1 -1  1 1 -1  -1 -1 1  -1 1 1"  # corners of a prism within a cube of side 2


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Solid:
    """A thing in the scene, in the world's frame with z upwards.

    Attributes:
        assets: MuJoCo's XML of its materials and meshes.
        geoms: MuJoCo's XML of its surfaces.
        circles: every circle that can show as an ellipse.
        centre: (3,) of the ball that holds it, metres.
        reach_m: radius of that ball.
    """

    assets: str
    geoms: str
    circles: tuple[Circle, ...]
    centre: Array
    reach_m: float


def random_stack(rng: np.random.Generator, name: str, at: Array, radius_m: float) -> Solid:
    """One to four coaxial cylinders of different greys on the ground at (2,): standing, lying or tilted."""
    radii, bounds = _profile(rng, radius_m)
    tilt = float(rng.choice([0.0, 0.0, np.pi / 2, rng.uniform(0.1, 1.4)]))
    turn = Rotation.from_euler("ZY", [rng.uniform(0, 2 * np.pi), tilt])
    axis = turn.as_matrix()[:, 2]
    lowest = min(
        z * np.cos(tilt) - r * np.sin(tilt)
        for r, low, high in zip(radii, bounds, bounds[1:], strict=False)
        for z in (low, high)
    )
    origin = np.array([*at, -lowest])
    quaternion = " ".join(map(repr, turn.as_quat(scalar_first=True).tolist()))
    assets, geoms, albedo = "", "", None
    for i, r in enumerate(radii):
        albedo = random_albedo(rng, albedo)
        assets += material(rng, f"{name}_{i}", albedo)
        centre = origin + (bounds[i] + bounds[i + 1]) / 2 * axis
        size = f"{r!r} {(bounds[i + 1] - bounds[i]) / 2!r}"
        geoms += (
            f'<geom type="cylinder" size="{size}" pos="{_text(centre)}" quat="{quaternion}" material="{name}_{i}"/>\n'
        )
    # Where two neighbours have the same radius they share one circle.
    ends = {(r, z) for i, r in enumerate(radii) for z in (bounds[i], bounds[i + 1])}
    circles = tuple(Circle(origin + z * axis, axis, r) for r, z in sorted(ends))
    return Solid(assets, geoms, circles, origin, float(np.hypot(radius_m, max(-bounds[0], bounds[-1]))))


def _profile(rng: np.random.Generator, radius_m: float) -> tuple[list[float], list[float]]:
    """Radii of a stack's cylinders, the largest as given, and where they begin and end along the axis."""
    radii = [radius_m]
    for _ in range(int(rng.integers(0, 4))):
        radii.append(radii[-1] * float(rng.choice([1.0, rng.uniform(0.4, 0.92)], p=[0.15, 0.85])))
    heights = [max(float(radius_m * np.exp(rng.uniform(np.log(0.04), np.log(1.2)))), _THINNEST_M) for _ in radii]
    if rng.random() < 0.15:  # broad in the middle or on top
        radii = radii[1:] + radii[:1]
    bounds = np.concatenate([[0.0], np.cumsum(heights)])
    return radii, (bounds - bounds[-1] / 2).tolist()


def random_sphere(rng: np.random.Generator, name: str, at: Array, radius_m: float, eye: Array) -> Solid:
    """A sphere on the ground at (2,) as seen from ``eye`` (3,)."""
    centre = np.array([*at, radius_m])
    geoms = f'<geom type="sphere" size="{radius_m!r}" pos="{_text(centre)}" material="{name}"/>\n'
    outline = sphere_outline(centre, radius_m, eye)
    return Solid(material(rng, name, random_albedo(rng)), geoms, (outline,), centre, radius_m)


def sphere_outline(centre: Array, radius_m: float, eye: Array) -> Circle:
    """The circle along which the rays from ``eye`` (3,) that touch a sphere do so: its outline."""
    towards = eye - centre
    share = (radius_m / float(np.linalg.norm(towards))) ** 2  # (r/d)²: the right triangle of eye, touch and centre
    return Circle(centre + share * towards, towards, radius_m * float(np.sqrt(1 - share)))


def random_block(rng: np.random.Generator, name: str, centre: Array, half_sizes_m: Array, turn: Rotation) -> Solid:
    """A box, or half a box cut along a diagonal, without any ellipse."""
    assets = material(rng, name, random_albedo(rng))
    quaternion = " ".join(map(repr, turn.as_quat(scalar_first=True).tolist()))
    shape = f'type="box" size="{_text(half_sizes_m)}"'
    if rng.random() < 0.35:
        assets += f'<mesh name="{name}" vertex="{_WEDGE}" scale="{_text(half_sizes_m)}" inertia="convex"/>\n'
        shape = f'type="mesh" mesh="{name}"'
    geoms = f'<geom {shape} pos="{_text(centre)}" quat="{quaternion}" material="{name}"/>\n'
    return Solid(assets, geoms, (), centre, float(np.linalg.norm(half_sizes_m)))


def random_albedo(rng: np.random.Generator, other: float | None = None) -> float:
    """How much light a surface returns, plainly different from ``other``."""
    while True:
        albedo = float(rng.uniform(_DARKEST, _BRIGHTEST))
        if other is None or abs(albedo - other) > 0.12:
            return albedo


def material(rng: np.random.Generator, name: str, albedo: float) -> str:
    """MuJoCo's XML of a dull surface, some with a grain."""
    grain = f'texture="{GRAIN}" texuniform="true" texrepeat="3 3"' if rng.random() < 0.4 else ""
    rgba = f"{albedo:.4f} {albedo:.4f} {albedo:.4f} 1"
    shine = f'specular="{rng.uniform(0, 0.15):.3f}" shininess="{rng.uniform(0.05, 0.4):.3f}"'
    return f'<material name="{name}" rgba="{rgba}" {shine} reflectance="0" {grain}/>\n'


def _text(numbers: Array) -> str:
    return " ".join(repr(float(v)) for v in numbers)
