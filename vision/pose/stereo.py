"""The pose by stereo, as the paper computes it (Section 7): correspondence, triangulation, absolute orientation.

A circle matched in two views is the same rim in both. The epipolar line of a point of its first ellipse meets its
second ellipse where the same point of the rim is seen; the two viewing rays meet in that point. The points of all
circles and all pairs of views together give the pose in closed form.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from vision.errors import InputError
from vision.features import EllipseFeature
from vision.geometry.camera import View
from vision.geometry.ellipse import Ellipse
from vision.model.vision_model import CoaxialCircle, SalientCircles

Array = NDArray[np.float64]

POINTS_PER_ELLIPSE = 24
PASSES = 2  # the first may take a few points of a far hypothesis for those on the other side
FEWEST_POINTS = 6
LEAST_CROSSING = 0.3
"""Sine of the angle at which an epipolar line crosses the ellipse, which is stretched to a circle."""
FARTHEST = 0.25
"""Share of the largest radius: points that far from where the hypothesis has the circle were matched wrongly."""
RIM_SIGMA_PX = 0.1
"""Rims are rounded, and no ellipse is more certain of them than that."""


def pose_by_stereo(
    T_world_part: Array,
    matches: NDArray[np.intp],
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    circles: SalientCircles,
    passes: int = PASSES,
) -> Array | None:
    """The pose from the salient circles that were matched in two or more views.

    Args:
        T_world_part: 4x4 pose of the hypothesis; it tells which of an epipolar line's two points is meant, and keeps
            its rotation about the part's axis, which coaxial circles leave open.
        matches: (V, K) number of the ellipse within its view, -1 for none.
        features: the ellipses of every view.
        views: with distortion-free lenses.
        circles: the salient circles.
        passes: how often it is computed, each time from the last result.

    Returns:
        4x4 pose, or None where fewer than two views share a circle.
    """
    T: Array | None = T_world_part
    for _ in range(passes):
        if T is not None:
            T = _closed_form(T, matches, features, views, circles)
    return T


def _closed_form(
    T_world_part: Array,
    matches: NDArray[np.intp],
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    circles: SalientCircles,
) -> Array | None:
    of_part, of_world, weights = rim_correspondences(T_world_part, matches, features, views, circles)
    if len(weights) < FEWEST_POINTS:
        return None
    return absolute_orientation(of_part, of_world, weights).as_matrix()


def rim_correspondences(
    T_world_part: Array,
    matches: NDArray[np.intp],
    features: Sequence[Sequence[EllipseFeature]],
    views: Sequence[View],
    circles: SalientCircles,
) -> tuple[Array, Array, Array]:
    """Points of the salient circles that two views see, triangulated; the arguments are those of `pose_by_stereo`.

    Returns:
        The points in the part's frame (N, 3), the same in the world (N, 3), and their weights (N,) in 1 / px².
    """
    of_part, of_world, weights = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    farthest_m = FARTHEST * circles.radius.max()
    for k in range(matches.shape[1]):
        seen = np.flatnonzero(matches[:, k] >= 0)
        for a, b in combinations(seen.tolist(), 2):
            pair = (views[a], views[b])
            ellipses = (features[a][matches[a, k]].ellipse, features[b][matches[b, k]].ellipse)
            model, points, weight = _rim_points(T_world_part, pair, ellipses, circles.circle(k), farthest_m)
            of_part.append(model)
            of_world.append(points)
            weights.append(weight)
    return np.vstack(of_part), np.vstack(of_world), np.concatenate(weights)


def triangulate(origins: Array, directions: Array) -> Array:
    """The points (N, 3) nearest to both rays of a pair; NaN where they are parallel.

    Args:
        origins: (2, 3) the cameras' centres.
        directions: (2, N, 3) of the rays.
    """
    u, v = directions / np.linalg.norm(directions, axis=2, keepdims=True)
    base = origins[1] - origins[0]
    cosine = np.einsum("ij,ij->i", u, v)
    along_u, along_v = u @ base, v @ base
    sine_squared = np.where(1 - cosine**2 > 1e-12, 1 - cosine**2, np.nan)
    s, t = (along_u - cosine * along_v) / sine_squared, (cosine * along_u - along_v) / sine_squared
    return np.asarray(0.5 * (origins[0] + s[:, None] * u + origins[1] + t[:, None] * v))


def corresponding_points(pixels: Array, views: tuple[View, View], ellipse: Ellipse) -> tuple[Array, Array]:
    """Where the epipolar lines of pixels in one view meet an ellipse in another.

    Args:
        pixels: (N, 2) in the first view.
        views: with distortion-free lenses.
        ellipse: in the second view.

    Returns:
        (2, N, 2) pixels in the second view, NaN where the line misses the ellipse, and (N,) how squarely the line
        crosses, 0 where it only touches and 1 where it runs through the centre.
    """
    first, second = views
    T = (second.T_world_camera.inv() * first.T_world_camera).as_matrix()
    K = second.camera.matrix
    epipole = K @ T[:3, 3]
    lines = np.cross(epipole, first.camera.rays(pixels) @ (K @ T[:3, :3]).T)
    major, minor = ellipse.semi_axes
    cosine, sine = np.cos(ellipse.angle), np.sin(ellipse.angle)
    axes = np.array([[major * cosine, -minor * sine], [major * sine, minor * cosine]])
    # With the ellipse as x = centre + axes (cos t, sin t), the line a x + b y + c = 0 is A cos t + B sin t + D = 0.
    A, B = (lines[:, :2] @ axes).T
    D = lines[:, :2] @ ellipse.centre + lines[:, 2]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = -D / np.hypot(A, B)
        apart = np.arccos(share)
        t = np.arctan2(B, A) + np.stack([apart, -apart])
        found = ellipse.centre + np.stack([np.cos(t), np.sin(t)], axis=2) @ axes.T
        return found, np.nan_to_num(np.sqrt(1 - share**2))


def _rim_points(
    T_world_part: Array,
    views: tuple[View, View],
    ellipses: tuple[Ellipse, Ellipse],
    rim: CoaxialCircle,
    farthest_m: float,
) -> tuple[Array, Array, Array]:
    """Points of a rim from two views: (N, 3) in the part's frame, (N, 3) in the world, and weights (N,)."""
    height, radius = rim.height, rim.radius
    pixels = ellipses[0].sample(POINTS_PER_ELLIPSE)
    partners, crossing = corresponding_points(pixels, views, ellipses[1])
    origins = np.stack([v.T_world_camera.translation for v in views])
    rays = [_world_rays(views[0], pixels), *(_world_rays(views[1], p) for p in partners)]
    points = np.stack([triangulate(origins, np.stack([rays[0], ray])) for ray in rays[1:]])
    in_part = (points - T_world_part[:3, 3]) @ T_world_part[:3, :3]
    off = np.hypot(np.linalg.norm(in_part[..., :2], axis=2) - radius, in_part[..., 2] - height)
    off = np.nan_to_num(off, nan=np.inf)
    nearer = off.argmin(axis=0), np.arange(len(pixels))
    kept = (off[nearer] < farthest_m) & (crossing > LEAST_CROSSING)
    seen = in_part[nearer][kept]
    # A point's place on the rim is its direction from the rim's own centre, not from where the hypothesis has it.
    direction = seen[:, :2] - _centre(seen[:, :2])
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    model = np.column_stack([radius * direction, np.full(len(direction), height)])
    variance = ellipses[0].variance_across(pixels) + ellipses[1].variance_across(np.nan_to_num(partners[nearer]))
    # Along the epipolar line, to which the depth is due, an error across the outline is larger by 1 / crossing.
    weight = crossing**2 / (variance + RIM_SIGMA_PX**2)
    return model, points[nearer][kept], weight[kept]


def _centre(points: Array) -> Array:
    """Of the circle through points (N, 2), by linear least squares of x² + y² = 2 a x + 2 b y + c."""
    rows = np.column_stack([2 * points, np.ones(len(points))])
    return np.asarray(np.linalg.lstsq(rows, (points**2).sum(axis=1), rcond=None)[0][:2])


def _world_rays(view: View, pixels: Array) -> Array:
    return np.asarray(view.camera.rays(pixels) @ view.T_world_camera.as_matrix()[:3, :3].T)


def absolute_orientation(
    points_part: ArrayLike, points_world: ArrayLike, weights: ArrayLike | None = None
) -> RigidTransform:
    """T_world_part that best carries points of the part onto points in the world (Section 7; the quaternion method).

    The unit quaternion is the eigenvector of the largest eigenvalue of Horn's 4x4 matrix (J. Opt. Soc. Am. A 4(4),
    1987).

    Args:
        points_part: (N, 3), N >= 3, not all on one line.
        points_world: (N, 3).
        weights: (N,) or None for equal ones.

    Raises:
        InputError: for fewer than three points, or points on a line.
    """
    a, b = np.asarray(points_part, dtype=float), np.asarray(points_world, dtype=float)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1:] != (3,) or len(a) < 3:
        raise InputError("point pairs", got=f"{a.shape} and {b.shape}", expected="two (N, 3) arrays with N >= 3")
    w = np.ones(len(a)) if weights is None else np.asarray(weights, dtype=float)
    w = w / w.sum()
    mean_a, mean_b = w @ a, w @ b
    a, b = a - mean_a, b - mean_b
    spread = np.linalg.svd(a * np.sqrt(w)[:, None], compute_uv=False)
    if spread[1] < 1e-9 * max(spread[0], 1e-12):
        raise InputError("points of the part", got="points on a line", expected="points that span a plane")
    S = (w[:, None] * a).T @ b
    trace = np.trace(S)
    delta = np.array([S[1, 2] - S[2, 1], S[2, 0] - S[0, 2], S[0, 1] - S[1, 0]])
    N = np.zeros((4, 4))
    N[0, 0] = trace
    N[0, 1:] = N[1:, 0] = delta
    N[1:, 1:] = S + S.T - trace * np.eye(3)
    w0, x, y, z = np.linalg.eigh(N)[1][:, -1]
    rotation = Rotation.from_quat([x, y, z, w0])
    return RigidTransform.from_components(mean_b - rotation.as_matrix() @ mean_a, rotation)
