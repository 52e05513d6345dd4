"""Votes of the extracted ellipses of all views for each candidate pose (Section 6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vision.features import EllipseFeature
from vision.frozen import read_only
from vision.geometry.camera import CameraArrays
from vision.geometry.ellipse import geometric_parameters
from vision.geometry.focal_form import conic_to_geometric
from vision.model.projection import GRAZING_COSINE
from vision.model.vision_model import SalientCircles
from vision.pose.observations import POINTS_PER_ELLIPSE

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class Tolerance(NamedTuple):
    """How far an ellipse may be from the prediction: pixels, and a share of its semi-major axis."""

    px: float
    share: float


CENTRE_TOLERANCE = Tolerance(2.5, 0.03)
MAJOR_TOLERANCE = Tolerance(1.5, 0.03)
MINOR_TOLERANCE = Tolerance(2.0, 0.10)  # the tilt of a circle seen face on is ill determined


def count_votes(
    poses: Array, cameras: CameraArrays, circles: SalientCircles, table: EllipseTable, slack: float = 1.0
) -> tuple[Array, Indices]:
    """Votes (N,) and matches (N, V, K) of poses (N, 4, 4).

    A match counts with the support of its ellipse, discounted by how far it is from the prediction in units of the
    tolerances, and with the square root of the circle's size: large circles are rarer by chance.

    Args:
        poses: T_world_part; the rotation about the part's axis has no effect.
        cameras: of the views.
        circles: the salient circles.
        table: the ellipses.
        slack: factor on the tolerances.

    Returns:
        The votes, and for every view and circle the number of the matched ellipse within its view, -1 for none.
    """
    n, views, k = len(poses), len(cameras.intrinsics), len(circles.radius)
    votes, matches = np.zeros(n), np.full((n, views, k), -1, np.intp)
    _tally_votes(poses, cameras, circles, table, float(slack), votes, matches)
    return votes, matches


@njit(cache=True)
def predict_circle(T, intrinsics, height, side, radius, out):
    """The ellipse that a circle about the part's axis makes in a view; False when it is turned away.

    The cone of rays d through a circle of centre c, normal n and radius r is
    (n.c)² d.d - 2 (n.c)(n.d)(c.d) + (c.c - r²)(n.d)² = 0; in pixels it is the ellipse's conic.

    Args:
        T: (4, 4) T_camera_part.
        intrinsics: fx, fy, cx, cy.
        height: of the circle along z.
        side: +1 or -1, the direction of its normal along z.
        radius: metres.
        out: (5,) centre x, y, semi-axes, angle; written to.
    """
    fx, fy = intrinsics[0], intrinsics[1]
    nx, ny, nz = side * T[0, 2], side * T[1, 2], side * T[2, 2]
    px, py, pz = T[0, 3] + height * T[0, 2], T[1, 3] + height * T[1, 2], T[2, 3] + height * T[2, 2]
    square = px * px + py * py + pz * pz
    nc = nx * px + ny * py + nz * pz
    if pz <= radius or -nc <= GRAZING_COSINE * np.sqrt(square):
        return False
    s, q = nc * nc, square - radius * radius
    a = (s - 2 * nc * nx * px + q * nx * nx) / (fx * fx)
    b = (-nc * (nx * py + ny * px) + q * nx * ny) / (fx * fy)
    c = (s - 2 * nc * ny * py + q * ny * ny) / (fy * fy)
    d = (-nc * (nx * pz + nz * px) + q * nx * nz) / fx
    e = (-nc * (ny * pz + nz * py) + q * ny * nz) / fy
    f = s - 2 * nc * nz * pz + q * nz * nz
    if not conic_to_geometric(a, b, c, d, e, f, out):
        return False
    out[0] += intrinsics[2]
    out[1] += intrinsics[3]
    return True


@njit(cache=True)
def _tally_votes(poses, cameras, circles, table, slack, votes, matches):
    T_camera_world, intrinsics = cameras.T_camera_world, cameras.intrinsics
    height, side, radius = circles.height, circles.side, circles.radius
    first, geometric, support = table.first, table.geometric, table.support
    largest = radius.max()
    predicted = np.empty(5)
    for i in range(len(poses)):
        for v in range(len(T_camera_world)):
            T = T_camera_world[v] @ poses[i]
            for k in range(len(radius)):
                if not predict_circle(T, intrinsics[v], height[k], side[k], radius[k], predicted):
                    continue
                scale = predicted[2]
                best = 0.0
                for m in range(first[v], first[v + 1]):
                    seen = geometric[m]
                    apart = np.hypot(predicted[0] - seen[0], predicted[1] - seen[1])
                    cost = apart / (CENTRE_TOLERANCE.px + CENTRE_TOLERANCE.share * scale) / slack
                    if cost >= 1:
                        continue
                    major = abs(scale - seen[2]) / (MAJOR_TOLERANCE.px + MAJOR_TOLERANCE.share * scale)
                    minor = abs(predicted[3] - seen[3]) / (MINOR_TOLERANCE.px + MINOR_TOLERANCE.share * scale)
                    cost = max(cost, major / slack, minor / slack)
                    gain = support[m] * (1 - 0.5 * cost) if cost < 1 else 0.0
                    if gain > best:
                        best = gain
                        matches[i, v, k] = m - first[v]
                votes[i] += best * np.sqrt(radius[k] / largest)


class EllipseTable(NamedTuple):
    """All ellipses as the compiled loops read them, those of the first view first.

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

    @classmethod
    def of(
        cls, features: Sequence[Sequence[EllipseFeature]], points_per_ellipse: int = POINTS_PER_ELLIPSE
    ) -> EllipseTable:
        """Tabulate the features of every view, with about ``points_per_ellipse`` evenly chosen edge points each."""
        flat = [f for found in features for f in found]
        points = [f.points[:: max(len(f.points) // points_per_ellipse, 1)] for f in flat]
        table = cls(
            _starts([len(found) for found in features]),
            geometric_parameters(np.array([f.ellipse.p for f in flat]).reshape(-1, 5)),
            np.array([f.support for f in flat], dtype=np.float64),
            _starts([len(p) for p in points]),
            np.vstack([np.empty((0, 2)), *points]),
        )
        return read_only(table)


def _starts(lengths: Sequence[int]) -> Indices:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.intp)
