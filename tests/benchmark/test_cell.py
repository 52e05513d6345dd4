"""The running cell: falling, resting, looking, and measuring against the truth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from benchmark.world.cell import WorkCell
from benchmark.world.drop import REST_SPEED_DIAMETERS_S, rim_speeds
from benchmark.world.errors import PhysicsError
from benchmark.world.parts import get_part, vertices
from benchmark.world.scene import cell_config
from benchmark.world.sensor import SENSORS
from robot.viewpoints import reachable_viewpoints
from vision.errors import InputError

SHOPFLOOR = SENSORS["shopfloor"]


@pytest.fixture(scope="module")
def cell() -> Iterator[WorkCell]:
    with WorkCell(cell_config(("cover2",)), SHOPFLOOR) as cell:
        yield cell


@pytest.fixture(scope="module")
def looking(cell: WorkCell) -> Iterator[np.ndarray]:
    """Joint angles from which the camera sees the bin."""
    first, *_ = reachable_viewpoints(
        cell.kinematics, cell.T_flange_camera, cell.config.bin_centre_m, cell.config.camera_distance_m, count=2
    )
    return first.q


def state(cell: WorkCell) -> bytes:
    return b"".join(pose.as_matrix().tobytes() for pose in cell.truth())


def largest_move_m(before: list[RigidTransform], after: list[RigidTransform], radius_m: float) -> float:
    moves = [a.inv() * b for a, b in zip(before, after, strict=True)]
    return max(float(np.linalg.norm(m.translation) + radius_m * m.rotation.magnitude()) for m in moves)


def test_a_seed_decides_on_the_heap_and_the_picture(cell: WorkCell, looking: np.ndarray) -> None:
    def episode(cell: WorkCell, seed: int) -> tuple[object, bytes, bytes, bytes]:
        rng = np.random.default_rng(seed)
        result = cell.drop(rng)
        heap = state(cell)
        cell.move_joints(looking)
        view = cell.capture(rng)
        return result, heap, view.image.tobytes(), view.T_world_camera.as_matrix().tobytes()

    first = episode(cell, 5)
    other = episode(cell, 6)
    assert first[1] != other[1]
    assert first[2] != other[2]
    assert episode(cell, 5) == first  # whatever the cell did before
    with WorkCell(cell.config, cell.sensor) as another:
        assert episode(another, 5) == first


@pytest.mark.parametrize("name", ["hub", "cover1", "cover2"])
def test_pieces_rest_in_the_bin_without_sinking_into_each_other(name: str) -> None:
    with WorkCell(cell_config((name,)), SENSORS["ideal"]) as cell:
        result = cell.drop(np.random.default_rng(1))
        assert result.settled
        assert result.in_bin == (True,) * 4
        mujoco.mj_forward(cell.model, cell.data)
        assert len(cell.data.contact.dist) > 4
        assert cell.data.contact.dist.min() > -1e-3
        for pose in cell.truth():
            low = pose.apply(vertices(get_part(name)))[:, 2].min()
            assert low > cell.config.bin_centre_m[2] - 1e-3


def test_what_is_called_settled_stays_where_it_is(cell: WorkCell) -> None:
    """Run on for a second with nothing allowed to sleep."""
    assert cell.drop(np.random.default_rng(8)).settled
    before = cell.truth()
    cell.model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    mujoco.mj_step(cell.model, cell.data, 500)
    assert largest_move_m(before, cell.truth(), 0.0325) < REST_SPEED_DIAMETERS_S * 0.065


def test_a_falling_piece_is_not_at_rest(cell: WorkCell) -> None:
    speeds = []
    bodies, diameters = [cell.model.body("piece_0").id], np.array([0.065])
    cell.drop(
        np.random.default_rng(2), lambda: speeds.append(rim_speeds(cell.model, cell.data, bodies, diameters).item())
    )
    assert max(speeds) > 0.5
    assert max(speeds[-100:]) < REST_SPEED_DIAMETERS_S * 0.065


def test_a_piece_beside_the_bin_is_recorded_as_such() -> None:
    config = replace(cell_config(("cover2",), pieces=3), bin_size_m=(0.02, 0.02), bin_wall_m=0.002)
    with WorkCell(config, SENSORS["ideal"]) as cell:
        result = cell.drop(np.random.default_rng(0))
        assert len(result.in_bin) == 3
        assert not all(result.in_bin)
        lying_low = np.array([pose.translation[2] < config.bin_centre_m[2] for pose in cell.truth()])
        assert lying_low.any()
        assert not np.array(result.in_bin)[lying_low].any()


def test_arm_arrives_and_leaves_the_pieces_alone(cell: WorkCell, looking: np.ndarray) -> None:
    cell.drop(np.random.default_rng(3))
    before = cell.truth()
    cell.move_joints(looking)
    target = cell.kinematics.forward(looking) * cell.T_flange_camera
    off = target.inv() * cell.camera_truth()
    assert np.linalg.norm(off.translation) < 1e-4
    assert off.rotation.magnitude() < np.deg2rad(0.01)
    assert largest_move_m(before, cell.truth(), 0.0325) < 1e-5


def test_view_knows_its_pose_up_to_the_calibration_error(cell: WorkCell, looking: np.ndarray) -> None:
    rng = np.random.default_rng(0)
    cell.drop(rng)
    cell.move_joints(looking)
    errors = [cell.camera_truth().inv() * cell.capture(rng).T_world_camera for _ in range(3)]
    lengths = [np.linalg.norm(error.translation) for error in errors]
    assert all(1e-5 < length < 2e-3 for length in lengths)
    turns = [error.rotation.magnitude() for error in errors]
    assert 1e-4 < turns[0] < 1e-2  # the arm's own errors have no turn: this is the mounting's,
    assert np.ptp(turns) < 1e-9  # one per episode
    assert np.ptp(lengths) > 1e-6  # one positioning error per view
    with WorkCell(cell.config, SENSORS["lab"]) as exact:
        exact.drop(rng)
        exact.move_joints(looking)
        error = exact.camera_truth().inv() * exact.capture(rng).T_world_camera
        assert np.linalg.norm(error.translation) < 1e-5


def test_mask_of_a_piece_is_where_its_vertices_project_to(cell: WorkCell, looking: np.ndarray) -> None:
    cell.drop(np.random.default_rng(4))
    cell.move_joints(looking)
    visibility = cell.visibility()
    for pose, name, mask in zip(cell.truth(), cell.config.piece_parts, visibility.total_masks, strict=True):
        points = (cell.camera_truth().inv() * pose).apply(vertices(get_part(name)))
        pixels = cell.camera.project(points)
        rows, columns = np.nonzero(
            mask
        )  # drawn where the centre of a pixel is covered, so never beyond; a thin tip may be missing
        for seen, projected, size in ((columns, pixels[:, 0], 640), (rows, pixels[:, 1], 480)):
            low, high = max(projected.min(), 0), min(projected.max(), size - 1)
            assert -0.5 <= seen.min() - low <= 1.5
            assert -0.5 <= high - seen.max() <= 1.5


def test_visible_pixels_are_a_part_of_all_pixels(cell: WorkCell, looking: np.ndarray) -> None:
    cell.drop(np.random.default_rng(4))
    cell.move_joints(looking)
    picture = cell.render()
    visibility = cell.visibility()
    assert not (visibility.visible_masks & ~visibility.total_masks).any()
    assert visibility.visible_masks.sum(axis=0).max() == 1  # a pixel shows one piece
    assert (visibility.fraction > 0.3).any()
    assert (visibility.fraction <= 1).all()
    assert np.array_equal(cell.render(), picture)  # measuring leaves the picture as it was


def test_marks_show_on_surfaces_of_the_cell_they_belong_to(cell: WorkCell, looking: np.ndarray) -> None:
    with WorkCell(cell.config, SENSORS["lab"]) as clean:
        roughness = []
        for each in (cell, clean):
            each.drop(np.random.default_rng(4))
            each.move_joints(looking)
            picture = each.render().astype(float).mean(axis=2)
            floor = ~each.visibility().total_masks.any(axis=0)
            roughness.append(np.median(np.abs(np.diff(picture, axis=1))[floor[:, 1:]]))
    assert roughness[1] < 0.5 < roughness[0]


def test_overview_is_bright_and_leaves_no_trace(cell: WorkCell, looking: np.ndarray) -> None:
    cell.drop(np.random.default_rng(4))
    cell.move_joints(looking)
    before = cell.render()
    overview = cell.overview(320, 240)
    assert overview.shape == (240, 320, 3)
    assert overview.mean() > 60
    assert np.array_equal(cell.render(), before)


def test_a_picture_before_the_first_drop_is_refused() -> None:
    with (
        WorkCell(cell_config(("cover1",), pieces=1), SENSORS["ideal"]) as cell,
        pytest.raises(InputError, match="drop"),
    ):
        cell.capture(np.random.default_rng(0))


@pytest.mark.parametrize("fault", ["gives up", "diverges"])
def test_physics_that_cannot_go_on_says_so(cell: WorkCell, monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    cell.drop(np.random.default_rng(1))
    if fault == "gives up":

        def give_up(*_: object) -> None:
            raise mujoco.FatalError("mj_stackAlloc: out of memory")

        monkeypatch.setattr(mujoco, "mj_step", give_up)
    else:
        cell.data.qvel[:] = 1e12
    with pytest.raises(PhysicsError, match="physics: got"):
        cell.step(3)
