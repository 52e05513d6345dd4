"""How good a pose is, how sure a rate is, and what counts as a success."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import chdtri

from benchmark.records.episode_record import NormalizedError, PoseErrors, PoseOffset

Array = NDArray[np.float64]
Estimate = TypeVar("Estimate")
Truth = TypeVar("Truth")

EXTRACTION_IOU = 0.8
"""A salient circle of a piece is *extracted* in a view when an ellipse overlaps its true image by more than this
intersection over union."""

EXTRACTION_VIEWS = 2
"""A piece is *extracted* when one and the same salient circle of it is so in at least this many views, the fewest
from which a pose can be had."""

MATCH_MSSD_FRACTION = 0.10
"""A piece is *matched* when the maximum symmetry-aware surface distance (MSSD) between the part in the estimated and
in the true pose is below this fraction of the part's diameter."""

HALF_VISIBLE = 0.5
"""Success rates are given over pieces that are at least half visible ..."""

BARELY_VISIBLE = 0.1
"""... and over pieces that are at least this visible. Pieces less visible are counted apart, in no rate."""

ELLIPSOID_SHARE = 0.95
"""The share of true poses that the ellipsoid of a pose's covariance is to hold."""

_MOST_HULL_POINTS = 2000
_CONTINUOUS_STEPS = 36


class SymmetryLike(Protocol):
    """Rotational symmetry about the part's z axis."""

    @property
    def fold(self) -> int | None:
        """Number of equal rotations in a turn; None for a continuous symmetry, 1 for none."""
        ...


@dataclass(frozen=True)
class Summary:
    """Mean, sample standard deviation and median of ``n`` values; None where too few values were given."""

    n: int
    mean: float | None
    std: float | None
    median: float | None


def is_extracted(ious: Sequence[Sequence[float]]) -> bool:
    """Whether a piece counts as extracted, from the best overlap with each of its salient circles in each view."""
    return any(sum(iou > EXTRACTION_IOU for iou in circle) >= EXTRACTION_VIEWS for circle in ious)


def match_limit_mm(diameter_m: float) -> float:
    """The MSSD in millimetres below which a piece of this diameter counts as matched."""
    return 1000 * MATCH_MSSD_FRACTION * diameter_m


def hull_points(vertices: Array) -> Array:
    """The points (M, 3) of a surface (N, 3) at which the MSSD can be attained; at most 2000.

    The displacement between two rigid poses is affine in the point and its length therefore convex: the maximum over
    a body lies on an extreme point of its convex hull. Of a hull with more than 2000 points, those that are extreme
    in evenly spread directions are kept.
    """
    vertices = np.asarray(vertices, dtype=float)
    try:
        extreme = vertices[ConvexHull(vertices).vertices]
    except QhullError:  # flat: every point may be extreme
        extreme = vertices
    if len(extreme) <= _MOST_HULL_POINTS:
        return extreme
    support = extreme @ _directions(_MOST_HULL_POINTS).T
    return extreme[np.unique(support.argmax(axis=0))]


def mssd_mm(
    T_world_estimate: RigidTransform, T_world_truth: RigidTransform, symmetry: SymmetryLike, points: Array
) -> float:
    """Maximum surface distance between two poses, least over the part's symmetries, in millimetres.

    Args:
        T_world_estimate: the estimated pose.
        T_world_truth: the true pose.
        symmetry: of the part about its z axis.
        points: (N, 3) in metres in the part's frame, best from ``hull_points``.
    """
    T_truth_estimate = T_world_truth.inv() * T_world_estimate
    rotations = _symmetry_rotations(symmetry.fold, T_truth_estimate.rotation)
    turned = np.einsum("kij,nj->kni", (T_truth_estimate.rotation * rotations).as_matrix(), points)
    displacement = turned + T_truth_estimate.translation - points
    return float(1000 * np.sqrt((displacement**2).sum(axis=2).max(axis=1).min()))


def pose_errors(
    T_world_estimate: RigidTransform, T_world_truth: RigidTransform, symmetry: SymmetryLike, points: Array
) -> PoseErrors:
    """All errors of an estimated pose; the arguments are those of ``mssd_mm``."""
    T_truth_estimate = T_world_truth.inv() * T_world_estimate
    rotation = T_truth_estimate.rotation
    tilt = _tilt(rotation)
    if symmetry.fold is None:
        inplane, geodesic = None, tilt  # the best turn about the axis removes the whole twist
    else:
        step = 2 * math.pi / symmetry.fold
        inplane = abs(math.remainder(_twist(rotation), step))
        geodesic = float(_nearest(symmetry.fold, rotation).magnitude())
    return PoseErrors(
        translation_mm=float(1000 * np.linalg.norm(T_truth_estimate.translation)),
        tilt_deg=math.degrees(tilt),
        inplane_deg=None if inplane is None else math.degrees(inplane),
        rotation_deg=math.degrees(geodesic),
        mssd_mm=mssd_mm(T_world_estimate, T_world_truth, symmetry, points),
    )


def pose_offset(
    T_world_estimate: RigidTransform,
    T_world_truth: RigidTransform,
    symmetry: SymmetryLike,
    *,
    inplane_known: bool = True,
) -> PoseOffset:
    """The way from the true pose to an estimated one; the arguments are those of ``normalized_error``."""
    T_truth_estimate = T_world_truth.inv() * T_world_estimate
    turn = _nearest(symmetry.fold if inplane_known else None, T_truth_estimate.rotation)
    return PoseOffset(
        translation_mm=tuple((1000 * T_truth_estimate.translation).tolist()),
        rotation_deg=tuple(turn.as_rotvec(degrees=True).tolist()),
    )


def normalized_error(
    T_world_estimate: RigidTransform,
    covariance: Array,
    T_world_truth: RigidTransform,
    symmetry: SymmetryLike,
    *,
    inplane_known: bool = True,
) -> NormalizedError | None:
    """The error of a pose, squared, in units of the covariance that came with it.

    Args:
        T_world_estimate: the estimated pose.
        covariance: (6, 6) of the estimate, metres and radians.
        T_world_truth: the true pose.
        symmetry: of the part about its z axis.
        inplane_known: as of :func:`error_vector`.

    Returns:
        None where the covariance is not (6, 6), finite, symmetric and positive definite.
    """
    if np.shape(covariance) != (6, 6):
        return None
    error, counted = error_vector(T_world_estimate, T_world_truth, symmetry, inplane_known=inplane_known)
    squared = _squared_in_units_of(counted.T @ covariance @ counted, counted.T @ error)
    return None if squared is None else NormalizedError(squared, counted.shape[1])


def error_vector(
    T_world_estimate: RigidTransform, T_world_truth: RigidTransform, symmetry: SymmetryLike, *, inplane_known: bool
) -> tuple[Array, Array]:
    """The error of a pose in the order and the frame of ``PoseEstimate.covariance``.

    That is, the translation and then the rotation vector that lead from the true pose to the estimate, both in the
    world frame and about the part's origin. Of the poses that look the same, the nearest one is the true pose.

    Args:
        T_world_estimate: the estimated pose.
        T_world_truth: the true pose.
        symmetry: of the part about its z axis.
        inplane_known: False leaves the rotation about the estimated axis out, as a continuous symmetry does.

    Returns:
        The error (6,) in metres and radians, and the K directions (6, K) in which it counts, orthonormal.
    """
    whole = inplane_known and symmetry.fold is not None
    T_truth_estimate = T_world_truth.inv() * T_world_estimate
    nearest = _nearest(symmetry.fold if whole else None, T_truth_estimate.rotation)
    turn = T_world_truth.rotation.apply(nearest.as_rotvec())  # the same rotation, with its axis in the world frame
    error = np.concatenate([T_world_estimate.translation - T_world_truth.translation, turn])
    counted = np.eye(6)
    if not whole:
        across_axis = T_world_estimate.rotation.as_matrix()[:, :2]
        counted = np.block([[np.eye(3), np.zeros((3, 2))], [np.zeros((3, 3)), across_axis]])
    return error, counted


def is_inside_ellipsoid(error: NormalizedError) -> bool:
    """Whether the true pose lies in the ellipsoid of the estimate that is to hold ``ELLIPSOID_SHARE`` of them."""
    return bool(error.squared < chdtri(error.components, 1 - ELLIPSOID_SHARE))


@dataclass(frozen=True)
class Assignment:
    """Estimates given to true pieces, one to one.

    Attributes:
        pairs: (index of the estimate, index of the piece), sorted by piece.
        false_positives: indices of estimates that belong to no piece.
    """

    pairs: tuple[tuple[int, int], ...]
    false_positives: tuple[int, ...]


def assign(
    estimates: Sequence[Estimate],
    truths: Sequence[Truth],
    cost: Callable[[Estimate, Truth], float],
    limit: Callable[[Truth], float],
) -> Assignment:
    """Give estimates to pieces one to one: as many pairs as possible below the limit, then the least cost.

    Args:
        estimates: what a localizer found.
        truths: the pieces that are there.
        cost: of a pair, for example its MSSD; infinite for a pair that cannot be, such as of different parts.
        limit: of a piece: a pair that costs as much or more is none. With ``match_limit_mm`` the pairs are exactly
            the matched pieces.
    """
    if not estimates or not truths:
        return Assignment((), tuple(range(len(estimates))))
    # Costs relative to the limit are below 1; a pair that is none costs more than all good pairs together.
    relative = np.array([[cost(e, t) / limit(t) for t in truths] for e in estimates])
    good = relative < 1
    forbidden = 1.0 + min(relative.shape)
    rows, columns = linear_sum_assignment(np.where(good, relative, forbidden))
    pairs = [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if good[i, j]]
    taken = {i for i, _ in pairs}
    spare = tuple(i for i in range(len(estimates)) if i not in taken)
    return Assignment(tuple(sorted(pairs, key=lambda pair: pair[1])), spare)


def wilson_interval(successes: float, n: float, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson score interval of a rate; (0, 1), which says nothing, for n = 0. Counts need not be whole."""
    if n == 0:
        return 0.0, 1.0
    z = statistics.NormalDist().inv_cdf((1 + confidence) / 2)
    rate = successes / n
    centre = rate + z * z / (2 * n)
    half = z * math.sqrt(rate * (1 - rate) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    low = 0.0 if successes == 0 else (centre - half) / scale
    high = 1.0 if successes == n else (centre + half) / scale
    return low, high


def summarise(values: Sequence[float]) -> Summary:
    """Mean, sample standard deviation and median; exact sums, so that the order of the values does not matter."""
    n = len(values)
    if n == 0:
        return Summary(0, None, None, None)
    mean = math.fsum(values) / n
    std = math.sqrt(math.fsum((v - mean) ** 2 for v in values) / (n - 1)) if n > 1 else None
    return Summary(n, mean, std, statistics.median(values))


def _squared_in_units_of(covariance: Array, error: Array) -> float | None:
    """error^T covariance^-1 error; None where the covariance is none."""
    # Metres and radians differ by orders of magnitude: only in units of each component can definiteness be told.
    scale = np.sqrt(np.diag(covariance).clip(min=0))
    if not (np.isfinite(covariance).all() and scale.all()):
        return None
    correlation = covariance / np.outer(scale, scale)
    try:
        root = np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        return None
    whitened = np.linalg.solve(root, error / scale)
    squared = float(whitened @ whitened)
    return squared if np.isfinite(squared) and np.allclose(correlation, correlation.T, atol=1e-6) else None


def _tilt(rotation: Rotation) -> float:
    """Angle between the z axes before and after; well conditioned for small angles, unlike arccos."""
    x, y, z, w = rotation.as_quat()
    return 2 * math.atan2(math.hypot(x, y), math.hypot(z, w))


def _twist(rotation: Rotation) -> float:
    """Angle about z that remains when the tilt is undone (swing-twist decomposition); 0 where it is undefined."""
    _, _, z, w = rotation.as_quat()
    return 2 * math.atan2(z, w)


def _symmetry_rotations(fold: int | None, rotation: Rotation) -> Rotation:
    """The part's symmetries, (K,); a continuous one as the untwisting of ``rotation`` and equal steps from there."""
    steps, start = (_CONTINUOUS_STEPS, -_twist(rotation)) if fold is None else (fold, 0.0)
    angles = start + 2 * math.pi * np.arange(steps) / steps
    return Rotation.from_rotvec(np.column_stack([np.zeros(steps), np.zeros(steps), angles]))


def _nearest(fold: int | None, rotation: Rotation) -> Rotation:
    """Of a rotation and those that look the same, the smallest."""
    alike = rotation * _symmetry_rotations(fold, rotation)
    return alike[int(np.argmin(alike.magnitude()))]


def _directions(n: int) -> Array:
    """(n, 3) unit vectors spread evenly over the sphere (Fibonacci lattice)."""
    i = np.arange(n) + 0.5
    z = 1 - 2 * i / n
    azimuth = math.pi * (1 + math.sqrt(5)) * i
    radius = np.sqrt(1 - z * z)
    return np.column_stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z])
