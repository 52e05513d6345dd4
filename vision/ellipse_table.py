"""The extracted ellipses of all views as arrays, for the compiled loops of matching."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.ellipse import geometric_parameters
from vision.features import EllipseFeature

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

POINTS_PER_ELLIPSE = 48


@dataclass(frozen=True, eq=False)
class EllipseTable:
    """All ellipses, those of the first view first.

    Attributes:
        first: (V + 1,) where each view's ellipses begin.
        geometric: (M, 5) centre x, y, semi-axes, angle.
        support: (M,) covered share of the circumference.
        first_point: (M + 1,) where each ellipse's edge points begin.
        points: (P, 2) a sample of the edge points, pixels.
    """

    first: Indices
    geometric: Array
    support: Array
    first_point: Indices
    points: Array

    @property
    def arrays(self) -> tuple[Indices, Indices, Array]:
        """Starts of the views and of the ellipses, and the points, for the compiled loops."""
        return self.first, self.first_point, self.points

    @classmethod
    def of(
        cls, features: Sequence[Sequence[EllipseFeature]], points_per_ellipse: int = POINTS_PER_ELLIPSE
    ) -> EllipseTable:
        """Tabulate the features of every view, with about ``points_per_ellipse`` evenly chosen edge points each."""
        flat = [f for found in features for f in found]
        points = [f.points[:: max(len(f.points) // points_per_ellipse, 1)] for f in flat]
        return cls(
            _starts([len(found) for found in features]),
            geometric_parameters(np.array([f.ellipse.p for f in flat]).reshape(-1, 5)),
            np.array([f.support for f in flat], dtype=np.float64),
            _starts([len(p) for p in points]),
            np.vstack([np.empty((0, 2)), *points]),
        )


def _starts(lengths: Sequence[int]) -> Indices:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.intp)
