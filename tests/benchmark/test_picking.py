"""Picking for real: physics alone holds the piece."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from benchmark.episodes.cells import workspace
from benchmark.localizers.oracle import Oracle
from benchmark.models import load_model
from benchmark.tasks.bench import Workbench
from benchmark.tasks.clock import Clock
from benchmark.tasks.memory import Belief
from benchmark.tasks.part_shape import opened_grasps_of
from benchmark.world.cell import WorkCell
from benchmark.world.grasps import grasps_of
from benchmark.world.parts import PART_NAMES, get_part, vertices
from benchmark.world.scene import cell_config
from benchmark.world.sensor import SENSORS
from robot.gripper_geometry import PARALLEL_GRIPPER
from robot.viewpoints import reachable_viewpoints
from vision.pose.estimate import PoseEstimate


@pytest.fixture(scope="module", params=PART_NAMES)
def cell(request: pytest.FixtureRequest) -> Iterator[WorkCell]:
    with WorkCell(cell_config((request.param,)), SENSORS["ideal"]) as cell:
        yield cell


def look(cell: WorkCell) -> None:
    """Move the arm to where it takes the last picture from."""
    config = cell.config
    viewpoints = reachable_viewpoints(
        cell.kinematics, cell.T_flange_camera, config.bin_centre_m, config.camera_distance_m, count=2
    )
    cell.move_joints(viewpoints[-1].q)


def exactly(cell: WorkCell, *poses: RigidTransform) -> tuple[PoseEstimate, ...]:
    part = cell.config.part_names[0]
    return tuple(PoseEstimate(part, pose, 1e-12 * np.eye(6), 1.0, "oracle", 0.0, 3, True) for pose in poses)


def bench_of(cell: WorkCell, on_step: Callable[[], None] | None = None) -> Workbench:
    return Workbench(cell, Oracle(tuple), workspace(cell.config), np.random.default_rng(0), Clock(), on_step=on_step)


def believed(cell: WorkCell, *poses: RigidTransform) -> Belief:
    return Belief().seen(exactly(cell, *poses), get_part(cell.config.part_names[0]).diameter_m)


def robot_contacts(cell: WorkCell) -> set[str]:
    """Names of the bodies that arm and gripper touch."""
    pairs = cell.model.geom_bodyid[cell.data.contact.geom]
    names = [[cell.model.body(body).name for body in pair] for pair in pairs]
    return {
        other
        for pair in names
        for one, other in (pair, pair[::-1])
        if one.startswith("arm/") and not other.startswith("arm/")
    }


@pytest.mark.sweep
def test_a_piece_travels_from_the_bin_to_the_tray_and_nothing_else_is_touched(cell: WorkCell) -> None:
    cell.drop(np.random.default_rng(4))
    look(cell)
    before, touched = cell.truth(), set[str]()
    bench = bench_of(cell, lambda: touched.update(robot_contacts(cell)))
    belief = believed(cell, *before)
    outcome, after = bench.pick(belief, bench.plan(belief))
    assert outcome.stage is None
    assert (len(after.known), len(after.placed)) == (len(before) - 1, 1)
    # The estimates are in the order of the pieces.
    assert outcome.estimate is not None
    assert touched == {f"piece_{outcome.estimate}"}
    assert robot_contacts(cell) == set()
    # Where it lies is asked of the simulator, not of the picker.
    points = vertices(get_part(cell.config.part_names[0]))
    matrix = cell.truth()[outcome.estimate].as_matrix()
    lowest = points @ matrix[2, :3] + matrix[2, 3] - cell.config.tray_centre_m[2]
    assert lowest.min() == pytest.approx(0, abs=1e-3)
    offset = matrix[:2, 3] - cell.config.tray_centre_m[:2]
    assert (np.abs(offset) < np.array(cell.config.tray_size_m) / 2).all()


@pytest.mark.slow
def test_every_place_in_the_bin_can_be_brought_to_the_tray(cell: WorkCell) -> None:
    look(cell)
    config, part = cell.config, get_part(cell.config.part_names[0])
    bench, half_height = bench_of(cell), float(vertices(part)[:, 2].max())
    room = np.maximum(np.array(config.bin_size_m) / 2 - 0.5 * part.diameter_m - 0.01, 0)
    for x, y in ((0, 0), (1, 1), (-1, 1), (1, -1), (-1, -1)):
        for turn in (Rotation.identity(), Rotation.from_euler("x", np.pi)):
            place = config.bin_centre_m + np.array([x * room[0], y * room[1], half_height])
            choice = bench.plan(believed(cell, RigidTransform.from_components(place, turn)))
            assert choice.plan is not None, (x, y, choice.rejected)


@pytest.mark.slow
def test_no_grasp_is_a_value(cell: WorkCell) -> None:
    look(cell)
    q = cell.arm.joint_positions
    sunk = RigidTransform.from_translation(np.array(cell.config.bin_centre_m) - [0, 0, 0.2])
    bench = bench_of(cell)
    for poses, stage in (((), "localize"), ((sunk,), "plan")):
        belief = believed(cell, *poses)
        outcome, after = bench.pick(belief, bench.plan(belief))
        assert (outcome.stage, outcome.estimate) == (stage, None)
        assert bool(outcome.rejected) == bool(poses)
        assert after is belief
    np.testing.assert_array_equal(cell.arm.joint_positions, q)


@pytest.mark.parametrize("part", PART_NAMES)
def test_every_taught_grasp_lets_the_true_gripper_past_the_part(part: str) -> None:
    opened = opened_grasps_of(part, PARALLEL_GRIPPER, approach_m=0.06)
    room = {o.grasp.name: o.clearance_m for o in opened}
    assert list(room) == [grasp.name for grasp in load_model(part).grasps]
    assert min(room.values()) > 0.0008


@pytest.mark.parametrize("part", PART_NAMES)
def test_the_taught_grasps_are_those_of_the_drawing(part: str) -> None:
    taught, drawn = load_model(part).grasps, grasps_of(part)
    assert [(g.name, g.kind, g.copies) for g in taught] == [(g.name, g.kind, g.copies) for g in drawn]
    for one, other in zip(taught, drawn, strict=True):
        assert one.width_m == pytest.approx(other.width_m)
        np.testing.assert_allclose(one.T_part_tcp.as_matrix(), other.T_part_tcp.as_matrix(), atol=1e-6)
