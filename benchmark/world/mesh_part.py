"""A part from any mesh file: what the world needs to know of it is measured on the mesh.

Frame as of every part: z is the axis of revolution, the origin on it at mid-height; +z, the front, is the file's +z.
What is built from a file is kept in a cache directory, under a digest of the file and of the code that builds it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import uuid
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.meshes import mesh_file, symmetry
from benchmark.meshes.mesh_file import MeshReference
from benchmark.world import assets, convex_pieces
from benchmark.world.part import Part, Symmetry
from vision.errors import ResourceError
from vision.kernel_cache import can_be_written, user_folders
from vision.model.grasp import BoreCoordinates

Floats = NDArray[np.float64]

DENSITY_KG_M3 = 2700.0
RGBA = (0.66, 0.67, 0.68, 1.0)
CACHE_VARIABLE = "FOCALPICK_CACHE"
LEAST_BORE = 0.02  # of the outline; what is narrower takes no peg
_CYLINDER = 1.02  # radius up to which a vertex belongs to a bore, over the bore's
_OFF_AXIS_MM = (0.0013, 0.0007)
_PROPERTIES = "part.json"
_VISUAL = "visual.obj"
_HERE = Path(__file__).parent
_SOURCES = (
    *(_HERE / name for name in ("assets.py", "convex_pieces.py", "mesh_part.py")),
    *sorted((_HERE.parent / "meshes").glob("*.py")),
)


def part_from_mesh(
    path: Path,
    unit: str = "m",
    *,
    density_kg_m3: float = DENSITY_KG_M3,
    rgba: tuple[float, float, float, float] = RGBA,
) -> Part:
    """The part in a mesh file; it has no grasps and no rims, which nobody has drawn.

    Args:
        path: Wavefront OBJ, STL or PLY; z has to be the axis of revolution.
        unit: of its coordinates, ``m`` or ``mm``.
        density_kg_m3: of the material; aluminium by default.
        rgba: its colour.

    Raises:
        InputError: no such file, not closed, of an unlikely size, or not round about z.
        FileFormatError: not a mesh.
        ResourceError: there is no room for what is built from it.
    """
    reference = MeshReference(path, unit)
    directory, properties = _built(reference)
    volume = properties["volume_m3"]
    return Part(
        name=path.stem,
        diameter_m=properties["diameter_m"],
        density_kg_m3=density_kg_m3,
        rgba=rgba,
        visual_mesh=directory / _VISUAL,
        collision_meshes=tuple(_piece(directory, k) for k in range(properties["collision_pieces"])),
        mass_kg=volume * density_kg_m3,
        centre_of_mass_m=np.array(properties["centre_of_mass_m"]),
        inertia=np.array(properties["inertia_per_density_m5"]) * density_kg_m3,
        symmetry=Symmetry(properties["symmetry_fold"]),
        grasps=(),
        bore=_bore(properties["bore_m"]),
        rims=(),
    )


def cache_directory() -> Path:
    """Where built parts are kept: ``FOCALPICK_CACHE``, else a folder of the user's own.

    Raises:
        ResourceError: there is none that can be written.
    """
    if chosen := os.environ.get(CACHE_VARIABLE):
        return Path(chosen)
    folders = tuple(user_folders())
    if (own := next(filter(can_be_written, folders), None)) is None:
        raise ResourceError(
            f"cache of parts: got {', '.join(map(str, folders)) or 'no home and no temporary directory'}; "
            f"expected a directory that can be written. Set {CACHE_VARIABLE} to one."
        )
    return own


def _built(reference: MeshReference) -> tuple[Path, dict[str, Any]]:
    """The directory of what was built from a mesh, and the properties in it; builds where there is none."""
    mesh_file.check_exists(reference.path)
    directory = cache_directory() / "parts" / _digest(reference)
    try:
        if not _is_whole(directory):
            _build(reference, directory)
        return directory, _read_properties(directory)
    except OSError as error:
        raise ResourceError(
            f"cache of parts in {directory.parent}: got {error.strerror}; expected a directory that can be read "
            f"and written. Set {CACHE_VARIABLE} to another one."
        ) from error


def _is_whole(directory: Path) -> bool:
    """Whether everything that belongs to a part is there; whoever tidies up old files may have taken some."""
    try:
        count = _read_properties(directory)["collision_pieces"]
    except (FileNotFoundError, NotADirectoryError, ValueError, LookupError, TypeError):
        return False
    return all(path.is_file() for path in (directory / _VISUAL, *(_piece(directory, k) for k in range(count))))


def _read_properties(directory: Path) -> dict[str, Any]:
    return dict(json.loads((directory / _PROPERTIES).read_text(encoding="ascii")))


def _digest(reference: MeshReference) -> str:
    total = hashlib.sha256(f"{reference.unit} {version('manifold3d')} {version('trimesh')}".encode())
    for path in (reference.path, *_SOURCES):
        total.update(b"\0" + path.read_bytes())
    return f"{reference.path.stem}-{total.hexdigest()[:16]}"


def _build(reference: MeshReference, directory: Path) -> None:
    """Write a directory whole or not at all; of several processes that build the same, one wins.

    Others may share the directory: it is as open as the user's files are, and not as closed as temporary ones.
    """
    solid = mesh_file.read_solid(reference)
    directory.parent.mkdir(parents=True, exist_ok=True)
    unfinished = directory.parent / f".unfinished-{uuid.uuid4().hex}"
    unfinished.mkdir()
    try:
        _write(solid, unfinished)
        if not _is_whole(directory):
            shutil.rmtree(directory, ignore_errors=True)
            unfinished.rename(directory)
    except OSError:
        if not _is_whole(directory):  # another process was not faster: it is the disk
            raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)


def _write(solid: Manifold, directory: Path) -> None:
    fold = symmetry.symmetry_fold(solid)
    cut = convex_pieces.convex_pieces(solid, fold)
    vertices, faces = assets.canonical(solid)
    _write_text(directory / _VISUAL, assets.obj_text(vertices, faces, assets.crease_normals(vertices, faces)))
    for k, piece in enumerate(cut.pieces):
        _write_text(_piece(directory, k), assets.obj_text(np.asarray(piece.vertices) * 1e-3, np.asarray(piece.faces)))
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    properties = {
        "diameter_m": 2 * float(np.hypot(vertices[:, 0], vertices[:, 1]).max()),
        "volume_m3": float(mesh.volume),
        "centre_of_mass_m": np.asarray(mesh.center_mass).tolist(),
        "inertia_per_density_m5": np.asarray(mesh.moment_inertia).tolist(),
        "symmetry_fold": fold,
        "bore_m": _measure_bore(solid, vertices),
        "collision_pieces": len(cut.pieces),
        "collision_excess": cut.excess,
    }
    _write_text(directory / _PROPERTIES, json.dumps(properties, indent=2) + "\n")


def _measure_bore(solid: Manifold, vertices: Floats) -> tuple[float, float, float] | None:
    """Diameter, front z and back z of the central through hole in metres; None where there is none."""
    radii = np.hypot(vertices[:, 0], vertices[:, 1])
    radius = float(radii.min())
    if 2 * radius < LEAST_BORE * 2 * radii.max() or _is_closed_at_axis(solid):
        return None
    heights = vertices[radii <= _CYLINDER * radius, 2]
    return 2 * radius, float(heights.max()), float(heights.min())


def _is_closed_at_axis(solid: Manifold) -> bool:
    """Whether the axis runs through material: a lid need not have a vertex there."""
    _, _, bottom, _, _, top = solid.bounding_box()
    x, y = _OFF_AXIS_MM  # a ray along the axis itself could slip between the triangles that meet there
    return len(solid.ray_cast((x, y, bottom - 1.0), (x, y, top + 1.0))) > 0


def _bore(measured: list[float] | None) -> BoreCoordinates | None:
    if measured is None:
        return None
    diameter, front, back = measured
    pose = RigidTransform.from_components([0.0, 0.0, front], Rotation.from_euler("x", np.pi))
    return BoreCoordinates(pose, diameter, front - back)


def _piece(directory: Path, k: int) -> Path:
    return directory / f"piece_{k:02d}.obj"


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="ascii", newline="\n")
