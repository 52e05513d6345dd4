"""The values that describe a part: meshes, mass, symmetry, grasps and bore, as the world and the tasks need them.

Frame of every part: z is the axis of revolution, +z the front (the face of the hat or cup), the origin on the axis
at mid-height.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vision.errors import InputError
from vision.frozen import frozen_arrays
from vision.model.grasp import BoreCoordinates, GraspCoordinates

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Symmetry:
    """Rotations about the part's z that leave it unchanged.

    Attributes:
        fold: number of equal turns in a circle; None where any turn will do.
    """

    fold: int | None

    def __post_init__(self) -> None:
        if self.fold is not None and self.fold < 1:
            raise InputError("fold of a symmetry", got=self.fold, expected="at least 1, or None for continuous")


@dataclass(frozen=True)
class Rim:
    """A circular edge about the part's z, or about an axis parallel to it, computed from the drawing.

    It is ground truth for tests and for the simulated teacher, never for a localizer.

    Attributes:
        name: what a person would call the edge.
        z_m: of the circle's centre.
        radius_m: of the circle.
        side: +1 where the edge is seen from the front, -1 from the back.
        offset_m: distance of its centre from the part's z; the centre of the first copy lies on +x.
        copies: number of equal edges, evenly spaced around z.
    """

    name: str
    z_m: float
    radius_m: float
    side: int
    offset_m: float = 0.0
    copies: int = 1


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Part:
    """An industrial part whose salient feature is a 3D circle.

    Attributes:
        name: one of `PART_NAMES`, or the stem of a mesh file's name.
        diameter_m: nominal diameter of the outline.
        density_kg_m3: of the material.
        rgba: colour of the bare material.
        visual_mesh: OBJ with normals, in metres, in the part frame.
        collision_meshes: convex OBJs, in metres, in the part frame; bores are real holes, small holes are closed.
        mass_kg: from the visual mesh and the density.
        centre_of_mass_m: (3,) in the part frame.
        inertia: (3, 3) in kg m² about the centre of mass, axes of the part frame.
        symmetry: about z.
        grasps: the preferred ones first.
        bore: the central one, where there is one.
        rims: the true circles, for tests and the simulated teacher only, never for a localizer.
    """

    name: str
    diameter_m: float
    density_kg_m3: float
    rgba: tuple[float, float, float, float]
    visual_mesh: Path
    collision_meshes: tuple[Path, ...]
    mass_kg: float
    centre_of_mass_m: Floats
    inertia: Floats
    symmetry: Symmetry
    grasps: tuple[GraspCoordinates, ...]
    bore: BoreCoordinates | None
    rims: tuple[Rim, ...]

    def __post_init__(self) -> None:
        for field in ("centre_of_mass_m", "inertia"):
            object.__setattr__(self, field, np.array(getattr(self, field), dtype=float))
