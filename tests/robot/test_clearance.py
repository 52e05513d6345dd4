from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.clearance import boxes_clearance, points_clearance
from robot.gripper_geometry import Boxes
from vision.errors import InputError

UNIT = Boxes.of((RigidTransform.identity(), (0.5, 0.5, 0.5)))
HERE = np.eye(3)[None]


def box_at(x: float, y: float, z: float, turn_deg: float = 0.0) -> Boxes:
    turn = Rotation.from_euler("z", turn_deg, degrees=True)
    return Boxes.of((RigidTransform.from_components([x, y, z], turn), (0.5, 0.5, 0.5)))


def test_points_outside_and_inside() -> None:
    shifts = np.array([[0.0, 0, 0], [2.0, 0, 0], [1.0, 1.0, 0.0]])
    got = points_clearance(UNIT, np.repeat(HERE, 3, axis=0), shifts, np.zeros((1, 3)))
    np.testing.assert_allclose(got, [-0.5, 1.5, np.hypot(0.5, 0.5)])


def test_points_turn_with_the_tool() -> None:
    bar = Boxes.of((RigidTransform.from_translation([1, 0, 0]), (1.0, 0.1, 0.1)))
    turns = Rotation.from_euler("z", [[0], [90], [180]], degrees=True).as_matrix()
    got = points_clearance(bar, turns, np.zeros((3, 3)), np.array([[0.0, 1.5, 0.0]]))
    np.testing.assert_allclose(got, [1.4, -0.1, 1.4], atol=1e-12)


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        (box_at(1.5, 0, 0), 0.5),
        (box_at(0.7, 0, 0), -0.3),
        (box_at(0, 0, -3), 2.0),
        (box_at(2, 0, 0, turn_deg=45), 1.5 - np.sqrt(0.5)),
    ],
)
def test_box_against_box(other: Boxes, expected: float) -> None:
    np.testing.assert_allclose(boxes_clearance(UNIT, HERE, np.zeros((1, 3)), other), expected, atol=1e-12)


def test_edge_against_edge_needs_the_crossed_axes() -> None:
    """Two square bars crossing edge on edge: their 6 face normals all show an overlap."""
    bars = [
        Boxes.of((RigidTransform.from_rotation(turn), (5.0, 0.5, 0.5)))
        for turn in (Rotation.from_euler("x", 45, degrees=True), Rotation.from_euler("xz", [45, 90], degrees=True))
    ]
    for height in (1.3, 1.5):
        got = boxes_clearance(bars[0], HERE, np.array([[0, 0, height]]), bars[1])
        np.testing.assert_allclose(got, height - np.sqrt(2), atol=1e-9)


def test_bound_is_never_above_the_distance_of_corners() -> None:
    rng = np.random.default_rng(3)
    corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    for _ in range(50):
        turns = Rotation.random(2, rng=rng)
        shift = rng.normal(size=3)
        shift *= 2.5 / np.linalg.norm(shift)
        other = Boxes.of((RigidTransform.from_components(shift, turns[1]), (0.5, 0.5, 0.5)))
        bound = boxes_clearance(UNIT, turns[0].as_matrix()[None], np.zeros((1, 3)), other)[0]
        points = turns[1].apply(corners) + shift
        assert bound <= points_clearance(UNIT, turns[0].as_matrix()[None], np.zeros((1, 3)), points)[0] + 1e-12


def test_what_is_far_is_cut_and_what_is_near_is_the_same() -> None:
    rng = np.random.default_rng(5)
    tool = box_at(0.3, 0, 0).joined(box_at(-1, 0.2, 0, turn_deg=20))
    obstacles = box_at(0, 0, -2).joined(box_at(3, 0, 0, turn_deg=30))
    turns, places = Rotation.random(40, rng=rng).as_matrix(), rng.normal(size=(40, 3))
    exact = boxes_clearance(tool, turns, places, obstacles)
    assert (exact < 0.4).any()
    assert (exact > 0.4).any()
    np.testing.assert_allclose(boxes_clearance(tool, turns, places, obstacles, 0.4), np.minimum(exact, 0.4))


def test_nothing_in_the_way() -> None:
    assert points_clearance(UNIT, HERE, np.zeros((1, 3)), np.zeros((0, 3)))[0] == np.inf
    assert boxes_clearance(UNIT, HERE, np.zeros((1, 3)), Boxes.of())[0] == np.inf


def test_bad_boxes() -> None:
    with pytest.raises(InputError, match="half_sizes"):
        Boxes(np.zeros((2, 3)), np.zeros((2, 3, 3)), np.zeros((1, 3)))
