"""How wide to open past the part itself: plates with known gaps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.grasp_opening import MARGINS_M, copies_in_part, opened_grasps
from robot.gripper_geometry import GripperGeometry
from vision.model.grasp import GraspCoordinates

DOWN = Rotation.from_euler("x", np.pi)
APPROACH_M = 0.05


def plate(x: float, top: float = 0.0, bottom: float = -0.02) -> np.ndarray:
    """Points of an upright plate at x, in m."""
    y, z = (side.ravel() for side in np.meshgrid(np.arange(-0.02, 0.0201, 0.001), np.arange(bottom, top, 0.001)))
    return np.column_stack([np.full(len(y), x), y, z])


def grasp(width: float, kind: str = "outside", depth: float = 0.01) -> GraspCoordinates:
    """Straight down at the origin, the finger ends `depth` below it."""
    pose = RigidTransform.from_components([0, 0, 0.005 - depth], DOWN)
    return GraspCoordinates("grasp", pose, width, kind)  # type: ignore[arg-type]


BLOCK = np.concatenate([plate(-0.005), plate(0.005)])


def test_in_the_open_every_margin_is_room(geometry: GripperGeometry) -> None:
    found = opened_grasps(geometry, [grasp(0.010)], BLOCK, APPROACH_M)
    np.testing.assert_allclose([o.open_width_m for o in found], [0.010 + 2 * m for m in MARGINS_M])
    np.testing.assert_allclose([o.clearance_m for o in found], MARGINS_M, atol=1e-9)
    assert {o.closed_width_m for o in found} == {0.010}


def test_next_to_a_wall_a_wider_opening_is_no_gain(geometry: GripperGeometry) -> None:
    """Between block and wall are 7 mm: with 4 mm of finger, opening by 2 mm leaves 1 mm just as opening by 1 mm."""
    walled = np.concatenate([BLOCK, plate(0.012)])
    best = opened_grasps(geometry, [grasp(0.010)], walled, APPROACH_M)[-1]
    assert best.clearance_m == pytest.approx(0.001, abs=1e-9)
    assert best.open_width_m == pytest.approx(0.012)


def test_a_bore_is_entered_narrow(geometry: GripperGeometry) -> None:
    slot = np.concatenate([plate(-0.02), plate(0.02)])
    found = opened_grasps(geometry, [grasp(0.040, "inside")], slot, APPROACH_M)
    np.testing.assert_allclose([o.clearance_m for o in found], MARGINS_M, atol=1e-9)
    assert found[-1].open_width_m + 2 * geometry.finger_thickness_m == pytest.approx(0.040 - 2 * MARGINS_M[-1])
    assert found[-1].closed_width_m + 2 * geometry.finger_thickness_m == pytest.approx(0.040)


@pytest.mark.parametrize(
    ("taught", "points"),
    [
        (grasp(0.010), np.concatenate([BLOCK, plate(0.0085, top=-0.008)])),  # the fingers' ends would land on it
        (grasp(0.010), np.concatenate([BLOCK, plate(0.007, bottom=0.03, top=0.04)])),  # in the way of the approach
        (grasp(0.010, depth=0.1), BLOCK),  # the palm would hit the block
        (grasp(0.15), BLOCK),  # wider than the gripper
        (grasp(0.007, "inside"), np.zeros((0, 3))),  # two fingers do not fit into it
    ],
)
def test_a_grasp_that_never_clears_the_part_is_left_out(
    geometry: GripperGeometry, taught: GraspCoordinates, points: np.ndarray
) -> None:
    assert opened_grasps(geometry, [taught], points, APPROACH_M) == ()


def test_only_one_of_the_copies_in_the_way_is_enough(geometry: GripperGeometry) -> None:
    once = grasp(0.010)
    twice = GraspCoordinates("twice", once.T_part_tcp, once.width_m, "outside", copies=4)
    assert opened_grasps(geometry, [once], BLOCK, APPROACH_M)
    assert opened_grasps(geometry, [twice], BLOCK, APPROACH_M) == ()


def test_copies_come_with_the_gripper_turned_round() -> None:
    taught = GraspCoordinates("g", RigidTransform.from_components([0.01, 0, 0], DOWN), 0.01, "outside", copies=3)
    poses = copies_in_part(taught)
    assert len(poses) == 6
    np.testing.assert_allclose(poses[0].as_matrix(), taught.T_part_tcp.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(poses.translation, axis=1), 0.01)
    np.testing.assert_allclose(poses[1].translation, poses[0].translation, atol=1e-12)
    opening = poses.rotation.as_matrix()[:, :, 0]
    np.testing.assert_allclose(opening[1], -opening[0], atol=1e-12)
