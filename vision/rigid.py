"""Rigid motions as callers give them: checked once, at the door."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from vision.errors import InputError

TOLERANCE = 1e-4  # for matrices that were written with five decimals
EXPECTED = "a scipy RigidTransform, or a 4x4 matrix of a rigid motion"


def rigid_transform(value: object, what: str) -> RigidTransform:
    """The rigid motion that a value is.

    Args:
        value: a single ``RigidTransform``, or a 4x4 matrix: a rotation without reflection, a translation, and the
            row (0, 0, 0, 1).
        what: names the value in errors.

    Raises:
        InputError: when it is none.
    """
    if isinstance(value, RigidTransform):
        if not value.single or not np.isfinite(value.as_matrix()).all():
            raise InputError(what, got=value, expected="one finite rigid motion")
        return value
    try:
        matrix = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InputError(what, got=f"{type(value).__name__} object", expected=EXPECTED) from None
    if matrix.shape != (4, 4):
        raise InputError(what, got="None" if value is None else f"shape {matrix.shape}", expected=EXPECTED)
    if not np.isfinite(matrix).all() or not _is_rigid(matrix):
        raise InputError(what, got=matrix.tolist(), expected=EXPECTED)
    matrix[3] = 0.0, 0.0, 0.0, 1.0  # scipy takes nothing else
    return RigidTransform.from_matrix(matrix)


def _is_rigid(matrix: np.ndarray) -> bool:
    rotation = matrix[:3, :3]
    if np.abs(rotation).max() > 2:  # the product of larger numbers could overflow
        return False
    off = max(np.abs(rotation @ rotation.T - np.eye(3)).max(), np.abs(matrix[3] - [0, 0, 0, 1]).max())
    return bool(off < TOLERANCE and np.linalg.det(rotation) > 0)
