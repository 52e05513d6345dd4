"""Whatever is handed over as an image gives an answer or an InputError: never a crash, never another error."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vision
from vision.drawing.explain import explain
from vision.edges.edge_map import as_gray, detect_edges
from vision.errors import InputError
from vision.geometry.camera import Camera, View
from vision.geometry.workspace import Workspace
from vision.grouping.detector import detect_ellipses
from vision.grouping.edge_grouping import group_edges
from vision.localizer import EllipseLocalizer, Localization
from vision.regions.region_ellipses import region_ellipses
from vision.regions.segmentation import segment

SIDES = (1, 2, 3, 4, 7, 16, 33)
WORKSPACE = Workspace((-0.08, -0.08, -0.03), (0.08, 0.08, 0.03))


@st.composite
def images(draw):
    """Grey and colour, odd numbers of channels and dimensions, all kinds of numbers, empty, tiny and thin."""
    height, width = draw(st.sampled_from((0, *SIDES))), draw(st.sampled_from((0, *SIDES)))
    channels = draw(st.sampled_from([(), (), (3,), (1,), (4,), (2,), (0,), (2, 3)]))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    levels = rng.integers(0, 256, (height, width, *channels))
    kind = draw(st.sampled_from(["u1", "u1", "b", "i2", "u2", "f4", "f8", "c8", "O", "U3"]))
    image = levels.astype(kind)
    if draw(st.booleans()) and image.dtype.kind == "f" and image.size:
        image.flat[0] = draw(st.sampled_from([np.nan, np.inf, -np.inf, -1.0, 256.0, 1e300 if kind == "f8" else 1e30]))
    return image[::-1] if draw(st.booleans()) else image  # not contiguous


def is_gray(image):
    try:
        as_gray(image)
    except InputError:
        return False
    return True


@settings(max_examples=60)
@given(images())
def test_edges_and_groups_of_any_array(image):
    for function in (detect_edges, group_edges, detect_ellipses):
        if is_gray(image):
            function(image)
            continue
        with pytest.raises(InputError, match="image"):
            function(image)


@settings(max_examples=60)
@given(images())
def test_regions_of_any_array(image):
    if is_gray(image):
        segmentation = segment(image)
        assert segmentation.labels.shape == image.shape[:2]
        assert sum(region.attributes.area_px for region in segmentation.regions) <= segmentation.labels.size
        region_ellipses(segmentation)
        return
    with pytest.raises(InputError, match="image"):
        segment(image)


def numbers(result):
    """What an extractor found, as one array."""
    found = getattr(result, "features", result)
    return np.array([f.ellipse.p if hasattr(f, "ellipse") else f for f in found])


@pytest.mark.parametrize(
    "entry",
    [
        lambda picture: vision.region_ellipses(vision.segment(picture)),
        vision.group_edges,
        vision.group_ellipses,
        vision.find_ellipses,
        vision.detect_ellipses,
        lambda picture: vision.detect_edges(picture).points,
        lambda picture: vision.extract_features(
            vision.View(picture, Camera(160, 120, 300.0, 300.0, 80.0, 60.0), np.eye(4)), "focal"
        ),
    ],
    ids=["segment", "group_edges", "group_ellipses", "find_ellipses", "detect_ellipses", "detect_edges", "View"],
)
def test_every_entry_takes_the_same_pictures(entry):
    rgb = np.full((120, 160, 3), (40, 90, 60), np.uint8)
    cv2.ellipse(rgb, (80, 60), (50, 35), 20, 0, 360, (150, 190, 230), -1, cv2.LINE_AA)
    gray = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
    of_gray = numbers(entry(gray))
    assert len(of_gray) > 0
    for picture in (rgb, gray[:, ::-1][:, ::-1], rgb[::-1][::-1]):
        assert np.array_equal(numbers(entry(picture)), of_gray)
    assert gray.flags.writeable, "the caller's array is the caller's"


@settings(max_examples=30)
@given(images())
def test_every_stage_of_any_array_is_drawn(image):
    if is_gray(image) and min(image.shape[:2]) > 0:
        assert len(explain(image)) == 6
        return
    with pytest.raises(InputError, match="image"):
        explain(image)


@settings(max_examples=25)
@given(
    height=st.sampled_from(SIDES),
    width=st.sampled_from(SIDES),
    colour=st.booleans(),
    bent=st.booleans(),
    boxed=st.booleans(),
    count=st.integers(1, 3),
    seed=st.integers(0, 99),
)
def test_a_localizer_answers_any_views(plate, photograph, pose, height, width, colour, bent, boxed, count, seed):
    rng = np.random.default_rng(seed)
    camera = Camera(width, height, 30.0, 30.0, width / 2, height / 2, (0.1 if bent else 0.0, 0, 0, 0, 0))
    shape = (height, width, 3) if colour else (height, width)
    poses = [view.T_world_camera for view in photograph([], count)]
    views = [View(rng.integers(0, 256, shape).astype(np.uint8), camera, T) for T in poses]
    answer = EllipseLocalizer([plate]).localize(views, WORKSPACE if boxed else None)
    assert isinstance(answer, Localization)
    assert len(answer.features) == count
    for estimate in answer.estimates:
        assert np.isfinite(estimate.T_world_part.as_matrix()).all()
        assert np.isfinite(estimate.covariance).all()


@settings(max_examples=40)
@given(images())
def test_a_view_takes_only_an_image_of_its_cameras_size(image):
    height, width = (*image.shape[:2], 0, 0)[:2]
    if min(height, width) < 1:
        with pytest.raises(InputError):
            Camera(width, height, 30.0, 30.0, 0.0, 0.0)
        return
    camera = Camera(width, height, 30.0, 30.0, 0.0, 0.0)
    if image.dtype == np.uint8 and image.shape[2:] in ((), (3,)):
        assert View(image, camera, np.eye(4)).gray.shape == (height, width)
        return
    with pytest.raises(InputError, match="image of view"):
        View(image, camera, np.eye(4))


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.float16])
def test_fractions_of_one_are_refused_with_the_remedy(dtype):
    levels = np.linspace(0, 255, 40 * 50).reshape(40, 50)
    fractions = (levels / 255).astype(dtype)
    for function in (detect_ellipses, group_edges, detect_edges, explain):
        with pytest.raises(InputError, match=r"floating-point values from 0 to 1; .* Give it as image \* 255"):
            function(fractions)
    assert np.abs(as_gray(fractions * 255).astype(float) - levels).max() <= 0.7


def test_whole_numbers_in_floating_point_are_grey_levels():
    assert as_gray(np.array([[0.0, 1.0], [1.0, 0.0]])).tolist() == [[0, 1], [1, 0]]
    assert as_gray(np.array([[0.2, 1.6]])).tolist() == [[0, 2]]
    assert as_gray(np.zeros((2, 2))).tolist() == [[0, 0], [0, 0]]
