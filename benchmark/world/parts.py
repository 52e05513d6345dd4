"""Finds a part by its name: one of the drawn ones, or whatever mesh file a user brings."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.meshes.mesh_file import MeshReference
from benchmark.world import assets
from benchmark.world.designs import DESIGNS, Design
from benchmark.world.grasps import grasps_of
from benchmark.world.mesh_part import part_from_mesh
from benchmark.world.part import Part, Rim, Symmetry
from vision.errors import FileFormatError, InputError
from vision.frozen import read_only
from vision.model.grasp import BoreCoordinates

Floats = NDArray[np.float64]

PART_NAMES = tuple(DESIGNS)


@cache
def get_part(name: str) -> Part:
    """The part of that name, or in that mesh file (``pulley.obj`` in metres, ``pulley.stl:mm``).

    Raises:
        InputError: when there is no such part, or the mesh cannot be one.
        ResourceError: when its files have not been built.
        FileFormatError: when the file of mass properties does not describe it.
    """
    if (mesh := MeshReference.parse(name)) is not None:
        return part_from_mesh(mesh.path, mesh.unit)
    if name not in DESIGNS:
        raise unknown_part(name, got=repr(name))
    design = DESIGNS[name]
    meshes = assets.ASSETS / "meshes"
    try:
        properties = assets.read_properties()[name]
        mass, centre, inertia = (properties[key] for key in ("mass_kg", "centre_of_mass_m", "inertia_kg_m2"))
        pieces = range(properties["collision_pieces"])
    except KeyError as error:
        raise FileFormatError(
            str(meshes / assets.PROPERTIES_FILE),
            got=f"no {error}",
            expected=f"the mass properties of {name}",
            do="Run `focalpick assets build`.",
        ) from error
    return Part(
        name=name,
        diameter_m=design.diameter * 1e-3,
        density_kg_m3=design.density_kg_m3,
        rgba=design.rgba,
        visual_mesh=assets.existing(assets.visual_path(meshes, name)),
        collision_meshes=tuple(assets.existing(assets.piece_path(meshes, name, k)) for k in pieces),
        mass_kg=mass,
        centre_of_mass_m=centre,
        inertia=inertia,
        symmetry=Symmetry(design.fold),
        grasps=grasps_of(name),
        bore=_bore(design),
        rims=tuple(Rim(e.name, e.z * 1e-3, e.radius * 1e-3, e.side, e.offset * 1e-3, e.copies) for e in design.edges),
    )


def unknown_part(name: str, got: str) -> InputError:
    """The error that says which parts there are, and what may be wrong with a name."""
    file, _, unit = name.rpartition(":")
    if MeshReference.parse(file) is not None:
        do = f"Write :m or :mm for the unit, not :{unit}."
    elif Path(name).suffix:
        do = "Export it as one of these."
    else:
        do = "Commas separate parts, and + mixes them."
    expected = f"one of {', '.join(PART_NAMES)}, or a mesh file (OBJ, STL or PLY)"
    return InputError("part", got=got, expected=expected, do=do)


@cache
def vertices(part: Part) -> Floats:
    """Vertices (N, 3) of the visual mesh in metres, in the part frame; read-only."""
    return read_only(assets.read_vertices(part.visual_mesh))


def _bore(design: Design) -> BoreCoordinates:
    diameter, front, back = design.bore
    down = Rotation.from_euler("x", np.pi)
    pose = RigidTransform.from_components([0.0, 0.0, front * 1e-3], down)
    return BoreCoordinates(pose, diameter * 1e-3, (front - back) * 1e-3)
