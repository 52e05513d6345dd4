import pickle

import cv2
import numpy as np
import pytest
from scipy.stats import norm

from benchmark.detector.drawings import fill_ellipse
from vision.edges.edge_map import EdgeParameters, as_gray, detect_edges
from vision.errors import InputError
from vision.geometry.ellipse import Ellipse


def drawn(ellipse, size=(240, 320), dark=60.0, bright=160.0):
    canvas = np.full(size, dark)
    fill_ellipse(canvas, ellipse, bright)
    return np.round(cv2.GaussianBlur(canvas, (0, 0), 0.7)).astype(np.uint8)


def test_the_outline_of_a_disc_is_one_closed_chain_on_the_outline():
    disc = Ellipse.from_geometric(160.3, 119.6, 80, 55, 0.4)
    edges = detect_edges(drawn(disc))
    assert len(edges) == 1
    assert np.hypot(*(edges.points[0] - edges.points[-1])) < 3
    offset = disc.distance(edges.points)
    assert abs(offset.mean()) < 0.03
    assert offset.std() < 0.1


def test_chains_have_the_brighter_side_along_the_gradient_and_walk_at_90_degrees_to_it():
    edges = detect_edges(drawn(Ellipse.from_geometric(160, 120, 70, 50, 0.0)))
    chain = edges.chain(0)
    inward = np.array([160, 120]) - chain
    assert (np.einsum("ij,ij->i", inward, edges.gradients) > 0).all()
    tangent = np.column_stack([-edges.gradients[:, 1], edges.gradients[:, 0]])[1:-1]
    walk = chain[2:] - chain[:-2]
    assert (np.einsum("ij,ij->i", walk, tangent) > 0).mean() > 0.99


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5, 0.8])
def test_a_straight_edge_is_localised_to_a_twentieth_of_a_pixel(shift):
    columns = np.clip(np.arange(64) - 30.0 - shift + 0.5, 0, 1) * 120 + 40
    edges = detect_edges(np.round(np.tile(columns, (48, 1))).astype(np.uint8))
    assert len(edges) == 1
    assert np.abs(edges.points[:, 0] - (30 + shift)).max() < 0.05


def test_the_walk_goes_straight_through_a_t_junction():
    image = np.full((100, 200), 50, np.uint8)
    image[50:, :] = 150
    image[:49, 100:] = 80  # the stem of the T, above the bar
    edges = detect_edges(image)
    longest = max((edges.chain(k) for k in range(len(edges))), key=len)
    assert np.ptp(longest[:, 0]) > 190
    assert np.abs(longest[:, 1] - 49.5).max() < 1.5


def test_every_point_is_found_through_the_index():
    edges = detect_edges(drawn(Ellipse.from_geometric(100, 100, 40, 30, 1.0)))
    rows, columns = np.nonzero(edges.index >= 0)
    numbers = edges.index[rows, columns]
    assert sorted(numbers) == list(range(len(edges.points)))
    assert np.hypot(*(edges.points[numbers] - np.column_stack([columns, rows])).T).max() < 1.1


def test_constant_and_tiny_images_have_no_edges():
    for shape in [(0, 0), (0, 5), (1, 1), (2, 9), (40, 40)]:
        assert len(detect_edges(np.full(shape, 7, np.uint8))) == 0


def test_edge_maps_survive_pickling_read_only():
    edges = pickle.loads(pickle.dumps(detect_edges(drawn(Ellipse.from_geometric(100, 100, 40, 30, 1.0)))))
    with pytest.raises(ValueError, match="read-only"):
        edges.points[0] = 0


def test_colour_float_and_bool_images_are_converted():
    gray = drawn(Ellipse.from_geometric(100, 100, 40, 30, 1.0))
    colour = np.repeat(gray[:, :, None], 3, axis=2)
    assert np.array_equal(as_gray(colour), gray)
    assert np.array_equal(as_gray(gray.astype(float)), gray)
    assert np.array_equal(as_gray(gray[:, :, None]), gray)
    assert as_gray(gray > 100).max() == 255


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 4, 2), np.uint8),
        np.zeros(5, np.uint8),
        np.full((4, 4), np.nan),
        np.full((4, 4), 300.0),
        np.zeros((4, 4), complex),
    ],
)
def test_other_arrays_are_refused_with_a_reason(image):
    with pytest.raises(InputError, match="expected"):
        detect_edges(image)


def test_parameters_are_checked():
    with pytest.raises(InputError, match=r"max_contrast of EdgeParameters: got 10\.0"):
        EdgeParameters(min_contrast=20.0, max_contrast=10.0)


@pytest.mark.parametrize("degrees", [0, 7, 18, 27, 33, 45, 71, 90, 114])
def test_settled_points_lie_on_a_straight_edge_whatever_its_direction(degrees):
    normal, offset, size = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]), 0.31, 96
    at = np.arange(size) - (size - 1) / 2
    across = at[None, :] * normal[0] + at[:, None] * normal[1] - offset
    edges = detect_edges(np.round(90 + 80 * norm.cdf(across / 0.75)).astype(np.uint8))
    inner = np.flatnonzero(np.abs(edges.points - (size - 1) / 2).max(axis=1) < size / 2 - 10)
    distance = (edges.settled(inner) - (size - 1) / 2) @ normal - offset
    assert len(inner) > 50
    assert abs(distance.mean()) < 0.02
    assert distance.std() < 0.02
