"""Edge evidence against edges drawn where the test says."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.special import ndtr

from vision.edges.edge_field import EdgeField, _interpolate

SIZE = (120, 160)


def edge_at(position: float, angle: float, dark: float = 60.0, bright: float = 160.0, blur_px: float = 0.7):
    """A straight edge at a distance from the image's centre along a normal; the bright side is ahead."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    ahead = (x - 80) * np.cos(angle) + (y - 60) * np.sin(angle) - position
    return np.round(dark + (bright - dark) * ndtr(ahead / blur_px)).astype(np.uint8)


def along(angle: float, offset: float, n: int = 15):
    """Points (n, 2) on the parallel at a distance from the image's centre, and their normals."""
    normal = np.array([np.cos(angle), np.sin(angle)])
    tangent = np.array([-normal[1], normal[0]])
    points = np.array([80.0, 60.0]) + offset * normal + np.linspace(-25, 25, n)[:, None] * tangent
    return points, np.tile(normal, (n, 1))


ANGLES = pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 2, 2.2, 4.0])


@ANGLES
def test_support_is_one_on_the_edge_and_none_far_from_it(angle):
    field = EdgeField.from_gray(edge_at(3.0, angle))
    assert np.allclose(field.support(*along(angle, 3.0)), 1)
    for offset in (-1.5, 7.5):
        assert not field.support(*along(angle, offset)).any()


@ANGLES
def test_support_falls_with_distance(angle):
    field = EdgeField.from_gray(edge_at(0.0, angle))
    means = [field.support(*along(angle, offset)).mean() for offset in (0, 2, 3, 5)]
    assert means[0] > means[1] > means[2] >= means[3] == 0


@pytest.mark.parametrize(("turn_deg", "expected"), [(0, 1), (180, 1), (10, 1), (40, 0), (90, 0)])
def test_support_asks_for_the_direction_of_the_edge_but_not_its_sign(turn_deg, expected):
    field = EdgeField.from_gray(edge_at(0.0, 0.5))
    points, _ = along(0.5, 0.0)
    _, normals = along(0.5 + np.radians(turn_deg), 0.0)
    assert np.allclose(field.support(points, normals), expected)


def test_no_support_outside_the_image_or_at_undefined_points():
    field = EdgeField.from_gray(edge_at(0.0, 0.0))
    points = np.array([[-5.0, 60], [80, -3], [80, 500], [1e9, 60], [np.nan, np.nan]])
    assert not field.support(points, np.tile([1.0, 0.0], (5, 1))).any()


def test_no_edges_in_an_empty_image():
    field = EdgeField.from_gray(np.full(SIZE, 90, np.uint8))
    points, normals = along(0.3, 0.0)
    assert not field.support(points, normals).any()
    assert np.isnan(field.measure(points, normals, 3.0)[0]).all()


@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi / 2, 2.2, 4.0])
def test_measured_position_is_right_to_a_twentieth_of_a_pixel(angle):
    errors = []
    for position in (-0.8, -0.25, 0.0, 0.3, 0.5, 1.4):
        offsets, _ = EdgeField.from_gray(edge_at(position, angle)).measure(*along(angle, 0.0), reach_px=3.0)
        errors.append(offsets - position)
    assert np.sqrt(np.mean(np.square(errors))) < 0.05


@ANGLES
@pytest.mark.parametrize("position", [-0.8, -0.25, 0.0, 0.3, 0.5, 1.4])
def test_every_point_along_an_edge_measures_it(angle, position):
    field = EdgeField.from_gray(edge_at(position, angle))
    offsets, slopes = field.measure(*along(angle, 0.0), reach_px=3.0)
    assert np.abs(offsets - position).max() < 0.12
    assert (slopes > 10).all()


def test_slope_of_the_measured_edge_is_negative_from_bright_to_dark():
    points, normals = along(0.5, 0.0)
    offsets, slopes = EdgeField.from_gray(edge_at(0.4, 0.5)).measure(points, -normals, 3.0)
    assert np.allclose(offsets, -0.4, atol=0.12)
    assert (slopes < 0).all()


def test_nearer_of_two_equal_edges_is_measured():
    x = np.tile(np.arange(SIZE[1]), (SIZE[0], 1))
    stripe = np.round(60 + 100 * (ndtr((x - 81) / 0.7) - ndtr((x - 89) / 0.7))).astype(np.uint8)
    offsets, _ = EdgeField.from_gray(stripe).measure(*along(0.0, 0.0), reach_px=10.0)
    assert np.allclose(offsets, 1.0, atol=0.12)


def test_edge_that_is_too_faint_or_too_far_is_not_measured():
    faint = EdgeField.from_gray(edge_at(0.0, 0.0, dark=100, bright=103))
    assert np.isnan(faint.measure(*along(0.0, 0.0), reach_px=3.0)[0]).all()
    far = EdgeField.from_gray(edge_at(9.0, 0.0))
    assert np.isnan(far.measure(*along(0.0, 0.0), reach_px=3.0)[0]).all()


def test_undefined_point_spoils_no_other():
    field = EdgeField.from_gray(edge_at(0.3, 0.0))
    points, normals = along(0.0, 0.0)
    points[4] = np.nan
    offsets, _ = field.measure(points, normals, 3.0)
    assert np.isnan(offsets[4])
    assert np.allclose(np.delete(offsets, 4), 0.3, atol=0.3)


def test_measuring_nothing_gives_nothing():
    field = EdgeField.from_gray(edge_at(0.0, 0.0))
    for part in field.measure(np.empty((0, 2)), np.empty((0, 2)), 3.0):
        assert part.shape == (0,)
    assert field.support(np.empty((0, 2)), np.empty((0, 2))).shape == (0,)


def test_slope_across_a_ramp_is_its_steepness_and_undefined_outside():
    ramp = np.tile(np.arange(SIZE[1], dtype=np.uint8), (SIZE[0], 1))
    points = np.array([[50.25, 40.0], [80.0, 60.5], [-4.0, 10.0]])
    slopes = EdgeField.from_gray(ramp).slope(points, np.tile([1.0, 0.0], (3, 1)))
    assert np.allclose(slopes[:2], 1.0, atol=1e-3)
    assert np.isnan(slopes[2])


@pytest.mark.parametrize(
    ("x", "y", "expected"), [(2, 2, True), (157, 117, True), (1.9, 50, False), (80, 117.1, False)]
)
def test_inside_keeps_a_margin(x, y, expected):
    field = EdgeField.from_gray(np.zeros(SIZE, np.uint8))
    assert field.inside(np.array([[x, y]]), 2.0).tolist() == [expected]


def test_profiles_are_read_as_opencv_reads_them():
    rng = np.random.default_rng(0)
    image = rng.uniform(0, 255, (30, 40)).astype(np.float32)
    points = rng.uniform(-9, 49, (500, 2))
    x, y = points.astype(np.float32).T
    expected = cv2.remap(image, x[:, None], y[:, None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[:, 0]
    assert np.allclose([_interpolate(image, u, v) for u, v in points], expected, rtol=0, atol=1e-3)
