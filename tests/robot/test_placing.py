"""Putting down: where there is room, as flat as the arm can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.grasp_opening import opened_grasps
from robot.grasping import plan_grasp
from robot.grasps import GraspParameters, GraspPlan, Piece
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import HOME_Q, ArmKinematics
from robot.placing import PlaceParameters, Tray, plan_placing
from vision.model.grasp import GraspCoordinates

RADIUS, HALF_HEIGHT = 0.03, 0.01
FLOOR_Z = 0.10
turns = np.radians(np.arange(0, 360, 6))
circle = np.column_stack([np.cos(turns), np.sin(turns)])
DISC = np.concatenate(
    [
        np.column_stack([r * circle, np.full(len(circle), z)])
        for r in (RADIUS, RADIUS / 2)
        for z in (-HALF_HEIGHT, 0, HALF_HEIGHT)
    ]
)
FROM_ABOVE = GraspCoordinates("above", RigidTransform.from_rotation(Rotation.from_euler("x", np.pi)), 0.06, "outside")
TRAY = Tray(np.array([0.40, -0.60, FLOOR_Z]), np.array([0.30, 0.20]), Boxes.of())


@pytest.fixture(scope="module")
def plan(kinematics: ArmKinematics, geometry: GripperGeometry) -> GraspPlan:
    """Of a disc that leans by 30 degrees."""
    lying = RigidTransform.from_components([0.75, 0.0, 0.15], Rotation.from_euler("x", 30, degrees=True))
    piece = Piece(lying, opened_grasps(geometry, [FROM_ABOVE], DISC, 0.05), DISC)
    chosen = plan_grasp(kinematics, geometry, [piece], Boxes.of(), HOME_Q, GraspParameters(free_height_m=0.3)).plan
    assert chosen is not None
    return chosen


def spot(tray: Tray, kinematics: ArmKinematics, geometry: GripperGeometry, plan: GraspPlan) -> np.ndarray:
    choice = plan_placing(kinematics, geometry, plan, DISC, tray)
    assert choice.placing is not None, choice.rejected
    return np.asarray(choice.placing.T_world_part.translation)


def test_what_was_taken_leaning_is_laid_down_flat(
    kinematics: ArmKinematics, geometry: GripperGeometry, plan: GraspPlan
) -> None:
    placing = plan_placing(kinematics, geometry, plan, DISC, TRAY).placing
    assert placing is not None
    assert placing.flat
    assert abs(placing.T_world_part.rotation.as_matrix()[2, 2]) == pytest.approx(1, abs=1e-6)
    lowest = placing.T_world_part.apply(DISC)[:, 2].min()
    assert lowest == pytest.approx(FLOOR_Z + PlaceParameters().release_m, abs=1e-6)
    ends = kinematics.forward(placing.lower.q[-1]) * geometry.T_flange_tcp * plan.T_tcp_part
    np.testing.assert_allclose(ends.as_matrix(), placing.T_world_part.as_matrix(), atol=1e-4)
    np.testing.assert_allclose(placing.carry[0].q[0], plan.lift.q[-1])


def test_spots_are_in_the_tray_and_apart_until_it_is_full(
    kinematics: ArmKinematics, geometry: GripperGeometry, plan: GraspPlan
) -> None:
    tray, spots = TRAY, list[np.ndarray]()
    for _ in range(4):
        spots.append(spot(tray, kinematics, geometry, plan))
        lying = np.concatenate([tray.taken, DISC + spots[-1] * [1, 1, 0] + [0, 0, FLOOR_Z + HALF_HEIGHT]])
        tray = replace(tray, taken=lying)
    inside = np.abs(np.array(spots)[:, :2] - TRAY.centre[:2]) + RADIUS
    assert (inside <= TRAY.size_m / 2).all()
    apart = [np.linalg.norm((a - b)[:2]) for i, a in enumerate(spots) for b in spots[:i]]
    assert min(apart) > 2 * RADIUS
    x, y = np.meshgrid(np.linspace(-0.15, 0.15, 60), np.linspace(-0.1, 0.1, 40))
    covered = np.column_stack([x.ravel() + 0.40, y.ravel() - 0.60, np.full(x.size, FLOOR_Z)])
    choice = plan_placing(kinematics, geometry, plan, DISC, replace(TRAY, taken=covered))
    assert choice.placing is None
    assert choice.rejected["no room"] > 0


def test_a_wall_in_the_way_of_carrying_is_carried_over(
    kinematics: ArmKinematics, geometry: GripperGeometry, plan: GraspPlan
) -> None:
    """Between bin and tray, as high as the lifted piece hangs."""
    top = float(plan.T_world_lift.translation[2])
    wall = Boxes.of((RigidTransform.from_translation([0.60, -0.28, top / 2]), (0.25, 0.02, top / 2)))
    free = plan_placing(kinematics, geometry, plan, DISC, TRAY).placing
    over = plan_placing(kinematics, geometry, plan, DISC, replace(TRAY, walls=wall)).placing
    assert free is not None
    assert over is not None
    assert (len(free.carry), len(over.carry)) == (1, 2)
    assert over.T_world_above.translation[2] > free.T_world_above.translation[2] + 0.05
