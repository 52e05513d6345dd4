import pickle

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from vision import InputError, PoseEstimate


def estimate(covariance):
    return PoseEstimate("hub", RigidTransform.identity(), covariance, 1.0, "region", 0.1, 3, True)


def test_the_covariance_is_a_read_only_copy_also_after_a_trip_to_another_process():
    given = np.eye(6)
    pose = estimate(given)
    given[0, 0] = 2.0
    for value in (pose, pickle.loads(pickle.dumps(pose))):
        assert value.covariance[0, 0] == 1.0
        with pytest.raises(ValueError, match="read-only"):
            value.covariance[0, 0] = 3.0


def test_a_covariance_of_another_shape_is_refused():
    with pytest.raises(InputError, match=r"\(6, 6\)"):
        estimate(np.eye(3))
