import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vision.geometry import ellipse
from vision.geometry.ellipse import Ellipse
from vision.grouping.duplicates import is_known, largest_distance, overlap

ellipses = st.builds(
    lambda x, y, a, ratio, angle: Ellipse.from_geometric(x, y, a, a * ratio, angle),
    st.floats(95, 105),
    st.floats(95, 105),
    st.floats(20, 60),
    st.floats(0.4, 1.0),
    st.floats(0, 3.1),
)


@given(ellipses, ellipses)
@settings(max_examples=60, deadline=None)
def test_overlap_is_that_of_the_filled_masks_and_symmetric(a, b):
    expected = ellipse.overlap(a, b)
    assert overlap(a.p, b.p) == pytest.approx(expected, abs=0.03)
    assert overlap(a.p, b.p) == pytest.approx(overlap(b.p, a.p), abs=0.02)


def test_overlap_of_concentric_circles_is_the_ratio_of_their_areas():
    large, small = (Ellipse.from_geometric(50, 60, r, r, 0.0) for r in (30.0, 24.0))
    assert overlap(large.p, small.p) == pytest.approx(0.64, abs=1e-9)
    assert overlap(large.p, large.p) == pytest.approx(1.0)


def test_ellipses_that_do_not_hold_each_others_centre_do_not_overlap():
    a, b = Ellipse.from_geometric(0, 0, 10, 5, 0.0), Ellipse.from_geometric(30, 0, 10, 5, 0.0)
    assert overlap(a.p, b.p) == 0


def test_largest_distance_of_concentric_circles_is_the_difference_of_their_radii():
    a, b = (Ellipse.from_geometric(50, 60, r, r, 0.0) for r in (30.0, 27.5))
    assert largest_distance(a.p, b.p) == pytest.approx(2.5)


def test_what_is_known_already_depends_on_the_distance_allowed():
    rim, inner = (Ellipse.from_geometric(50, 60, r, 0.8 * r, 0.4) for r in (60.0, 58.0))
    known = np.array([rim.p, np.zeros(5)])
    assert is_known(inner.p, known, 1, 0.85, np.inf)
    assert not is_known(inner.p, known, 1, 0.85, 1.5)  # the two edges of a rim
    assert not is_known(inner.p, known, 1, 0.97, np.inf)
    assert not is_known(inner.p, known, 0, 0.85, np.inf)
