"""The sampled model: on its circles, facing the camera, and tallied in one pass as in two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from vision.edges.edge_field import EdgeField, StackedEdges
from vision.geometry.camera import camera_arrays
from vision.geometry.circle import Circle, project_circle
from vision.matching.edge_support import tally_support
from vision.model.contour import PATTERN_SAMPLES, SAMPLE_SPACING_PX, ModelContour
from vision.model.grasp import turns_about_z
from vision.model.projection import hides
from vision.model.vision_model import CircleFeature, Pattern, VisionModel

SCALE = 4200.0
SLOT_ANGLES = 0.4 + np.arange(3) * 2 * np.pi / 3


@pytest.fixture(scope="module")
def contour(plate):
    return ModelContour.of(plate, SCALE)


def test_samples_lie_on_the_circles_and_tangents_run_along_them(plate, contour):
    circles = [circle for feature in plate.features for circle in feature.circles()]
    assert len(contour.circle_weight) == len(circles) == 8
    for number, circle in enumerate(circles):
        mine = contour.circle == number
        arm = contour.points[mine] - circle.centre
        assert np.allclose(np.linalg.norm(arm, axis=1), circle.radius_m)
        for vectors in (arm, contour.tangents[mine]):
            assert np.allclose(vectors @ circle.normal, 0, atol=1e-12)
        assert np.allclose(np.einsum("ij,ij->i", arm, contour.tangents[mine]), 0, atol=1e-12)
        assert np.allclose(np.linalg.norm(contour.tangents[mine], axis=1), 1)
        assert np.allclose(contour.normals[mine], circle.normal)


def test_samples_are_spaced_as_promised(plate, contour):
    bore = contour.points[contour.circle == 2]
    gap_px = np.linalg.norm(bore[1] - bore[0]) * SCALE
    assert SAMPLE_SPACING_PX <= gap_px < 1.1 * SAMPLE_SPACING_PX


def test_holes_alone_tell_the_rotation(contour):
    assert contour.circle_symmetric.tolist() == [True] * 5 + [False] * 3
    assert contour.circle_salient.tolist() == [True] * 5 + [False] * 3
    assert set(contour.asymmetric().circle) == {5, 6, 7}
    assert contour.asymmetric().reach_m == pytest.approx(0.022 + 0.0035, rel=1e-3)


def test_projection_is_that_of_the_camera_and_normals_are_those_of_the_ellipse(plate, contour, photograph, pose):
    (view,) = photograph([], views=[1])
    T = pose(5, -8, 3, about=(6, -9, 40))
    projection = contour.project(T.as_matrix(), view)
    assert np.allclose(projection.pixels, view.project(T.apply(contour.points[projection.index].copy())))
    for number, circle in enumerate(c for f in plate.features for c in f.circles()):
        mine = contour.circle[projection.index] == number
        assert mine.any() == (circle.normal[2] > 0)
        if mine.any():
            ellipse = project_circle(circle.moved(T), view)
            assert np.abs(ellipse.distance(projection.pixels[mine])).max() < 1e-6
            along = np.einsum("ij,ij->i", ellipse.normals(projection.pixels[mine]), projection.normals[mine])
            assert np.allclose(np.abs(along), 1, atol=1e-9)


def test_nothing_behind_the_camera_is_projected(contour, photograph, pose):
    (view,) = photograph([], views=[1])
    behind = view.T_world_camera * RigidTransform.from_translation([0, 0, -0.5])
    assert len(contour.project(behind.as_matrix(), view).index) == 0


def test_one_pass_tallies_what_projection_and_support_do(contour, photograph, pose):
    (view,) = photograph([pose(-30, 2, 0, about=(5, 4, 10)), pose(32, 5, 0, about=(184, -6, 0))], views=[0])
    field = EdgeField.from_gray(view.gray)
    rng = np.random.default_rng(10_001)
    claimed = rng.random(field.distance.shape) < 0.2
    distance = np.where(claimed, np.float32(np.inf), field.distance)
    open_ = np.full_like(field.distance, np.inf)
    edges = StackedEdges(*(a[None] for a in (distance, field.direction, field.nearest, claimed, open_)))
    camera = view.camera
    supported = 0
    for trial in range(40):
        near = pose(-30, 2, 0, about=(5, 4, 10)) if trial % 2 else pose(32, 5, 0, about=(184, -6, 0))
        spread = 10.0 ** -rng.uniform(0.5, 4)
        shake = RigidTransform.from_components(
            0.05 * spread * rng.normal(size=3), Rotation.from_rotvec(spread * rng.normal(size=3))
        )
        T = (near * shake).as_matrix()
        total, count = np.zeros((1, 1, 8)), np.zeros((1, 1, 8, 2))
        tally_support(
            T[None],
            camera_arrays([view]),
            contour.samples,
            edges,
            3.0,
            total,
            count,
        )
        projection = contour.project(T, view)
        u, v = np.round(projection.pixels).T.astype(int)
        inside = (u >= 2) & (v >= 2) & (u <= camera.width_px - 3) & (v <= camera.height_px - 3)
        free = inside & ~claimed[np.where(inside, v, 0), np.where(inside, u, 0)]
        support = field.support(projection.pixels, projection.normals, 3.0)
        circle = contour.circle[projection.index]
        assert np.array_equal(count[0, 0, :, 0], np.bincount(circle[inside], minlength=8))
        assert np.array_equal(count[..., 0], count[..., 1])
        # The distances are stored in single precision.
        assert np.allclose(total[0, 0], np.bincount(circle[free], support[free], minlength=8), rtol=1e-5, atol=1e-5)
        supported += total.sum() > 20
    assert supported > 10


def cup(radius_m=0.015, floor_m=0.010):
    """A cup's rim at z = 0, seen from +z, and circles on its floor."""
    up = np.array([0.0, 0.0, 1.0])
    rim = CircleFeature("rim", "salient", Circle(np.zeros(3), up, radius_m), "region")
    floor = CircleFeature("floor", "salient", Circle(np.array([0, 0, -floor_m]), up, 0.6 * radius_m), "region")
    return VisionModel("cup", 2 * radius_m, (rim, floor))


@given(tilt_deg=st.floats(0, 80), azimuth=st.floats(0, 6.28), radius=st.floats(0, 0.98), turn=st.floats(0, 6.28))
def test_the_floor_of_a_cup_is_seen_exactly_where_the_line_of_sight_misses_its_wall(tilt_deg, azimuth, radius, turn):
    """March along the line of sight and look whether it enters the wall, a cylinder below the rim."""
    contour = ModelContour.of(cup(), 4000)
    rims = contour.rims[1]
    assert np.array_equal(rims, [[0.015, 0.0]])
    tilt = np.radians(tilt_deg)
    eye = 0.4 * np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    point = np.array([0.015 * radius * np.cos(turn), 0.015 * radius * np.sin(turn), -0.010])
    path = point + np.linspace(0, 1, 4001)[:, None] * (eye - point)
    beyond = np.hypot(*path[path[:, 2] < 0, :2].T).max() / 0.015
    if abs(beyond - 1) > 0.04:  # the taught radius has a tolerance
        assert hides(*rims[0], *point, eye) == (beyond > 1)


def test_a_flange_hides_behind_the_hat_and_a_rim_hides_nothing_on_its_own_side():
    up = np.array([0.0, 0.0, 1.0])
    hat = CircleFeature("hat", "salient", Circle(np.array([0, 0, 0.04]), up, 0.05), "region")
    flange = CircleFeature("flange", "salient", Circle(np.zeros(3), up, 0.1), "region")
    contour = ModelContour.of(VisionModel("hub", 0.2, (hat, flange)), 1000)
    assert np.isnan(contour.rims[0]).all()
    assert not hides(*contour.rims[0, 0], 0.0, 0.0, 0.0, np.ones(3))
    eye = np.array([0.5, 0.0, 0.2])
    near, far = np.array([0.1, 0.0, 0.0]), np.array([-0.1, 0.0, 0.0])
    assert not hides(*contour.rims[1, 0], *near, eye)
    assert hides(*contour.rims[1, 0], *far, eye)


@pytest.fixture(scope="module")
def slotted(plate):
    """The plate with three radial edges on its front."""
    along = np.linspace(0.016, 0.026, 90)
    points = [[*(along[i] * np.array([np.cos(a), np.sin(a)])), 0.004] for a in SLOT_ANGLES for i in range(len(along))]
    directions = [[np.cos(a), np.sin(a), 0.0] for a in SLOT_ANGLES for _ in along]
    return replace(plate, patterns=(Pattern("slots", np.array([0.0, 0.0, 1.0]), points, directions),))


def test_a_pattern_is_sampled_alike_in_every_sector(slotted):
    contour = ModelContour.of(slotted, SCALE)
    numbers = np.flatnonzero(contour.circle_drawn)
    assert numbers.tolist() == [8, 9, 10]
    assert contour.circle_copies[numbers].tolist() == [3, 0, 0]
    of_file = slotted.patterns[0]
    for turn, number in zip(turns_about_z(3).as_matrix(), numbers, strict=True):
        mine = contour.circle == number
        assert 0.5 * PATTERN_SAMPLES < mine.sum() <= PATTERN_SAMPLES
        assert np.allclose(contour.points[mine], contour.points[contour.circle == 8] @ turn.T)
        nearest = np.linalg.norm(contour.points[mine][:, None] - of_file.points, axis=2)
        assert nearest.min(axis=1).max() < 1e-9
        assert np.allclose(
            np.abs(of_file.directions[nearest.argmin(axis=1)] @ contour.tangents[mine].T).max(axis=0), 1
        )


def test_the_first_copies_stand_for_all(slotted):
    contour = ModelContour.of(slotted, SCALE)
    assert set(contour.first_copies().circle) == {5, 8}
    assert set(contour.asymmetric().circle) == {5, 6, 7, 8, 9, 10}


def test_a_pattern_that_leaves_a_sector_empty_is_sampled_as_a_whole(plate):
    points = np.column_stack([np.full(30, -0.02), np.linspace(-0.01, -0.005, 30), np.full(30, 0.004)])
    pattern = Pattern("notch", np.array([0.0, 0.0, 1.0]), points, np.tile([0.0, 1.0, 0.0], (30, 1)))
    contour = ModelContour.of(replace(plate, patterns=(pattern,)), SCALE)
    assert contour.circle_copies[contour.circle_drawn].tolist() == [1]
    assert 0 < np.count_nonzero(contour.circle == 8) <= 30
