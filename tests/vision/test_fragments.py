import pickle

import cv2
import numpy as np
import pytest

from benchmark.detector.drawings import fill_ellipse
from vision.edges.edge_map import detect_edges
from vision.errors import InputError
from vision.geometry.ellipse import Ellipse
from vision.grouping.fragments import FragmentParameters, extract_fragments


def fragments_of(image):
    edges = detect_edges(image)
    table = extract_fragments(edges, image)
    return [table.fragment(k, edges) for k in range(len(table))]


def disc_image(ellipse, dark=60.0, bright=160.0, size=(240, 320)):
    canvas = np.full(size, dark)
    fill_ellipse(canvas, ellipse, bright)
    return np.round(cv2.GaussianBlur(canvas, (0, 0), 0.7)).astype(np.uint8)


@pytest.mark.parametrize("radius", [7, 8, 12, 20, 40, 100])
def test_a_circle_of_any_size_is_one_fragment_that_turns_all_around(radius):
    (fragment,) = fragments_of(disc_image(Ellipse.from_geometric(160.4, 119.7, radius, radius, 0.0)))
    assert fragment.turn_rad > 5.5
    assert np.abs(fragment.centre_of_mass - (160.4, 119.7)).max() < 0.05 * radius + 0.3


@pytest.mark.parametrize(("dark", "bright"), [(60.0, 160.0), (160.0, 60.0)])
def test_the_side_of_the_inside_and_its_grey_level_are_known(dark, bright):
    found = fragments_of(disc_image(Ellipse.from_geometric(160, 120, 90, 60, 0.3), dark, bright))
    assert found
    for fragment in found:
        assert fragment.inside_brighter == (bright > dark)
        assert fragment.grey_inside == pytest.approx(bright, abs=2)
        assert fragment.grey_outside == pytest.approx(dark, abs=2)


def test_straight_outlines_leave_no_fragments():
    image = np.full((200, 200), 50, np.uint8)
    cv2.fillConvexPoly(image, np.array([[30, 40], [170, 60], [150, 160], [40, 150]]), 180, cv2.LINE_AA)
    assert fragments_of(image) == []


def test_an_s_is_divided_at_its_inflection_into_arcs_of_opposite_sense():
    image = np.full((300, 300), 60, np.uint8)
    image[:, 150:] = 160
    cv2.circle(image, (150, 75), 60, 160, -1, cv2.LINE_AA)  # bulges to the left above
    cv2.circle(image, (150, 225), 60, 60, -1, cv2.LINE_AA)  # and to the right below
    fragments = fragments_of(image)
    assert {fragment.inside_brighter for fragment in fragments} == {True, False}
    for fragment in fragments:
        assert (fragment.points[:, 1].mean() < 150) == fragment.inside_brighter


def test_two_overlapping_discs_are_divided_at_their_corners():
    canvas = np.full((240, 320), 60.0)
    discs = [Ellipse.from_geometric(x, 120, 60, 60, 0.0) for x in (120, 200)]
    for disc in discs:
        fill_ellipse(canvas, disc, 160.0)
    fragments = fragments_of(np.round(canvas).astype(np.uint8))
    assert len(fragments) >= 2
    for fragment in fragments:
        inner = fragment.points[3:-3]
        assert min(np.abs(disc.distance(inner)).max() for disc in discs) < 1.0


def test_points_are_a_read_only_view_and_survive_pickling():
    fragment = pickle.loads(pickle.dumps(fragments_of(disc_image(Ellipse.from_geometric(160, 120, 60, 50, 0)))[0]))
    assert np.array_equal(fragment.endpoints, fragment.points[[0, -1]])
    with pytest.raises(ValueError, match="read-only"):
        fragment.points[0] = 0


def test_edges_of_another_image_are_refused():
    with pytest.raises(InputError, match="edge map"):
        extract_fragments(detect_edges(np.zeros((20, 20), np.uint8)), np.zeros((30, 20), np.uint8))


def test_parameters_are_checked():
    with pytest.raises(InputError, match="tolerance_px"):
        FragmentParameters(tolerance_px=0)
