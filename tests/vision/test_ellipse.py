import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vision.errors import InputError
from vision.geometry.ellipse import Ellipse, focal_jacobian, focal_residual, overlap
from vision.grouping.kalman_filter import fit_ellipse

ellipses = st.builds(
    lambda x, y, a, ratio, angle: Ellipse.from_geometric(x, y, a, a * ratio, angle),
    st.floats(-500, 500),
    st.floats(-500, 500),
    st.floats(2, 400),
    st.floats(0.1, 1.0),
    st.floats(0, 3.1),
)


@given(ellipses)
def test_boundary_points_satisfy_eq_3_and_the_conic(ellipse):
    points = ellipse.sample(40)
    assert np.abs(focal_residual(ellipse.p, points)).max() < 1e-6 * ellipse.p[4]
    homogeneous = np.column_stack([points, np.ones(40)])
    assert np.abs(np.einsum("ij,jk,ik->i", homogeneous, ellipse.conic, homogeneous)).max() < 1e-6


@given(ellipses)
def test_conic_round_trip(ellipse):
    back = Ellipse.from_conic(-3 * ellipse.conic)
    assert overlap(ellipse, back) > 0.99
    assert np.allclose(back.centre, ellipse.centre, atol=1e-4)
    assert np.allclose(back.semi_axes, ellipse.semi_axes, rtol=1e-5)


@given(ellipses, st.integers(0, 2**31))
def test_jacobian_agrees_with_finite_differences(ellipse, seed):
    points = ellipse.centre + np.random.default_rng(seed).normal(size=(6, 2)) * 500
    analytic = focal_jacobian(ellipse.p, points)
    numeric = np.empty_like(analytic)
    for k in range(5):
        step = np.eye(5)[k] * 1e-4
        numeric[:, k] = (focal_residual(ellipse.p + step, points) - focal_residual(ellipse.p - step, points)) / 2e-4
    far = np.minimum(*(np.hypot(*(points - ellipse.p[i : i + 2]).T) for i in (0, 2))) > 1
    assert np.allclose(analytic[far], numeric[far], atol=1e-3)


@given(ellipses)
def test_overlap_is_one_with_itself_and_symmetric(ellipse):
    x, y, *shape = ellipse.geometric
    shifted = Ellipse.from_geometric(x + ellipse.semi_axes[1] / 2, y, *shape)
    assert overlap(ellipse, ellipse) == 1.0
    assert overlap(ellipse, shifted) == pytest.approx(overlap(shifted, ellipse), abs=1e-12)
    assert overlap(ellipse, shifted) < 1


def test_overlap_of_concentric_circles_is_the_area_ratio():
    small, large = (Ellipse.from_geometric(10, 20, r, r, 0) for r in (30, 50))
    assert overlap(small, large) == pytest.approx(0.36, abs=0.01)


def test_disjoint_ellipses_do_not_overlap():
    assert overlap(Ellipse.from_geometric(0, 0, 5, 4, 0), Ellipse.from_geometric(20, 0, 5, 4, 1)) == 0.0


def test_coincident_foci_are_a_circle():
    circle = Ellipse(np.array([3.0, 4.0, 3.0, 4.0, 10.0]))
    assert circle.semi_axes == (5.0, 5.0)
    assert np.allclose(circle.distance([[3, 4 + 6], [3 + 4.5, 4]]), [1, -0.5], atol=0.1)


@pytest.mark.parametrize("p", [[0, 0, 10, 0, 9], [0, 0, 0, 0, np.nan], [1, 2, 3]])
def test_refuses_what_is_no_ellipse(p):
    with pytest.raises(InputError, match="expected"):
        Ellipse(np.array(p, dtype=float))


def test_hyperbola_is_refused():
    with pytest.raises(InputError, match="real ellipse"):
        Ellipse.from_conic(np.diag([1.0, -1.0, -1.0]))


def test_arrays_stay_read_only_after_pickling():
    ellipse = pickle.loads(pickle.dumps(Ellipse.from_geometric(1, 2, 3, 2, 0.5)))
    with pytest.raises(ValueError, match="read-only"):
        ellipse.p[0] = 0


def test_the_variance_across_is_that_of_ellipses_drawn_from_the_covariance():
    rng = np.random.default_rng(0)
    root = 0.02 * rng.normal(size=(5, 5))
    ellipse = Ellipse(Ellipse.from_geometric(50, 40, 30, 18, 0.7).p, root @ root.T)
    points = ellipse.sample(12)
    distances = [Ellipse(ellipse.p + root @ rng.normal(size=5)).distance(points) for _ in range(4000)]
    assert np.allclose(np.var(distances, axis=0), ellipse.variance_across(points), rtol=0.1)


def test_an_arc_is_certain_where_it_was_seen_alone():
    truth = Ellipse.from_geometric(100, 100, 60, 45, 0.3)
    arc = truth.sample(160)[:40] + np.random.default_rng(1).normal(0, 0.05, (40, 2))
    ellipse = fit_ellipse(arc, truth.p).ellipse
    seen, unseen = ellipse.variance_across(ellipse.sample(160)[[20, 100]])
    assert unseen > 100 * seen
    assert (Ellipse(ellipse.p).variance_across(arc) == 0).all()
