"""Only rigid motions pass."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.geometry.camera import rigid_transform

POSE = RigidTransform.from_components([1.0, 2.0, 3.0], Rotation.from_rotvec([0.3, -2.0, 0.4]))


def test_a_rigid_transform_passes_untouched():
    assert rigid_transform(POSE, "pose") is POSE


@pytest.mark.parametrize("given", [POSE.as_matrix(), POSE.as_matrix().tolist()], ids=["array", "lists"])
def test_a_matrix_becomes_one(given):
    assert np.allclose(rigid_transform(given, "pose").as_matrix(), POSE.as_matrix(), rtol=0, atol=1e-15)


@pytest.mark.parametrize("place", [(0, 0), (2, 1), (3, 0), (3, 3)])
def test_what_is_off_by_more_than_rounding_is_refused(place):
    for off, good in ((1e-5, True), (1e-3, False)):
        matrix = POSE.as_matrix()
        matrix[place] += off
        if good:
            rigid_transform(matrix, "pose")
            continue
        with pytest.raises(InputError, match=r"^pose: got .*; expected a scipy RigidTransform, or a 4x4"):
            rigid_transform(matrix, "pose")


@pytest.mark.parametrize("value", [None, "up", 5, [[1, 2], [3]], np.full((4, 4), 1e200), {}], ids=str)
def test_anything_else_is_refused(value):
    with pytest.raises(InputError, match="pose"):
        rigid_transform(value, "pose")
