from __future__ import annotations

import pickle
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision.drawing.strokes import (
    EXTRACTOR_COLOURS,
    TICK_PX,
    Strokes,
    contact_sheet,
    distinct_colours,
    ellipse_strokes,
    fragment_strokes,
    group_strokes,
    model_strokes,
    paint,
    paint_regions,
    plain_strokes,
    region_strokes,
)
from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.camera import Camera, View
from vision.geometry.ellipse import Ellipse
from vision.grouping.edge_grouping import group_edges
from vision.model.contour import ModelContour
from vision.regions.segmentation import segment

CENTRE, RADIUS = (60.0, 50.0), 30.0


def disc() -> np.ndarray:
    image = np.full((100, 120), 60, np.uint8)
    cv2.circle(image, (60, 50), 30, 200, -1, cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), 0.7)


def feature(extractor: str) -> EllipseFeature:
    ellipse = Ellipse.from_geometric(*CENTRE, RADIUS, 20.0, 0.4)
    return EllipseFeature(ellipse, extractor, ellipse.sample(20), 1.0, 1.0)


def distance_from_rim(points: np.ndarray) -> np.ndarray:
    return np.abs(np.hypot(*(points - CENTRE).T) - RADIUS)


def circle_contour(radius_m: float, facing: float) -> ModelContour:
    """One salient circle around the origin, its normal along z times `facing`."""
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    unit = np.column_stack([np.cos(t), np.sin(t), np.zeros(40)])
    tangents = np.column_stack([-np.sin(t), np.cos(t), np.zeros(40)])
    normals = np.tile([0.0, 0.0, facing], (40, 1))
    flags = np.array([True])
    return ModelContour(
        radius_m * unit,
        tangents,
        normals,
        np.zeros(40, int),
        flags,
        ~flags,
        flags,
        np.ones(1),
        np.ones(1, int),
        np.empty((1, 0, 2)),
    )


def test_strokes_of_ellipses_are_closed_lie_on_them_and_tell_the_process() -> None:
    features = [feature("region"), feature("group")]
    strokes = ellipse_strokes(features)
    for line, colour, one in zip(strokes.lines, strokes.colours, features, strict=True):
        assert np.array_equal(line[0], line[-1])
        assert np.abs(one.ellipse.distance(line)).max() < 1e-6
        assert tuple(colour) == EXTRACTOR_COLOURS[one.extractor]


def test_nothing_found_gives_no_strokes() -> None:
    blank = np.full((40, 40), 100, np.uint8)
    grouping = group_edges(blank)
    for strokes in (ellipse_strokes([]), fragment_strokes(grouping), group_strokes(grouping), region_strokes([])):
        assert len(strokes) == 0
        assert np.array_equal(paint(blank, strokes)[..., 0], blank)


def test_fragments_and_groups_of_a_disc_lie_on_its_rim() -> None:
    grouping = group_edges(disc())
    for strokes in (fragment_strokes(grouping), group_strokes(grouping)):
        assert len(strokes) > 0
        assert max(distance_from_rim(line).max() for line in strokes.lines) < 1.5


def test_a_region_with_a_hole_has_two_boundaries_of_one_colour() -> None:
    segmentation = segment(disc())
    background = max(segmentation.regions, key=lambda region: region.attributes.area_px)
    strokes = region_strokes([background])
    assert len(strokes) == 1 + len(background.holes) == 2
    assert np.array_equal(strokes.colours[0], strokes.colours[1])
    assert distance_from_rim(strokes.lines[1]).max() < 4


def test_a_region_keeps_its_colour_when_others_are_pruned() -> None:
    segmentation = segment(disc())
    last = segmentation.regions[-1]
    everything, alone = region_strokes(segmentation.regions), region_strokes([last])
    assert np.array_equal(everything.colours[-1], alone.colours[-1])
    assert region_strokes([last], [(1, 2, 3)]).colours[-1].tolist() == [1, 2, 3]


@pytest.mark.parametrize("zoom", [1, 2, 3])
def test_painting_puts_a_line_where_it_belongs(zoom: int) -> None:
    strokes = plain_strokes([[(2.0, 5.0), (12.0, 5.0)]], (255, 0, 0))
    canvas = paint(np.zeros((10, 20), np.uint8), strokes, zoom=zoom)
    assert canvas.shape == (10 * zoom, 20 * zoom, 3)
    rows, columns = np.nonzero(canvas[..., 0] > 60)
    assert np.mean(rows) == pytest.approx(5.5 * zoom - 0.5, abs=0.6)
    assert np.mean(columns) == pytest.approx(7.5 * zoom - 0.5, abs=0.6)
    assert not canvas[..., 1:].any()


def test_painting_leaves_the_image_alone_and_survives_far_points() -> None:
    image = np.zeros((10, 10), np.uint8)
    image.flags.writeable = False
    canvas = paint(image, plain_strokes([[(-1e12, 5.0), (1e12, 5.0)]], (9, 9, 9)))
    assert canvas[5].any()
    assert not image.any()


def test_regions_are_filled_where_they_are() -> None:
    image = disc()
    segmentation = segment(image)
    inside = segmentation.regions[segmentation.labels[50, 60] - 1]
    canvas = paint_regions(image, segmentation, [inside])
    assert np.ptp(canvas[50, 60]) > 0, "a colour and no grey"
    assert np.ptp(canvas[5, 5]) == 0
    assert paint_regions(image, segmentation, [inside], zoom=2).shape == (200, 240, 3)


@pytest.mark.parametrize(("facing", "count"), [(-1.0, 1), (1.0, 0)])
def test_a_model_is_superimposed_where_it_faces_the_camera(facing: float, count: int) -> None:
    camera = Camera(120, 100, 100.0, 100.0, 59.5, 49.5)
    view = View(np.zeros((100, 120), np.uint8), camera, RigidTransform.identity())
    T_world_part = RigidTransform.from_translation([0.0, 0.0, 2.0]).as_matrix()
    strokes = model_strokes(circle_contour(0.4, facing), T_world_part, view)
    assert len(strokes) == count
    for line in strokes.lines:
        assert np.allclose(np.hypot(*(line - (59.5, 49.5)).T), 20.0)
        assert np.array_equal(line[0], line[-1])


def test_of_a_model_only_circles_with_a_colour_are_drawn_and_in_that() -> None:
    camera = Camera(120, 100, 100.0, 100.0, 59.5, 49.5)
    view = View(np.zeros((100, 120), np.uint8), camera, RigidTransform.identity())
    T_world_part = RigidTransform.from_translation([0.0, 0.0, 2.0]).as_matrix()
    contour = circle_contour(0.4, -1.0)
    assert model_strokes(contour, T_world_part, view, {0: (1, 2, 3)}).colours.tolist() == [[1, 2, 3]]
    assert len(model_strokes(contour, T_world_part, view, {1: (1, 2, 3)})) == 0


def test_a_pattern_is_drawn_in_ticks_along_its_edges() -> None:
    camera = Camera(120, 100, 100.0, 100.0, 59.5, 49.5)
    view = View(np.zeros((100, 120), np.uint8), camera, RigidTransform.identity())
    T_world_part = RigidTransform.from_translation([0.0, 0.0, 2.0]).as_matrix()
    contour = replace(circle_contour(0.4, -1.0), circle_salient=np.array([False]), circle_drawn=np.array([True]))
    strokes = model_strokes(contour, T_world_part, view)
    assert len(strokes) == len(contour.points)
    for line, point in zip(strokes.lines, contour.points, strict=True):
        assert np.linalg.norm(line[1] - line[0]) == pytest.approx(TICK_PX)
        assert np.allclose(line.mean(axis=0), 50 * point[:2] + (59.5, 49.5))
        assert abs((line[1] - line[0]) @ point[:2]) < 1e-9


def test_colours_differ() -> None:
    colours = distinct_colours(12).astype(int)
    apart = np.abs(colours[:, None] - colours).sum(axis=2)
    assert apart[~np.eye(12, dtype=bool)].min() > 20


def test_strokes_are_added_checked_and_survive_pickling() -> None:
    a, b = plain_strokes([[(0, 0), (1, 1)]], (1, 2, 3)), plain_strokes([[(2, 2), (3, 3)]], (4, 5, 6))
    both = pickle.loads(pickle.dumps(a + b))
    assert both.colours.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert not both.lines[1].flags.writeable
    with pytest.raises(InputError, match="one for each"):
        Strokes((np.zeros((2, 2)),), np.zeros((2, 3), np.uint8))


def test_contact_sheet_has_a_cell_for_each_panel() -> None:
    panels = {str(i): np.full((30, 40, 3), 10 * i, np.uint8) for i in range(1, 5)}
    sheet = contact_sheet(panels, columns=3, box_px=80)
    cell_height, cell_width = sheet.shape[0] // 2, sheet.shape[1] // 3
    assert (sheet[cell_height // 2 + 10, cell_width // 2] == 10).all()
    assert (sheet[cell_height + cell_height // 2 + 10, cell_width // 2] == 40).all()
    assert (sheet[-1, -1] == 255).all()
    with pytest.raises(InputError, match="at least one"):
        contact_sheet({})


@pytest.mark.parametrize("shape", [(1, 480), (480, 1), (3000, 3), (1, 1), (2000, 1000)])
def test_contact_sheet_is_as_large_for_a_narrow_image(shape: tuple[int, int]) -> None:
    sheet = contact_sheet({"a": np.zeros((*shape, 3), np.uint8), "b": np.zeros((*shape, 3), np.uint8)}, box_px=100)
    assert max(sheet.shape) < 260
    assert (sheet == 0).all(axis=2).sum() >= 2 * 100
