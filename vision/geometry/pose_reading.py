"""What somebody may have written down as the pose of a camera: its inverse, in other axes, in another unit."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

_AXES = RigidTransform.from_rotation(Rotation.from_matrix(np.diag([1.0, -1.0, -1.0])))


@dataclass(frozen=True)
class PoseReading:
    """One way to read the 4x4 matrix that is given as T_world_camera.

    Attributes:
        inverted: it carries points from the world into the camera's frame, as ``cv2.solvePnP`` gives it.
        opengl: the camera's y points up and its z backward, as in OpenGL and Blender.
        millimetres: its translation is in millimetres.
    """

    inverted: bool = False
    opengl: bool = False
    millimetres: bool = False

    def pose(self, given: RigidTransform) -> RigidTransform:
        """T_world_camera, in metres and OpenCV's axes, if the matrix is read this way."""
        T = given.inv() if self.inverted else given
        T = T * _AXES if self.opengl else T
        scale = 1e-3 if self.millimetres else 1.0
        return RigidTransform.from_components(scale * T.translation, T.rotation)

    def __str__(self) -> str:
        """What is given under this reading, for people."""
        name = "T_camera_world" if self.inverted else "T_world_camera"
        details = [" in OpenGL's axes"] * self.opengl + [" in millimetres"] * self.millimetres
        return name + " and".join(details)

    @property
    def remedy(self) -> str:
        """What to write instead of the matrix M, for people."""
        metres = "its translation divided by 1000" if self.millimetres else ""
        if not (self.inverted or self.opengl):
            return f"give each matrix with {metres}" if metres else "give each matrix as it is"
        formula = ("inv(M)" if self.inverted else "M") + (" @ diag(1, -1, -1, 1)" if self.opengl else "")
        return f"give {formula} for each matrix M" + (f", with {metres}" if metres else "")


AS_GIVEN = PoseReading()
READINGS = tuple(PoseReading(*flags) for flags in product((False, True), repeat=3))
