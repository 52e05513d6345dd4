from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from robot.grasp_opening import MARGINS_M, opened_grasps
from robot.grasping import covered_share, plan_grasp
from robot.grasps import GraspParameters, GraspPlan, OpenedGrasp, Piece
from robot.gripper_geometry import Boxes, GripperGeometry
from robot.kinematics import HOME_Q, ArmKinematics
from vision.errors import InputError
from vision.model.grasp import GraspCoordinates

DOWN = Rotation.from_euler("x", np.pi)
FLOOR_Z = 0.10


def cylinder_points(radius: float, half_height: float) -> np.ndarray:
    angles = np.radians(np.arange(0, 360, 6))
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    rims = [
        np.column_stack([r * circle, np.full(len(circle), z)])
        for z in (-half_height, half_height)
        for r in (radius, radius / 2)
    ]
    return np.concatenate([*rims, np.column_stack([radius * circle, np.zeros(len(circle))])])


COVER = cylinder_points(0.0325, 0.02)
(*_, OUTSIDE), (*_, INSIDE) = (
    opened_grasps(
        GripperGeometry.from_mjcf(),
        [GraspCoordinates("any", RigidTransform.from_rotation(DOWN), width, kind, copies=12)],
        COVER,
        0.1,
    )
    for kind, width in (("outside", 0.065), ("inside", 0.064))
)


def cover(
    x: float, y: float, *grasps: OpenedGrasp, turn: Rotation | None = None, z: float = FLOOR_Z + 0.021
) -> Piece:
    pose = RigidTransform.from_components([x, y, z], Rotation.identity() if turn is None else turn)
    return Piece(pose, grasps, COVER)


def bin_boxes(half_x: float, half_y: float, wall: float, centre: tuple[float, float] = (0.75, 0.0)) -> Boxes:
    cx, cy = centre
    at = RigidTransform.from_translation
    middle = FLOOR_Z + wall / 2
    return Boxes.of(
        (at([cx, cy, FLOOR_Z - 0.01]), (half_x + 0.02, half_y + 0.02, 0.01)),
        (at([cx + half_x + 0.005, cy, middle]), (0.005, half_y, wall / 2)),
        (at([cx - half_x - 0.005, cy, middle]), (0.005, half_y, wall / 2)),
        (at([cx, cy + half_y + 0.005, middle]), (half_x, 0.005, wall / 2)),
        (at([cx, cy - half_y - 0.005, middle]), (half_x, 0.005, wall / 2)),
    )


BIN = bin_boxes(0.0785, 0.105, 0.05)


def test_a_lone_piece_is_taken_straight_down(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    choice = plan_grasp(kinematics, geometry, [cover(0.75, 0.0, OUTSIDE)], BIN, HOME_Q)
    plan = choice.plan
    assert plan is not None
    assert plan.tilt_rad == pytest.approx(0, abs=1e-6)
    assert plan.grasp.open_width_m == pytest.approx(0.065 + 2 * MARGINS_M[-1])
    assert plan.clearance_m > GraspParameters().min_clearance_m
    for q, pose in [
        (plan.q_pregrasp, plan.T_world_pregrasp),
        (plan.q_grasp, plan.T_world_tcp),
        (plan.lift.q[-1], plan.T_world_lift),
    ]:
        reached = kinematics.forward(q) * geometry.T_flange_tcp
        np.testing.assert_allclose(reached.as_matrix(), pose.as_matrix(), atol=1e-5)
    np.testing.assert_array_equal(plan.approach.q[-1], plan.lift.q[0])
    rise = plan.T_world_lift.translation - plan.T_world_tcp.translation
    np.testing.assert_allclose(rise, [0, 0, GraspParameters().lift_m], atol=1e-12)


def test_inside_grip_enters_narrower_than_the_bore(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    choice = plan_grasp(kinematics, geometry, [cover(0.75, 0.0, INSIDE)], BIN, HOME_Q)
    assert choice.plan is not None
    outer = choice.plan.grasp.open_width_m + 2 * geometry.finger_thickness_m
    assert outer == pytest.approx(0.064 - 2 * MARGINS_M[-1])


def test_fingers_avoid_the_neighbours(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    """Neighbours close by in +-x leave only the grasps that open along y."""
    pieces = [cover(0.75, 0, OUTSIDE), cover(0.75 + 0.067, 0), cover(0.75 - 0.067, 0)]
    wide = bin_boxes(0.2, 0.2, 0.05)
    choice = plan_grasp(kinematics, geometry, pieces, wide, HOME_Q)
    assert choice.plan is not None
    opening = choice.plan.T_world_tcp.rotation.as_matrix()[:, 0]
    assert abs(opening[1]) > 0.85
    assert choice.rejected["collision"] > 0


def test_a_walled_in_piece_has_no_grasp(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    choice = plan_grasp(kinematics, geometry, [cover(0.75, 0, OUTSIDE)], bin_boxes(0.035, 0.035, 0.05), HOME_Q)
    assert choice.plan is None
    assert choice.rejected == {"collision": 24}


def test_the_free_piece_is_preferred(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    stack = [cover(0.70, 0, OUTSIDE), cover(0.70, 0.0, OUTSIDE, z=FLOOR_Z + 0.062)]
    choice = plan_grasp(kinematics, geometry, stack, BIN, HOME_Q)
    assert choice.plan is not None
    assert choice.plan.piece == 1


def test_reasons(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    upside_down = cover(0.75, 0, OUTSIDE, turn=DOWN)
    assert plan_grasp(kinematics, geometry, [upside_down], BIN, HOME_Q).rejected == {"too tilted": 24}
    buried = [cover(0.75, 0, OUTSIDE), cover(0.75, 0, z=FLOOR_Z + 0.062)]
    assert plan_grasp(kinematics, geometry, buried, BIN, HOME_Q).rejected == {"under other pieces": 1}
    far = plan_grasp(kinematics, geometry, [cover(2.5, 0, OUTSIDE)], Boxes.of(), HOME_Q, GraspParameters(max_tries=2))
    assert far.plan is None
    assert far.rejected == {"out of reach": 2, "not tried": 22}
    assert plan_grasp(kinematics, geometry, [], BIN, HOME_Q).plan is None


def test_a_piece_out_of_reach_takes_no_tries_from_the_others(
    kinematics: ArmKinematics, geometry: GripperGeometry
) -> None:
    near = Piece(cover(0.75, 0).T_world_part, (OUTSIDE,), COVER, confidence=0.1)
    choice = plan_grasp(
        kinematics, geometry, [cover(2.5, 0, OUTSIDE), near], Boxes.of(), HOME_Q, GraspParameters(max_tries=2)
    )
    assert choice.plan is not None
    assert choice.plan.piece == 1
    assert choice.rejected_by_piece[0]["out of reach"] == 2


def test_a_plan_of_no_use_gives_way_to_the_next(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    offered: list[GraspPlan] = []

    def only_the_third(plan: GraspPlan) -> str | None:
        offered.append(plan)
        return "carry it away" if len(offered) == 3 else None

    pieces = [cover(0.75, 0.0, OUTSIDE)]
    choice = plan_grasp(kinematics, geometry, pieces, BIN, HOME_Q, finish=only_the_third)
    assert choice.plan is offered[2]
    assert choice.rest == "carry it away"
    assert choice.rejected == {"of no use": 2}
    poses = {plan.T_world_tcp.as_matrix().round(9).tobytes() for plan in offered}
    assert len(poses) == 3


def test_the_surer_pose_is_preferred(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    sure, vague = cover(0.72, 0.05, OUTSIDE), cover(0.78, -0.05, OUTSIDE)
    vague = Piece(vague.T_world_part, vague.grasps, vague.points_part, confidence=0.3)
    for pieces, best in (([sure, vague], 0), ([vague, sure], 1)):
        plan = plan_grasp(kinematics, geometry, pieces, BIN, HOME_Q).plan
        assert plan is not None
        assert plan.piece == best


def test_covered_share_is_what_is_seen_from_above() -> None:
    x, y = (side.ravel() for side in np.meshgrid(np.linspace(0, 0.1, 81), np.linspace(0, 0.1, 81)))
    plate = np.column_stack([x, y, np.zeros(len(x))])
    over_a_quarter = plate * [0.5, 0.5, 1] + [0, 0, 0.01]
    assert covered_share(plate, over_a_quarter) == pytest.approx(0.25, abs=0.05)
    assert covered_share(plate, over_a_quarter - [0, 0, 0.02]) == 0
    assert covered_share(plate, plate + np.array([0.2, 0, 0.01])) == 0
    assert covered_share(plate, np.zeros((0, 3))) == 0


def test_tilted_piece_is_taken_along_its_axis(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    turn = Rotation.from_euler("x", 25, degrees=True)
    choice = plan_grasp(kinematics, geometry, [cover(0.75, 0, OUTSIDE, turn=turn, z=0.16)], BIN, HOME_Q)
    assert choice.plan is not None
    assert np.degrees(choice.plan.tilt_rad) == pytest.approx(25)
    retreat = choice.plan.T_world_pregrasp.translation - choice.plan.T_world_tcp.translation
    np.testing.assert_allclose(retreat, choice.plan.grasp.approach_m * turn.apply([0, 0, 1]), atol=1e-9)
    assert choice.plan.grasp.approach_m == pytest.approx(0.02 + 0.005 + 0.008)  # half the piece, the ends, and room


def test_above_the_free_height_the_way_goes_straight_down(
    kinematics: ArmKinematics, geometry: GripperGeometry
) -> None:
    turn, free = Rotation.from_euler("x", 25, degrees=True), GraspParameters(free_height_m=0.25)
    plan = plan_grasp(kinematics, geometry, [cover(0.75, 0, OUTSIDE, turn=turn, z=0.16)], BIN, HOME_Q, free).plan
    assert plan is not None
    assert plan.T_world_pregrasp.translation[2] == pytest.approx(0.25)
    places = [(kinematics.forward(q) * geometry.T_flange_tcp).translation for q in plan.approach.q[::50]]
    axis = turn.apply([0, 0, 1])
    off_axis = [np.linalg.norm(np.cross(place - plan.T_world_tcp.translation, axis)) for place in places]
    aside = [np.hypot(*(place - plan.T_world_pregrasp.translation)[:2]) for place in places]
    assert min(aside[0], off_axis[-1]) < 1e-4
    assert max(map(min, zip(off_axis, aside, strict=True))) < 0.004  # the corner is cut by no more
    assert plan.approach.qd[0] == pytest.approx(0)
    assert np.abs(plan.approach.qd[len(plan.approach) // 2]).max() > 0.01  # no stop on the way


def test_values_survive_pickling_and_refuse_nonsense() -> None:
    piece = pickle.loads(pickle.dumps(cover(0.75, 0, OUTSIDE)))
    assert piece.grasps[0].grasp.kind == "outside"
    assert not piece.points_part.flags.writeable
    with pytest.raises(InputError, match="outside or inside"):
        GraspCoordinates("x", RigidTransform.identity(), 0.01, "sideways")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="above zero"):
        GraspCoordinates("x", RigidTransform.identity(), 0.0, "outside")
