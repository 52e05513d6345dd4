"""The filter point by point arrives where the batch does, ever surer of itself."""

from __future__ import annotations

import numpy as np
import pytest

from vision.drawing.filter_history import filter_history
from vision.errors import InputError
from vision.geometry.ellipse import Ellipse
from vision.grouping.kalman_filter import fit_ellipse


def noisy(seed, n=200, sigma=0.3):
    rng = np.random.default_rng(seed)
    truth = Ellipse.from_geometric(210.0, 160.0, 90.0, 55.0, 0.6)
    points = truth.sample(n) + rng.normal(scale=sigma, size=(n, 2))
    return truth, points[rng.permutation(n)]


@pytest.mark.parametrize("seed", [10_031, 10_032, 10_033])
def test_it_ends_where_the_batch_ends(seed):
    truth, points = noisy(seed)
    last = list(filter_history(points))[-1]
    assert last.points == len(points)
    batch = fit_ellipse(points).ellipse
    assert np.abs(last.ellipse.geometric[:4] - batch.geometric[:4]).max() < 0.3
    assert np.abs(last.ellipse.geometric[:4] - truth.geometric[:4]).max() < 0.4


def test_uncertainty_never_grows():
    _, points = noisy(10_034)
    traces = [np.trace(state.ellipse.covariance) for state in filter_history(points)]
    assert (np.diff(traces) < 1e-9).all()
    assert traces[-1] < 0.01 * traces[0]


@pytest.mark.parametrize("points", [np.zeros((3, 2)), np.full((9, 2), np.nan), np.zeros(8)])
def test_what_are_no_points_is_refused(points):
    with pytest.raises(InputError, match="edge points"):
        next(filter_history(points))
