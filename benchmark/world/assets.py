"""Part files: writing them from the drawings (`focalpick assets build`) and reading them back.

The files are text, in metres, and with one set of versions byte-identical whenever they are built: coordinates are
rounded to 0.1 micrometre, vertices and faces are sorted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from benchmark.world.designs import DESIGNS, Design
from vision.errors import FileFormatError, ResourceError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ASSETS = Path(__file__).resolve().parents[2] / "assets"
PROPERTIES_FILE = "parts.json"
SLIVER_MM = 1e-3  # vertices closer than this are merged
CREASE_COS = float(np.cos(np.radians(14.0)))  # faces that meet at less than this angle are shaded as one surface
FLAT_RAD = 2e-3  # and at less than this, they are one flat patch


def build_assets(directory: Path = ASSETS) -> list[Path]:
    """Write the meshes, collision pieces and mass properties of every part.

    Args:
        directory: the assets directory; the files go to its ``meshes`` folder.

    Returns:
        The files written, in order.
    """
    meshes = directory / "meshes"
    written, properties = [], {}
    for design in DESIGNS.values():
        vertices, faces = canonical(design.solid())
        visual = visual_path(meshes, design.name)
        _write(visual, obj_text(vertices, faces, crease_normals(vertices, faces)))
        pieces = []
        for k, piece in enumerate(design.pieces()):
            path = piece_path(meshes, design.name, k)
            _write(path, obj_text(*canonical(piece)))
            pieces.append(path)
        properties[design.name] = mass_properties(vertices, faces, design) | {"collision_pieces": len(pieces)}
        written += [visual, *pieces]
    _write(meshes / PROPERTIES_FILE, json.dumps(properties, indent=2) + "\n")
    return [*written, meshes / PROPERTIES_FILE]


def visual_path(meshes: Path, name: str) -> Path:
    """File of the mesh of a part that is drawn."""
    return meshes / name / "visual.obj"


def piece_path(meshes: Path, name: str, k: int) -> Path:
    """File of the k-th collision piece of a part."""
    return meshes / name / "collision" / f"{k:02d}.obj"


def canonical(solid: Manifold) -> tuple[Floats, Ints]:
    """Vertices (N, 3) in metres and faces (M, 3) of a solid, rounded and in an order that depends on nothing else."""
    mesh = solid.simplify(SLIVER_MM).to_mesh64()
    rounded = np.round(mesh.vert_properties[:, :3] * 1e-3, 7) + 0.0  # + 0.0 turns -0.0 into 0.0
    vertices, index = np.unique(rounded, axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.tri_verts.astype(np.int64)]
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return vertices, faces[np.lexsort(faces.T[::-1])]


def crease_normals(vertices: Floats, faces: Ints) -> Floats:
    """Unit normals (M, 3, 3) of every face corner: smooth across shallow edges, split at sharp ones.

    Each corner averages the faces around its vertex that lie within the crease angle of its own face, weighted by
    their angle there and by the area of the flat patch that they belong to. So a fillet bends towards the flat face
    beside it and not the other way round, however that face was cut into triangles.
    """
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_areas = np.linalg.norm(normals, axis=1)
    normals /= double_areas[:, None]
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    angles = np.arctan2(np.linalg.norm(np.cross(ahead, behind), axis=2), np.einsum("ijk,ijk->ij", ahead, behind))
    weights = (angles * _patch_sums(vertices, faces, double_areas)[:, None]).ravel()

    vertex_of = faces.ravel()
    order = np.argsort(vertex_of, kind="stable")
    around = np.split(order, np.flatnonzero(np.diff(vertex_of[order])) + 1)
    smooth = np.empty((faces.size, 3))
    for members in around:
        own = normals[members // 3]
        smooth[members] = ((own @ own.T > CREASE_COS) * weights[members]) @ own
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
    return smooth.reshape(-1, 3, 3)


def _patch_sums(vertices: Floats, faces: Ints, values: Floats) -> Floats:
    """For each face (M,), the sum of the values of all faces of its flat patch."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    flat = mesh.face_adjacency[mesh.face_adjacency_angles < FLAT_RAD]
    graph = coo_array((np.ones(len(flat)), (flat[:, 0], flat[:, 1])), shape=(len(faces), len(faces)))
    patch = connected_components(graph, directed=False)[1]
    return np.asarray(np.bincount(patch, weights=values)[patch])


def obj_text(vertices: Floats, faces: Ints, normals: Floats | None = None) -> str:
    """Wavefront OBJ of a mesh, with corner normals (M, 3, 3) where they are given."""
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in vertices]
    if normals is None:
        lines += [f"f {a} {b} {c}" for a, b, c in faces + 1]
        return "\n".join(lines) + "\n"
    unique, index = np.unique(np.round(normals.reshape(-1, 3), 4) + 0.0, axis=0, return_inverse=True)
    lines += [f"vn {x:.4f} {y:.4f} {z:.4f}" for x, y, z in unique]
    pairs = np.stack([faces, index.reshape(faces.shape)], axis=2) + 1
    lines += [f"f {a}//{i} {b}//{j} {c}//{k}" for (a, i), (b, j), (c, k) in pairs]
    return "\n".join(lines) + "\n"


def mass_properties(vertices: Floats, faces: Ints, design: Design) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it (part frame axes) of a closed mesh in metres."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.density = design.density_kg_m3
    inertia = np.asarray(mesh.moment_inertia)
    return {
        "triangles": len(faces),
        "mass_kg": float(f"{mesh.mass:.7g}"),
        "centre_of_mass_m": _without_noise(mesh.center_mass, 1e-7),
        "inertia_kg_m2": _without_noise(inertia, 1e-7 * inertia.max()),
    }


@cache
def read_properties(directory: Path = ASSETS) -> Mapping[str, Any]:
    """The mass properties that `build_assets` wrote, by part name.

    Raises:
        ResourceError: when the assets have not been built.
        FileFormatError: when the file is not JSON.
    """
    path = existing(directory / "meshes" / PROPERTIES_FILE)
    try:
        return dict(json.loads(path.read_text()))
    except ValueError as error:
        raise FileFormatError(str(path), got=error, expected="JSON", do="Run `focalpick assets build`.") from error


def read_vertices(path: Path) -> Floats:
    """Vertices (N, 3) of an OBJ file in metres."""
    rows = [line.split()[1:4] for line in existing(path).read_text().splitlines() if line.startswith("v ")]
    return np.array(rows, dtype=float)


def existing(path: Path) -> Path:
    """The path itself, if there is a file.

    Raises:
        ResourceError: when there is none.
    """
    if not path.is_file():
        raise ResourceError(f"{path} is missing. Run `focalpick assets build`.")
    return path


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="ascii", newline="\n")


def _without_noise(values: Floats, unit: float) -> Any:
    """Nested lists of the values as multiples of a unit, itself rounded down to a power of ten."""
    return (np.round(values, -int(np.floor(np.log10(unit)))) + 0.0).tolist()
