"""Pictures speak for the right reading of their camera poses, and never against right poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import vision
from vision.errors import InputError
from vision.files.views import load_views
from vision.geometry.pose_reading import AS_GIVEN, READINGS, PoseReading
from vision.geometry.workspace import Workspace

THREE_VIEWS = Path(__file__).resolve().parents[2] / "docs" / "images" / "three_views"
PLATE_RADII_M = (0.008, 0.030)
BOX = Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def written(view, reading):
    """The view with the matrix that somebody would give who means its pose under a reading."""
    M = view.T_world_camera.as_matrix() @ (FLIP if reading.opengl else np.eye(4))
    M = np.linalg.inv(M) if reading.inverted else M
    M[:3, 3] *= 1000 if reading.millimetres else 1
    return replace(view, T_world_camera=M)


@pytest.fixture(scope="module")
def views(photograph, pose):
    return photograph([pose(-33, 0, 0, about=(5, 3, 11)), pose(33, 4, 1, about=(-4, 6, 70))], 3)


@pytest.mark.parametrize("reading", READINGS, ids=str)
def test_a_reading_undoes_what_was_written(views, reading):
    pose = reading.pose(written(views[1], reading).T_world_camera)
    assert np.allclose(pose.as_matrix(), views[1].T_world_camera.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("reading", READINGS[1:], ids=str)
def test_the_reading_that_was_meant_is_named(views, reading):
    check = vision.check_poses([written(view, reading) for view in views], radii_m=PLATE_RADII_M)
    assert check.better == (reading,)
    assert check.shared[reading] >= 10
    assert check.shared[AS_GIVEN] <= check.shared[reading] / 4
    assert f"read as {reading}, {check.shared[reading]} are: {reading.remedy}" in check.complaint


def test_two_views_are_enough(views):
    inverted = PoseReading(inverted=True)
    assert vision.check_poses([written(view, inverted) for view in views[:2]]).better == (inverted,)


def test_remedies_are_what_has_to_be_typed():
    assert PoseReading(inverted=True).remedy == "give inv(M) for each matrix M"
    assert PoseReading(opengl=True).remedy == "give M @ diag(1, -1, -1, 1) for each matrix M"
    assert PoseReading(millimetres=True).remedy == "give each matrix with its translation divided by 1000"
    both = PoseReading(inverted=True, millimetres=True)
    assert both.remedy == "give inv(M) for each matrix M, with its translation divided by 1000"


@pytest.mark.parametrize("radii_m", [PLATE_RADII_M, (0.0005, 2.0), (0.0002, 0.0004), (0.4, 0.9)])
def test_right_poses_stand_whatever_part_is_looked_for(views, radii_m):
    check = vision.check_poses(views, BOX, radii_m)
    assert (check.better, check.remarks, check.complaint) == ((), (), "")


@pytest.mark.parametrize("seed", range(5))
def test_a_bad_calibration_is_not_a_wrong_reading(views, seed):
    rng = np.random.default_rng(seed)
    hand_eye = RigidTransform.from_components(
        rng.normal(scale=2e-3 / 3**0.5, size=3),
        Rotation.from_rotvec(rng.normal(scale=np.radians(0.4) / 3**0.5, size=3)),
    )
    off = [replace(view, T_world_camera=view.T_world_camera * hand_eye) for view in views]
    assert vision.check_poses(off, BOX, PLATE_RADII_M).complaint == ""


def test_views_without_a_common_circle_accuse_nobody(photograph, pose):
    one, other = photograph([pose(-40, 10)], [0])[0], photograph([pose(45, -20, 5, about=(25, 0, 0))], [1])[0]
    for reading in READINGS:
        assert vision.check_poses([written(one, reading), written(other, reading)]).better == ()


def test_empty_pictures_accuse_nobody(views):
    blank = [replace(view, image=np.full_like(view.image, 90)) for view in views]
    assert vision.check_poses(blank, BOX).complaint == ""
    assert vision.check_poses([]).complaint == ""


def test_the_pictures_of_the_document():
    views = load_views(THREE_VIEWS)
    assert vision.check_poses(views).complaint == ""
    reading = PoseReading(inverted=True, opengl=True)
    assert vision.check_poses([written(view, reading) for view in views]).better == (reading,)


def test_a_single_view_far_away_is_worth_a_word(views):
    far = replace(views[0], T_world_camera=RigidTransform.from_translation([750.0, 0, 0]) * views[0].T_world_camera)
    assert "view 0 is 750 m from the world's origin" in vision.check_poses([far]).complaint
    assert vision.check_poses(views[:1], BOX).complaint == ""


@pytest.mark.parametrize("reading", READINGS[1:], ids=str)
def test_a_workspace_that_no_picture_shows_is_worth_a_word(views, reading):
    elsewhere = RigidTransform.from_translation([0.7, -0.2, 0.1])
    view = replace(views[0], T_world_camera=elsewhere * views[0].T_world_camera)
    box = Workspace((0.65, -0.25, 0.07), (0.75, -0.15, 0.13))
    assert vision.check_poses([view], box).complaint == ""
    remark = vision.check_poses([written(view, reading)], box).remarks[-1]
    assert (
        remark
        == f"none of the workspace is in any picture; read as {reading}, it is in all of them: {reading.remedy}"
    )


def test_a_workspace_is_in_the_picture_however_large_or_small_it_is(views):
    for box in (
        Workspace((-9, -9, -9), (9, 9, 9)),
        Workspace((0, 0, 0), (0, 0, 0)),
        Workspace((-5, -5, 0), (5, 5, 0)),
    ):
        assert vision.check_poses(views[:1], box).remarks == ()


def test_cameras_that_look_apart_are_worth_a_word(views):
    blank = [replace(view, image=np.full_like(view.image, 90)) for view in views]
    turned = [written(view, PoseReading(opengl=True)) for view in blank]
    assert "diverge" in vision.check_poses(turned).complaint


@pytest.mark.parametrize("radii_m", [(0.0, 1.0), (0.02, 0.01), (0.01, np.inf)])
def test_impossible_radii_are_refused(views, radii_m):
    with pytest.raises(InputError, match="radii_m"):
        vision.check_poses(views[:1], radii_m=radii_m)
