import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from vision.geometry.ellipse import Ellipse, focal_distances, focal_jacobian, focal_residual
from vision.grouping import kalman_filter


def arc(semi_major, semi_minor, rng, n=80, part=1.0):
    truth = Ellipse.from_geometric(200.3, 150.8, semi_major, semi_minor, 0.7)
    points = truth.sample(int(n / part))[:n]
    return truth, points + rng.normal(0, 0.2, points.shape)


def textbook_update(prior, prior_px, points, deviation):
    """All points in one batch through the filter of a well-known library."""
    _, slope = focal_distances(prior, points)
    ekf = ExtendedKalmanFilter(dim_x=5, dim_z=len(points))
    ekf.x = prior[:, None].copy()
    ekf.P = np.eye(5) * prior_px**2
    ekf.R = np.diag((slope * deviation) ** 2)
    ekf.update(
        np.zeros((len(points), 1)),
        HJacobian=lambda x: focal_jacobian(x[:, 0], points),
        Hx=lambda x: focal_residual(x[:, 0], points)[:, None],
    )
    return ekf.x[:, 0], ekf.P


@pytest.mark.parametrize(("axes", "part"), [((90, 60), 1.0), ((40, 40), 1.0), ((120, 30), 0.5), ((9, 7), 1.0)])
def test_the_information_form_gives_the_update_of_the_textbook(axes, part):
    rng = np.random.default_rng(0)
    truth, points = arc(*axes, rng, part=part)
    prior = truth.p + rng.normal(0, 0.5, 5)
    estimate = np.empty(5)
    covariance = kalman_filter.update(prior, prior, 20.0, points, np.ones(len(points), bool), 0.2, estimate)
    expected, expected_covariance = textbook_update(prior, 20.0, points, 0.2)
    assert np.allclose(estimate, expected, atol=1e-6)
    assert np.allclose(covariance, expected_covariance, atol=1e-6 * expected_covariance.max())


def test_points_that_are_left_out_change_nothing():
    rng = np.random.default_rng(1)
    truth, points = arc(60, 40, rng)
    inliers = np.ones(len(points), bool)
    inliers[::5] = False
    with_all, without = np.empty(5), np.empty(5)
    moved = points.copy()
    moved[~inliers] += 100
    kalman_filter.update(truth.p, truth.p, 20.0, moved, inliers, 0.2, with_all)
    kalman_filter.update(truth.p, truth.p, 20.0, points[inliers], np.ones(inliers.sum(), bool), 0.2, without)
    assert np.allclose(with_all, without)


def test_measured_distances_are_the_residual_over_its_gradient():
    rng = np.random.default_rng(2)
    truth, points = arc(60, 25, rng)
    distance, slope = focal_distances(truth.p, points)
    step = np.array([[1e-6, 0], [0, 1e-6]])
    gradient = [(focal_residual(truth.p, points + d) - focal_residual(truth.p, points - d)) / 2e-6 for d in step]
    assert np.allclose(slope, np.hypot(*gradient), atol=1e-6)
    assert np.allclose(distance, focal_residual(truth.p, points) / slope)
