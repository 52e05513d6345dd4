import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from vision.regions.contours import trace_contours


def traced(labels, label):
    """Boundaries of one label, as lists of points, in the order of their first pixels."""
    wanted = np.arange(labels.max() + 1) == label
    contours = trace_contours(labels, wanted)
    assert (contours.labels == label).all()
    return [contours.points[a:b].tolist() for a, b in zip(contours.ends[:-1], contours.ends[1:], strict=True)]


def from_opencv(mask):
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    return sorted(c.reshape(-1, 2).tolist() for c in found)


@settings(deadline=None, max_examples=60)
@given(
    hnp.arrays(np.int32, hnp.array_shapes(min_dims=2, max_dims=2, max_side=14), elements=st.integers(0, 2)),
    st.integers(1, 3),
)
def test_contours_are_those_of_opencv(blocks, zoom):
    labels = blocks.repeat(zoom, axis=0).repeat(zoom, axis=1)
    for label in range(1, labels.max() + 1):
        if (labels == label).any():
            assert sorted(traced(labels, label)) == from_opencv(labels == label)


def test_a_frame_has_one_outer_boundary_and_one_hole():
    labels = np.zeros((9, 12), np.int32)
    labels[1:8, 1:11] = 1
    labels[3:6, 3:9] = 0
    outer, hole = traced(labels, 1)
    assert outer[0] == [1, 1]
    assert len(outer) == 2 * (6 + 9)
    assert len(hole) == 2 * (3 + 6)  # its corners are cut: the boundary is 8-connected


def test_what_is_not_wanted_is_not_traced():
    labels = np.array([[1, 2, 2], [1, 2, 3]], np.int32)
    contours = trace_contours(labels, np.array([False, True, False, True]))
    assert contours.labels.tolist() == [1, 3]
    assert len(trace_contours(labels, np.zeros(4, bool)).points) == 0


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (7, 1), (200, 300)])
def test_an_image_of_one_region_has_its_border_as_contour(size):
    labels = np.ones(size, np.int32)
    assert traced(labels, 1) == from_opencv(labels == 1)
