import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.pose import absolute_orientation


@given(st.integers(0, 2**32 - 1))
def test_absolute_orientation_recovers_any_pose(seed):
    rng = np.random.default_rng(seed)
    truth = RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))
    points = rng.normal(size=(5, 3))
    found = absolute_orientation(points, truth.apply(points), rng.uniform(0.5, 2, 5))
    assert np.allclose(found.as_matrix(), truth.as_matrix(), atol=1e-9)


def test_absolute_orientation_never_mirrors():
    points = np.random.default_rng(0).normal(size=(8, 3))
    found = absolute_orientation(points, points * [1, 1, -1])
    assert np.linalg.det(found.rotation.as_matrix()) == pytest.approx(1)


@pytest.mark.parametrize(
    "points", [np.zeros((2, 3)), np.outer(np.arange(5.0), [1, 2, 3]), np.zeros((4, 2))], ids=["few", "line", "flat"]
)
def test_degenerate_points_are_refused(points):
    with pytest.raises(InputError, match="expected"):
        absolute_orientation(points, points)
