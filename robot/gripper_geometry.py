"""The gripper's shape and frames, for planning: read from its MJCF, so that no number stands twice."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from robot.arm import SCENES, find
from vision.errors import InputError
from vision.frozen import frozen_arrays

Array = NDArray[np.float64]

PARALLEL_GRIPPER = SCENES / "gripper.xml"


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Boxes:
    """Solid boxes in one frame.

    Attributes:
        centres: (N, 3) in m.
        rotations: (N, 3, 3), the columns are the boxes' axes.
        half_sizes: (N, 3) in m.
    """

    centres: Array
    rotations: Array
    half_sizes: Array

    def __post_init__(self) -> None:
        count = len(self.centres)
        for name, shape in (("centres", (count, 3)), ("rotations", (count, 3, 3)), ("half_sizes", (count, 3))):
            values = np.array(getattr(self, name), dtype=float)
            if values.shape != shape or not np.isfinite(values).all():
                raise InputError(f"{name} of boxes", got=values.shape, expected=f"finite numbers of shape {shape}")
            object.__setattr__(self, name, values)

    def __len__(self) -> int:
        return len(self.centres)

    @classmethod
    def of(cls, *boxes: tuple[RigidTransform, tuple[float, float, float]]) -> Boxes:
        """From (pose, half sizes) pairs."""
        poses = [pose for pose, _ in boxes]
        return cls(
            np.array([pose.translation for pose in poses]).reshape(-1, 3),
            np.array([pose.rotation.as_matrix() for pose in poses]).reshape(-1, 3, 3),
            np.array([half for _, half in boxes]).reshape(-1, 3),
        )

    def moved(self, pose: RigidTransform) -> Boxes:
        """The boxes under a rigid motion."""
        turn = pose.rotation.as_matrix()
        return Boxes(self.centres @ turn.T + pose.translation, turn @ self.rotations, self.half_sizes)

    def joined(self, other: Boxes) -> Boxes:
        """These boxes and the other ones, in the same frame."""
        pairs = zip(
            (self.centres, self.rotations, self.half_sizes),
            (other.centres, other.rotations, other.half_sizes),
            strict=True,
        )
        return Boxes(*(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True, eq=False)
class GripperGeometry:
    """Frames and collision shape of a parallel gripper with a wrist camera.

    Attributes:
        T_flange_tcp: the tool centre point on the flange (z approach, x opening direction).
        T_flange_camera: the wrist camera on the flange, OpenCV axes.
        palm: everything that does not move, in the tcp frame.
        left: the finger on the +x side in the tcp frame, fingers closed.
        right: the finger on the -x side.
        finger_thickness_m: of a tip, in the opening direction.
        max_width_m: largest gap between the fingers' inner faces.
    """

    T_flange_tcp: RigidTransform
    T_flange_camera: RigidTransform
    palm: Boxes
    left: Boxes
    right: Boxes
    finger_thickness_m: float
    max_width_m: float

    @classmethod
    def from_mjcf(cls, path: Path = PARALLEL_GRIPPER) -> GripperGeometry:
        """Read the gripper's own MJCF.

        Args:
            path: a file with bodies ``finger_left`` and ``finger_right`` sliding along x, geoms ``*_tip``, and sites
                ``tcp`` and ``wrist_camera_mount``.

        Raises:
            InputError: when the file or one of those is missing.
        """
        if not Path(path).is_file():
            raise InputError("gripper MJCF", got=f"{str(path)!r}", expected="an existing file")
        model = mujoco.MjModel.from_xml_path(str(path))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        T_flange_tcp = _site(model, data, "tcp")
        fingers = [find(model, mujoco.mjtObj.mjOBJ_BODY, f"finger_{side}") for side in ("left", "right")]
        solid = [int(geom) for geom in np.flatnonzero(model.geom_conaffinity)]
        palm, left, right = (
            _boxes(model, data, [g for g in solid if owner(int(model.geom_bodyid[g]))]).moved(T_flange_tcp.inv())
            for owner in (lambda b: b not in fingers, lambda b: b == fingers[0], lambda b: b == fingers[1])
        )
        tip = find(model, mujoco.mjtObj.mjOBJ_GEOM, "finger_left_tip")
        joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, f"finger_{side}") for side in ("left", "right")]
        return cls(
            T_flange_tcp,
            _site(model, data, "wrist_camera_mount"),
            palm,
            left,
            right,
            finger_thickness_m=float(2 * model.geom_size[tip, 0]),
            max_width_m=float(model.jnt_range[joints, 1].sum()),
        )

    def boxes(self, width_m: float) -> Boxes:
        """The whole gripper in the tcp frame at a gap between the fingers in m."""
        aside = [RigidTransform.from_translation([side * width_m / 2, 0.0, 0.0]) for side in (1.0, -1.0)]
        return self.palm.joined(self.left.moved(aside[0])).joined(self.right.moved(aside[1]))


def _site(model: Any, data: Any, name: str) -> RigidTransform:
    site = find(model, mujoco.mjtObj.mjOBJ_SITE, name)
    return RigidTransform.from_components(
        data.site_xpos[site], Rotation.from_matrix(data.site_xmat[site].reshape(3, 3))
    )


def _boxes(model: Any, data: Any, geoms: list[int]) -> Boxes:
    """The geoms' own bounding boxes: exact for boxes, circumscribed for cylinders and meshes."""
    rotations = data.geom_xmat[geoms].reshape(-1, 3, 3)
    offsets = np.einsum("nij,nj->ni", rotations, model.geom_aabb[geoms, :3])
    return Boxes(data.geom_xpos[geoms] + offsets, rotations, model.geom_aabb[geoms, 3:])
