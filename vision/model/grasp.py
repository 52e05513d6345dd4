"""Where a part may be held, and the bore that a peg goes into: a person teaches them, the robot plans with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError

GraspKind = Literal["outside", "inside"]


def turns_about_z(count: int) -> Rotation:
    """Stack of ``count`` equally spaced rotations about z, the identity first."""
    angles = np.arange(count) * 2 * np.pi / count
    return Rotation.from_rotvec(angles[:, None] * [0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class GraspCoordinates:
    """Where the gripper may take the part (Fig. 2 b).

    Attributes:
        name: label.
        T_part_tcp: pose of the tool centre point: z approaches, x is the direction in which the fingers open.
        width_m: gap between the fingers at contact ("outside"), or distance of their outer faces ("inside").
        kind: close on the outside, or open in a bore.
        copies: number of equally good rotations about the part's axis.
    """

    name: str
    T_part_tcp: RigidTransform
    width_m: float
    kind: GraspKind
    copies: int = 1

    def __post_init__(self) -> None:
        if self.kind not in ("outside", "inside"):
            raise InputError(f"kind of grasp {self.name}", got=self.kind, expected="outside or inside")
        if not self.width_m > 0 or self.copies < 1:
            raise InputError(
                f"grasp {self.name}", got=f"width {self.width_m} m, {self.copies} copies", expected="both above zero"
            )

    def poses(self) -> RigidTransform:
        """T_part_tcp of all copies: a stack of `copies` poses, this one first."""
        return RigidTransform.from_rotation(turns_about_z(self.copies)) * self.T_part_tcp


@dataclass(frozen=True, eq=False)
class BoreCoordinates:
    """The bore for peg-in-hole.

    Attributes:
        T_part_bore: the origin is the centre of the entry rim, z points into the bore.
        diameter_m: of the cylinder.
        depth_m: from the entry rim to the exit rim, chamfers included.
    """

    T_part_bore: RigidTransform
    diameter_m: float
    depth_m: float
