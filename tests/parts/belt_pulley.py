"""A belt pulley for poly-V belts: a part that the code knows nothing of. Writes ``belt_pulley.obj`` beside this file.

Six ribs, a flange on the front, a web with five holes, a hub with a bore; 72 mm across. z is its axis, +z its front.
Nothing of this is made with the drawings of the benchmark's own parts.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold

SEGMENTS = 160
MESH = Path(__file__).with_suffix(".obj")
DIAMETER_MM = 72.0
HOLES, HOLE_RADIUS, HOLE_OFFSET = 5, 4.5, 20.5
RIBS, RIB_PITCH, RIB_DEPTH = 6, 3.0, 2.2
CHAMFER = 0.2


@dataclass(frozen=True)
class PulleyRim:
    """A circular edge of the pulley as a person sees it, in millimetres; see `benchmark.world.parts.Rim`."""

    name: str
    radius: float
    z: float
    side: int
    offset: float = 0.0
    copies: int = 1


RIMS = (
    PulleyRim("flange_front", 36.0, 10.8, +1),
    PulleyRim("hollow_front", 28.0, 11.0, +1),
    PulleyRim("boss_front", 13.0, 12.8, +1),
    PulleyRim("bore_front", 7.5, 12.8, +1),
    PulleyRim("hole_front", HOLE_RADIUS, 3.0, +1, HOLE_OFFSET, HOLES),
    PulleyRim("flange_back", 36.0, 8.2, -1),
    PulleyRim("rim_back", 33.0, -12.8, -1),
    PulleyRim("hollow_back", 28.0, -13.0, -1),
    PulleyRim("boss_back", 13.0, -8.8, -1),
    PulleyRim("bore_back", 7.5, -8.8, -1),
    PulleyRim("hole_back", HOLE_RADIUS, -3.0, -1, HOLE_OFFSET, HOLES),
)


def profile() -> list[tuple[float, float]]:
    """The (r, z) outline in millimetres, counter-clockwise."""
    c = CHAMFER
    grooves = []
    for k in range(RIBS):
        bottom = -10.0 + k * RIB_PITCH
        grooves += [
            (33.0, bottom),
            (33.0 - RIB_DEPTH, bottom + 0.45 * RIB_PITCH),
            (33.0 - RIB_DEPTH, bottom + 0.55 * RIB_PITCH),
        ]
    return [
        (28.0, -13.0),
        (33.0 - c, -13.0),
        (33.0, -13.0 + c),
        *grooves,
        (33.0, 8.0),
        (36.0 - c, 8.0),
        (36.0, 8.0 + c),
        (36.0, 11.0 - c),
        (36.0 - c, 11.0),
        (28.0, 11.0),
        (28.0, 3.0),
        (13.0, 3.0),
        (13.0, 13.0 - c),
        (13.0 - c, 13.0),
        (7.5 + c, 13.0),
        (7.5, 13.0 - c),
        (7.5, -9.0 + c),
        (7.5 + c, -9.0),
        (13.0 - c, -9.0),
        (13.0, -9.0 + c),
        (13.0, -3.0),
        (28.0, -3.0),
    ]


def solid() -> Manifold:
    """The pulley in millimetres."""
    turned = CrossSection([profile()]).revolve(SEGMENTS)
    hole = Manifold.cylinder(10.0, HOLE_RADIUS, HOLE_RADIUS, 48, True).translate((HOLE_OFFSET, 0.0, 0.0))
    return turned - Manifold.compose([hole.rotate((0.0, 0.0, 360.0 * k / HOLES)) for k in range(HOLES)])


def mesh(unit_mm: float = 1000.0) -> trimesh.Trimesh:
    """The pulley as triangles, in a unit of so many millimetres; metres by default."""
    triangles = solid().to_mesh64()
    vertices = np.asarray(triangles.vert_properties)[:, :3] / unit_mm
    return trimesh.Trimesh(vertices, np.asarray(triangles.tri_verts, dtype=np.int64), process=False)


def write(path: Path = MESH) -> None:
    """Write the mesh as Wavefront OBJ in metres, rounded to a micrometre."""
    pulley = mesh()
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in np.round(pulley.vertices, 6) + 0.0]
    lines += [f"f {a} {b} {c}" for a, b, c in pulley.faces + 1]
    path.write_text("\n".join(lines) + "\n", encoding="ascii", newline="\n")


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else MESH)
