"""Tipping over: an upright disc goes to its free side, a flat one is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.grasps import Piece
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import HOME_Q, ArmKinematics
from robot.tipping import Tip, plan_tip

RADIUS, HALF = 0.03, 0.008
FLOOR = Boxes.of((RigidTransform.from_translation([0.75, 0, 0.09]), (0.3, 0.3, 0.01)))
turns = np.radians(np.arange(0, 360, 3))
DISC = np.concatenate(
    [
        np.column_stack([r * np.cos(turns), r * np.sin(turns), np.full(len(turns), z)])
        for r in np.linspace(0.002, RADIUS, 8)
        for z in np.linspace(-HALF, HALF, 5)
    ]
)


def disc(x: float, turn: Rotation, z: float) -> Piece:
    return Piece(RigidTransform.from_components([x, 0.0, z], turn), (), DISC)


ON_EDGE = Rotation.from_euler("y", 90, degrees=True)


def tip(kinematics: ArmKinematics, geometry: GripperGeometry, *pieces: Piece) -> Tip | None:
    return plan_tip(kinematics, geometry, pieces, FLOOR, HOME_Q, 0.25)


@pytest.mark.parametrize("neighbour", [-1.0, 1.0])
def test_it_falls_away_from_its_neighbour(
    kinematics: ArmKinematics, geometry: GripperGeometry, neighbour: float
) -> None:
    standing = disc(0.75, ON_EDGE, 0.10 + RADIUS)
    beside = disc(0.75 + neighbour * (2 * HALF + 0.002), ON_EDGE, 0.10 + RADIUS)
    found = tip(kinematics, geometry, standing, beside)
    assert found is not None
    away = -neighbour if found.piece == 0 else neighbour
    assert found.arc[-1][0] * away > 0.01
    assert found.arc[-1][2] < -0.005
    touch = (kinematics.forward(found.approach.q[-1]) * geometry.T_flange_tcp).translation[2] - 0.005
    assert touch > 0.10 + 2 * RADIUS  # still above the edge


def test_what_lies_flat_or_between_others_is_left(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    assert tip(kinematics, geometry, disc(0.75, Rotation.identity(), 0.10 + HALF)) is None
    row = [disc(0.75 + step * (2 * HALF + 0.0005), ON_EDGE, 0.10 + RADIUS) for step in (-1, 0, 1)]
    found = tip(kinematics, geometry, *row)
    assert found is not None
    assert found.piece != 1
