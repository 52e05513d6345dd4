"""Reads a mesh that a user brings: a closed solid, put upright on its axis of revolution.

Lengths are in millimetres here, as on a drawing.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray

from benchmark.meshes.bodies import BodiesError, one_solid
from benchmark.meshes.surface import OpenSurfaceError, closed_surface
from vision.errors import FileFormatError, InputError

Floats = NDArray[np.float64]

MESH_SUFFIXES = (".obj", ".stl", ".ply")
SMALLEST_MM, LARGEST_MM = 5.0, 1000.0
MM_PER_UNIT = {"m": 1000.0, "mm": 1.0}
LEAST_ROUND = 0.3  # share of the side faces that face straight away from the axis
_RADIAL = 0.1  # sine of the angle to the radial direction up to which they do
_SIDE = 0.9  # of a unit normal's z: faces above are end faces, which tell nothing of the axis


@dataclass(frozen=True)
class MeshReference:
    """A mesh file as it is named where a part's name is expected: ``pulley.obj``, or ``pulley.stl:mm``.

    Attributes:
        path: of the file.
        unit: of its coordinates, ``m`` or ``mm``.
    """

    path: Path
    unit: str = "m"

    def __post_init__(self) -> None:
        if self.unit not in MM_PER_UNIT:
            raise InputError("unit of a mesh", got=repr(self.unit), expected=" or ".join(MM_PER_UNIT))

    def __str__(self) -> str:
        return f"{self.path}:{self.unit}"

    @classmethod
    def parse(cls, name: str) -> MeshReference | None:
        """The mesh that a part's name refers to; None where the name is not that of a mesh file."""
        path, _, unit = name.rpartition(":")
        if unit.lower() not in MM_PER_UNIT:
            path, unit = name, "m"
        return cls(Path(path), unit.lower()) if Path(path).suffix.lower() in MESH_SUFFIXES else None


def read_solid(reference: MeshReference) -> Manifold:
    """The solid in a mesh file, moved so that its axis of revolution is z and its mid-height z = 0.

    Args:
        reference: the file, Wavefront OBJ, STL or PLY; z has to be parallel to the axis.

    Raises:
        InputError: no such file, not closed, of an unlikely size, or not round about z.
        FileFormatError: not a mesh.
    """
    mesh = _read(reference.path)
    mesh.apply_scale(MM_PER_UNIT[reference.unit])
    _check_size(reference, mesh.extents)
    solid = _solid(reference, mesh)
    triangles = solid.to_mesh64()
    mesh = trimesh.Trimesh(triangles.vert_properties[:, :3], triangles.tri_verts.astype(np.int64), process=False)
    centre = _axis(reference.path, mesh)
    low, high = mesh.bounds[:, 2]
    return solid.translate((-centre[0], -centre[1], -(low + high) / 2))


def check_exists(path: Path) -> None:
    """Make sure that there is a file that can be read.

    Raises:
        InputError: there is none.
    """
    expected = "an OBJ, STL or PLY file"
    try:
        if not path.is_file():
            raise InputError("mesh", got=f"no file {path}", expected=expected)
        path.open("rb").close()
    except OSError as error:
        raise InputError("mesh", got=f"{path} ({error.strerror})", expected=f"{expected} that can be read") from None


def _read(path: Path) -> trimesh.Trimesh:
    check_exists(path)
    try:
        mesh = trimesh.load_mesh(path)
    except Exception as error:  # trimesh lets through whatever its many readers raise
        raise FileFormatError(str(path), got=f"{type(error).__name__}: {error}", expected="a mesh") from error
    faces = np.asarray(getattr(mesh, "faces", ()))
    if len(faces) < 4 or not np.isfinite(mesh.vertices).all():
        raise FileFormatError(str(path), got=f"{len(faces)} triangles", expected="a mesh with a closed surface")
    mesh = trimesh.Trimesh(mesh.vertices, faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh


def _check_size(reference: MeshReference, extents: Floats) -> None:
    across = float(extents[:2].max())
    if SMALLEST_MM <= across <= LARGEST_MM:
        return
    other = "mm" if reference.unit == "m" else "m"
    in_other = across / MM_PER_UNIT[reference.unit] * MM_PER_UNIT[other]
    fits = SMALLEST_MM <= in_other <= LARGEST_MM
    what = {"m": "metres", "mm": "millimetres"}
    say_so = f"write {reference.path}:{other}; focalpick teach also takes --unit {other}"
    raise InputError(
        f"size of {reference.path}",
        got=f"{across * 1e-3:.4g} m across, read in {what[reference.unit]}",
        expected=f"from {SMALLEST_MM:g} to {LARGEST_MM:g} mm",
        do=f"If it was drawn in {what[other]}, {say_so}." if fits else "Scale it.",
    )


def _axis(path: Path, mesh: trimesh.Trimesh) -> Floats:
    """Where the axis of revolution crosses the x, y plane, (2,).

    Raises:
        InputError: there is none parallel to z.
    """
    roundness, centre = _roundness(mesh, 2)
    if roundness >= LEAST_ROUND:
        return centre
    others = {name: _roundness(mesh, k)[0] for k, name in enumerate("xy")}
    likely = max(others, key=lambda name: others[name])
    do = f"Turn it: its axis of revolution seems to be {likely}." if others[likely] >= LEAST_ROUND else ""
    raise InputError(
        f"shape of {path}",
        got=f"{roundness:.0%} of its sides face away from an axis along z",
        expected=f"a part that is round about z, with at least {LEAST_ROUND:.0%}",
        do=do,
    )


def _roundness(mesh: trimesh.Trimesh, axis: int) -> tuple[float, Floats]:
    """Share of the side faces that face straight away from the best axis in a direction, and where that axis is.

    The normals of a surface of revolution all meet its axis. The point that they meet is found by least squares,
    weighted again and again so that holes, keyways and spokes, which do not share it, lose their say.
    """
    across = [k for k in range(3) if k != axis]
    has_normal = mesh.face_normals.any(axis=1)  # a triangle whose corners are on one line has none
    side = (np.abs(mesh.face_normals[:, axis]) < _SIDE) & has_normal
    normals, points, area = (a[side] for a in (mesh.face_normals[:, across], mesh.triangles_center, mesh.area_faces))
    if not side.any():
        return 0.0, np.zeros(2)
    points = points[:, across]
    normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
    offsets = np.einsum("ij,ij->i", tangents, points)
    scale = float(mesh.extents[across].max())
    weights = area
    for _ in range(30):
        centre = _meeting_point(tangents, offsets, weights)
        weights = area / (np.abs(tangents @ centre - offsets) + 1e-3 * scale)
    radial = np.abs(tangents @ centre - offsets) <= _RADIAL * np.linalg.norm(points - centre, axis=1)
    return float(area[radial].sum() / area.sum()), _meeting_point(tangents, offsets, area * radial)


def _meeting_point(tangents: Floats, offsets: Floats, weights: Floats) -> Floats:
    """The point (2,) nearest to lines with normals (N, 2) at offsets (N,) from the origin."""
    weighted = tangents * weights[:, None]
    return np.asarray(np.linalg.lstsq(weighted.T @ tangents, weighted.T @ offsets, rcond=None)[0])


def _solid(reference: MeshReference, mesh: trimesh.Trimesh) -> Manifold:
    """The solid that the triangles of a file bound.

    Raises:
        InputError: their surface is not closed, or it is in doubt what is inside.
    """
    what = f"surface of {reference.path}"
    try:
        return one_solid(closed_surface(np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)))
    except OpenSurfaceError as error:
        at = ", ".join(f"{x:.4g}" for x in error.at / MM_PER_UNIT[reference.unit])
        do = f"{error.do} It is near ({at}) in the file's coordinates."
        raise InputError(what, got=error.got, expected="a closed surface", do=do) from None
    except BodiesError as error:
        raise InputError(what, got=error.got, expected="the surface of one part", do=error.do) from None
