import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from vision.errors import InputError
from vision.geometry.blur import unshrink
from vision.geometry.ellipse import Ellipse
from vision.grouping.hypotheses import MIN_SEMI_MINOR_PX
from vision.grouping.kalman_filter import FilterParameters, fit_ellipse, moment_estimate

NOISE_PX = 0.1


def noisy_points(ellipse, rng, n=120, part=1.0):
    points = ellipse.sample(int(n / part))[:n]
    gradient = np.column_stack([points, np.ones(n)]) @ ellipse.conic[:, :2]
    return points + gradient / np.hypot(*gradient.T)[:, None] * rng.normal(0, NOISE_PX, (n, 1))


ellipses = st.builds(
    lambda x, y, a, ratio, angle: Ellipse.from_geometric(x, y, a, a * ratio, angle),
    st.floats(0, 640),
    st.floats(0, 480),
    st.floats(8, 200),
    st.floats(0.3, 1.0),
    st.floats(0, 3.1),
)


@given(ellipses)
@settings(max_examples=40, deadline=None)
def test_exact_points_give_back_the_ellipse_from_the_moments_alone(ellipse):
    result = fit_ellipse(ellipse.sample(64))
    assert result is not None
    assert np.abs(ellipse.distance(result.ellipse.sample(32))).max() < 0.02
    assert result.fitting_error_px < 0.01


def test_circles_are_recovered_although_their_focal_points_coincide():
    rng = np.random.default_rng(0)
    circle = Ellipse.from_geometric(320, 240, 50, 50, 0.0)
    for _ in range(20):
        result = fit_ellipse(noisy_points(circle, rng))
        assert result is not None
        assert np.abs(result.ellipse.centre - circle.centre).max() < 0.06
        assert np.abs(np.array(result.ellipse.semi_axes) - 50).max() < 0.15
        assert np.linalg.eigvalsh(result.ellipse.covariance).min() > 0


@pytest.mark.parametrize(("geometric", "part"), [((320, 240, 100, 60, 0.5), 1.0), ((100, 90, 30, 24, 1.2), 0.6)])
def test_the_covariance_of_the_filter_is_honest(geometric, part):
    """The normalised squared error of 5 parameters is chi-square with 5 degrees of freedom."""
    rng = np.random.default_rng(1)
    truth = Ellipse.from_geometric(*geometric)
    normalised = []
    for _ in range(300):
        result = fit_ellipse(noisy_points(truth, rng, part=part), truth.p)
        assert result is not None
        error = result.ellipse.p - truth.p
        normalised.append(error @ np.linalg.solve(result.ellipse.covariance, error))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 5 * 300) / 300
    # The gate cuts the tails of the noise and the deviation is estimated: allow 10 % on top.
    assert 0.9 * low < np.mean(normalised) < 1.1 * high
    inside = np.mean(np.array(normalised) < chi2.ppf(0.95, 5))
    assert 0.9 < inside <= 0.99


def test_points_off_the_ellipse_are_gated():
    rng = np.random.default_rng(2)
    truth = Ellipse.from_geometric(200, 200, 80, 50, 0.3)
    points = noisy_points(truth, rng)
    points[::10] += 0.08 * (points[::10] - truth.centre)
    result = fit_ellipse(points, truth.p + 0.5 * np.array([1, -1, 1, 1, 1]))
    assert result is not None
    assert not result.inliers[::10].any()
    assert np.abs(result.ellipse.centre - truth.centre).max() < 0.1


def test_closer_points_than_the_correlation_length_count_for_less():
    rng = np.random.default_rng(3)
    truth = Ellipse.from_geometric(200, 200, 80, 50, 0.3)
    points = noisy_points(truth, rng)
    apart = fit_ellipse(points, truth.p, spacing_px=10.0)
    dense = fit_ellipse(points, truth.p, spacing_px=1.075)
    assert np.allclose(dense.ellipse.covariance, 4 * apart.ellipse.covariance, rtol=0.01)


@pytest.mark.parametrize("slope", [0.0, 0.3, 3.0])
def test_the_ellipse_of_points_on_a_line_is_flatter_than_any_that_can_be_seen(slope):
    x = np.linspace(0, 100, 50)
    result = fit_ellipse(np.column_stack([x, slope * x]))
    assert result is None or result.ellipse.semi_axes[1] < MIN_SEMI_MINOR_PX / 3


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.zeros((10, 3)), np.full((10, 2), np.nan)])
def test_bad_points_are_refused(points):
    with pytest.raises(InputError, match="edge points"):
        fit_ellipse(points)


def test_parameters_are_checked():
    with pytest.raises(InputError, match="gate of FilterParameters"):
        FilterParameters(gate=0)


@given(ellipses)
@settings(max_examples=30, deadline=None)
def test_distances_agree_with_sampson_to_first_order(ellipse):
    points = ellipse.sample(20) + 0.01
    homogeneous = np.column_stack([points, np.ones(len(points))])
    gradient = homogeneous @ ellipse.conic
    sampson = np.sum(gradient * homogeneous, axis=1) / (2 * np.hypot(gradient[:, 0], gradient[:, 1]))
    assert np.allclose(ellipse.distance(points), sampson, atol=2e-3)


def test_unshrinking_a_circle_makes_it_larger_by_half_the_variance_over_the_radius():
    circle = Ellipse.from_geometric(50, 60, 10, 10, 0.0)
    points = unshrink(circle.p, circle.sample(30), 1.44)
    assert np.allclose(np.hypot(*(points - (50, 60)).T), 10 + 1.44 / 20)


def test_the_moments_of_a_full_outline_are_the_ellipse():
    truth = Ellipse.from_geometric(50, 60, 30, 20, 0.7)
    estimate = Ellipse(moment_estimate(truth.sample(400)))
    assert np.allclose(estimate.geometric, truth.geometric, atol=0.01)
