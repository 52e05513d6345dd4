from __future__ import annotations

import numpy as np
import pytest

from robot.errors import UnreachableError
from robot.gripper_geometry import GripperGeometry
from robot.kinematics import ArmKinematics
from robot.viewpoints import footprint, look_at, reachable_viewpoints, stations
from vision.errors import InputError
from vision.geometry.camera import Camera

CAMERA = Camera.from_lens(0.016, (0.0048, 0.0036), (640, 480))
BIN = np.array([0.75, 0.0, 0.13])


@pytest.mark.parametrize("offset", [(0.2, 0.1, 0.7), (-0.5, 0.1, 1.9), (0.0, -0.5, 1.9)])
def test_a_camera_aims_at_the_target_with_its_x_along_the_bins_long_side(offset: tuple[float, float, float]) -> None:
    pose = look_at(BIN, BIN + offset)
    seen = pose.inv().apply(BIN)
    np.testing.assert_allclose(CAMERA.project(seen)[0], [319.5, 239.5], atol=1e-9)
    assert seen[2] == pytest.approx(np.linalg.norm(offset))
    along = CAMERA.project(pose.inv().apply(BIN + np.array([[0, -0.1, 0], [0, 0.1, 0]])))
    u, v = along[1] - along[0]
    assert u > 0
    assert abs(v) < 0.1 * u


def test_upside_down_is_the_same_axis() -> None:
    pose, flipped = (look_at(BIN, [0.5, 0.3, 1.0], upside_down=flip) for flip in (False, True))
    np.testing.assert_allclose((pose.inv() * flipped).as_matrix(), np.diag([-1.0, -1.0, 1.0, 1.0]), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("distance_m", [0.40, 0.75, 1.9, 2.0])
def test_default_viewpoints_are_reachable(
    kinematics: ArmKinematics, geometry: GripperGeometry, distance_m: float
) -> None:
    views = reachable_viewpoints(kinematics, geometry.T_flange_camera, BIN, distance_m)
    axes = []
    for pose, q in views:
        np.testing.assert_allclose(
            (kinematics.forward(q) * geometry.T_flange_camera).as_matrix(), pose.as_matrix(), atol=1e-5
        )
        np.testing.assert_allclose(pose.inv().apply(BIN), [0, 0, distance_m], atol=1e-9)
        axes.append(pose.rotation.as_matrix()[:, 2])
    angles = np.degrees(np.arccos(np.clip(np.array(axes) @ np.array(axes).T, -1, 1)))[np.triu_indices(3, 1)]
    assert angles.min() > 15


def test_too_far_away_is_said(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    with pytest.raises(UnreachableError, match="0 of"):
        reachable_viewpoints(kinematics, geometry.T_flange_camera, BIN, 3.5)


def test_footprint_is_what_the_camera_sees() -> None:
    x, y = footprint(CAMERA, 1.5)
    assert (x, y) == pytest.approx((0.3375, 0.45))


def test_one_station_where_the_bin_fits() -> None:
    np.testing.assert_array_equal(stations((0.4, 0.54), (0.42, 0.56)), [[0, 0]])


def test_stations_cover_the_bin_with_overlap() -> None:
    bin_size, seen, overlap = np.array([0.4, 0.54]), np.array([0.3, 0.4]), 0.24
    centres = stations(bin_size, seen, overlap)
    for axis in (0, 1):
        steps = np.unique(centres[:, axis].round(9))
        assert steps[0] - seen[axis] / 2 == pytest.approx(-bin_size[axis] / 2)
        assert steps[-1] + seen[axis] / 2 == pytest.approx(bin_size[axis] / 2)
        assert np.diff(steps).max() <= seen[axis] - overlap + 1e-9
    with pytest.raises(InputError, match="overlap"):
        stations(bin_size, seen, 0.35)


def test_bad_input(kinematics: ArmKinematics, geometry: GripperGeometry) -> None:
    with pytest.raises(InputError, match="distance"):
        reachable_viewpoints(kinematics, geometry.T_flange_camera, BIN, 0.0)
    with pytest.raises(InputError, match="at least 1"):
        reachable_viewpoints(kinematics, geometry.T_flange_camera, BIN, 1.0, count=0)
    with pytest.raises(InputError, match="tilt"):
        reachable_viewpoints(kinematics, geometry.T_flange_camera, BIN, 1.0, tilt_rad=2.0)
    with pytest.raises(InputError, match="parallel"):
        look_at([0, 0, 0], [0, 1, 0])
