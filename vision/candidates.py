"""First phase of matching: salient features of the model against extracted ellipses, over all views at once.

Every extracted ellipse, read as every salient circle of known radius, gives two candidate circles in space and so two
poses of the part up to the rotation about its axis. A candidate gathers votes from the ellipses, in its own view and
in the others, that its salient circles would make (Section 6: correspondence by the intrinsic attributes of salient
features; the epipolar constraint is implied, for a candidate is a point in space).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vision.camera import View
from vision.circle_pose import circle_candidates, circle_conics, conic_ellipses, plane_axes
from vision.features import EllipseFeature
from vision.vision_model import VisionModel

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

CENTRE_TOLERANCE = (2.5, 0.03)  # pixels, and share of the semi-major axis
MAJOR_TOLERANCE = (1.5, 0.03)
MINOR_TOLERANCE = (2.0, 0.10)  # the tilt of a circle seen face on is ill determined
FACING_COSINE = 0.12


@dataclass(frozen=True)
class Workspace:
    """The box in which parts can be, in the world frame, metres: known from the cell, like the pose of the bin."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def contains(self, points: Array, margin_m: float = 0.0) -> NDArray[np.bool_]:
        """Which of the points (N, 3) lie in the box, widened by a margin."""
        low, high = np.array(self.low) - margin_m, np.array(self.high) + margin_m
        return np.asarray(((points >= low) & (points <= high)).all(axis=-1))


@dataclass(frozen=True, eq=False)
class Candidates:
    """Candidate poses up to the rotation about the part's axis.

    Attributes:
        origin: (N, 3) the part's origin in the world, metres.
        axis: (N, 3) the part's z axis in the world.
        votes: (N,) support gathered from the salient circles.
        matches: (N, V, K) index of the ellipse matched to salient circle k in view v, -1 for none.
        seed: (N, 3) view, ellipse and salient circle that the candidate was made from.
    """

    origin: Array
    axis: Array
    votes: Array
    matches: Indices
    seed: Indices

    def __len__(self) -> int:
        """Number of candidates."""
        return len(self.votes)

    def take(self, index: Indices) -> Candidates:
        """The candidates with these indices."""
        return Candidates(
            self.origin[index], self.axis[index], self.votes[index], self.matches[index], self.seed[index]
        )

    def pose(self, i: int) -> Array:
        """4x4 T_world_part of candidate i, with an arbitrary rotation about the axis."""
        T = np.eye(4)
        u, v = plane_axes(self.axis[i])
        T[:3, :3] = np.column_stack([u, v, self.axis[i]])
        T[:3, 3] = self.origin[i]
        return T

    def distinct(self, diameter_m: float, limit: int = 600) -> Candidates:
        """The best of each bunch of near-identical candidates, among the first ``limit``, best first."""
        n = min(len(self), limit)
        origin, axis = self.origin[:n], self.axis[:n]
        alive = np.ones(n, bool)
        chosen = []
        for i in range(n):
            if not alive[i]:
                continue
            chosen.append(i)
            near = np.linalg.norm(origin - origin[i], axis=1) < 0.03 * diameter_m
            alive &= ~(near & (axis @ axis[i] > np.cos(np.radians(8))))
        return self.take(np.array(chosen, dtype=np.intp))


@dataclass(frozen=True, eq=False)
class SalientCircles:
    """The salient circles as arrays: height along z (K,), side (K,) +1 or -1, radius (K,) in metres."""

    height: Array
    side: Array
    radius: Array

    @classmethod
    def of(cls, model: VisionModel) -> SalientCircles:
        """Of a model; salient features are coaxial circles."""
        circles = [f.circle for f in model.salient]
        return cls(
            np.array([c.centre[2] for c in circles]),
            np.sign([c.normal[2] for c in circles]),
            np.array([c.radius_m for c in circles]),
        )


def find_candidates(
    views: Sequence[View],
    features: Sequence[Sequence[EllipseFeature]],
    model: VisionModel,
    workspace: Workspace | None,
) -> Candidates:
    """All candidates inside the workspace, with their votes, best first."""
    salient = SalientCircles.of(model)
    origin, axis, seed = _readings(views, features, salient)
    if workspace is not None:
        keep = workspace.contains(origin, margin_m=0.25 * model.diameter_m)
        origin, axis, seed = origin[keep], axis[keep], seed[keep]
    votes, matches = vote(origin, axis, views, features, salient)
    return Candidates(origin, axis, votes, matches, seed).take(np.argsort(-votes, kind="stable"))


def _readings(
    views: Sequence[View], features: Sequence[Sequence[EllipseFeature]], salient: SalientCircles
) -> tuple[Array, Array, Indices]:
    """Origin, axis and seed of every reading of every ellipse as every salient circle."""
    origins, axes, seeds = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty((0, 3), np.intp)]
    for v, (view, found) in enumerate(zip(views, features, strict=True)):
        if not found:
            continue
        conics = np.stack([f.ellipse.conic for f in found])
        centres, normals = circle_candidates(conics, view.camera.matrix)
        T = view.T_world_camera.as_matrix()
        normals = normals @ T[:3, :3].T
        m = np.repeat(np.arange(len(found)), 2)
        for k, (height, side, radius) in enumerate(zip(salient.height, salient.side, salient.radius, strict=True)):
            axis = side * normals
            origin = (centres * radius) @ T[:3, :3].T + T[:3, 3] - height * axis
            origins.append(origin.reshape(-1, 3))
            axes.append(axis.reshape(-1, 3))
            seeds.append(np.column_stack([np.full_like(m, v), m, np.full_like(m, k)]))
    return np.vstack(origins), np.vstack(axes), np.vstack(seeds)


def predict_salient(origin: Array, axis: Array, view: View, salient: SalientCircles) -> Array:
    """Ellipses (N, K, 5) that the salient circles of N candidates make in a view; NaN where turned away."""
    T = np.linalg.inv(view.T_world_camera.as_matrix())
    axis_camera = axis @ T[:3, :3].T
    origin_camera = origin @ T[:3, :3].T + T[:3, 3]
    centres = origin_camera[:, None] + salient.height[:, None] * axis_camera[:, None]
    normals = salient.side[:, None] * axis_camera[:, None]
    radii = np.broadcast_to(salient.radius, centres.shape[:2])
    facing = -np.einsum("nki,nki->nk", normals, centres) / np.linalg.norm(centres, axis=-1)
    visible = (facing > FACING_COSINE) & (centres[..., 2] > radii)
    ellipses = np.full((*visible.shape, 5), np.nan)
    conics = circle_conics(centres[visible], normals[visible], radii[visible], view.camera.matrix)
    ellipses[visible] = conic_ellipses(conics)
    return ellipses


def vote(
    origin: Array,
    axis: Array,
    views: Sequence[View],
    features: Sequence[Sequence[EllipseFeature]],
    salient: SalientCircles,
) -> tuple[Array, Indices]:
    """Votes (N,) and matches (N, V, K) of candidates.

    A match counts with the support of its ellipse, discounted by how far it is from the prediction in units of the
    tolerances, and with the square root of the circle's size: large circles are rarer by chance.
    """
    n, k = len(origin), len(salient.radius)
    votes = np.zeros(n)
    matches = np.full((n, len(views), k), -1, np.intp)
    size_weight = np.sqrt(salient.radius / salient.radius.max())
    for v, (view, found) in enumerate(zip(views, features, strict=True)):
        if not found or n == 0:
            continue
        predicted = predict_salient(origin, axis, view, salient)
        seen = np.stack([f.ellipse.geometric for f in found])
        support = np.array([f.support for f in found])
        cost = _discrepancy(predicted, seen)
        gain = np.where(cost < 1, support * (1 - 0.5 * cost), 0.0)
        best = gain.argmax(axis=2)
        value = np.take_along_axis(gain, best[..., None], axis=2)[..., 0]
        matches[:, v] = np.where(value > 0, best, -1)
        votes += value @ size_weight
    return votes, matches


def _discrepancy(predicted: Array, seen: Array) -> Array:
    """(N, K, M) largest deviation between predicted (N, K, 5) and seen (M, 5) ellipses in units of tolerance."""
    p, s = predicted[:, :, None], seen[None, None]
    scale = p[..., 2]

    def units(deviation: Array, tolerance: tuple[float, float]) -> Array:
        return np.asarray(deviation / (tolerance[0] + tolerance[1] * scale))

    centre = units(np.hypot(p[..., 0] - s[..., 0], p[..., 1] - s[..., 1]), CENTRE_TOLERANCE)
    major = units(np.abs(p[..., 2] - s[..., 2]), MAJOR_TOLERANCE)
    minor = units(np.abs(p[..., 3] - s[..., 3]), MINOR_TOLERANCE)
    cost = np.maximum(np.maximum(centre, major), minor)
    return np.where(np.isfinite(cost), cost, np.inf)
