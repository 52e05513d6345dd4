"""First phase of matching: salient features of the model against extracted ellipses, over all views at once.

Every extracted ellipse, read as every salient circle of known radius, gives two candidate circles in space and so two
poses of the part up to the rotation about its axis. A candidate gathers votes from the ellipses, in its own view and
in the others, that its salient circles would make (Section 6: correspondence by the intrinsic attributes of salient
features; the epipolar constraint is implied, for a candidate is a point in space).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from vision.features import EllipseFeature
from vision.frozen import frozen_arrays
from vision.geometry.camera import View, camera_arrays
from vision.geometry.circle import circle_candidates, plane_axes
from vision.geometry.ellipse import conic_matrices
from vision.geometry.workspace import Workspace
from vision.kernels import njit
from vision.matching.votes import EllipseTable, count_votes
from vision.model.vision_model import SalientCircles, VisionModel

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


NEAR = 0.03  # of the part's diameter: candidates nearer to each other, with axes alike, are one
PARALLEL_RAD = np.radians(8.0)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Candidates:
    """Candidate poses up to the rotation about the part's axis.

    Attributes:
        origin: (N, 3) the part's origin in the world, metres.
        axis: (N, 3) the part's z axis in the world.
        votes: (N,) support gathered from the salient circles.
        matches: (N, V, K) index of the ellipse matched to salient circle k in view v, -1 for none.
        seed: (N, 3) view, ellipse and salient circle that the candidate was made from.
        preferred: (N,) whether the ellipse comes from the extractor that was taught for that circle.
    """

    origin: Array
    axis: Array
    votes: Array
    matches: Indices
    seed: Indices
    preferred: NDArray[np.bool_]

    def __len__(self) -> int:
        """Number of candidates."""
        return len(self.votes)

    def take(self, index: Indices) -> Candidates:
        """The candidates with these indices."""
        return Candidates(*(getattr(self, field.name)[index] for field in fields(self)))

    def poses(self) -> Array:
        """T_world_part (N, 4, 4), with an arbitrary rotation about the axis."""
        return poses_of(self.origin, self.axis)

    def distinct(self, diameter_m: float, limit: int = 600) -> Candidates:
        """The best of each bunch of near-identical candidates, among the first ``limit``, best first.

        It is preferred where any of the bunch is.
        """
        n = min(len(self), limit)
        preferred = self.preferred[:n].copy()
        distinct = _distinct(self.origin[:n], self.axis[:n], NEAR * diameter_m, np.cos(PARALLEL_RAD), preferred)
        chosen = np.flatnonzero(distinct)
        return replace(self.take(chosen), preferred=preferred[chosen])


@njit(cache=True)
def _distinct(origin, axis, near_m, parallel, preferred):
    """Which candidates (N,) are not alike one kept before them; those kept are preferred where any like them is."""
    kept, alike = np.ones(len(origin), np.bool_), preferred.copy()
    for i in range(len(origin)):
        if not kept[i]:
            continue
        for k in range(len(origin)):
            x, y, z = origin[k, 0] - origin[i, 0], origin[k, 1] - origin[i, 1], origin[k, 2] - origin[i, 2]
            if k == i or np.sqrt(x * x + y * y + z * z) >= near_m:
                continue
            if axis[k, 0] * axis[i, 0] + axis[k, 1] * axis[i, 1] + axis[k, 2] * axis[i, 2] > parallel:
                preferred[i] |= alike[k]
                kept[k] &= k < i
    return kept


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
    table = EllipseTable.of(features)
    votes, matches = count_votes(poses_of(origin, axis), camera_arrays(views), salient, table)
    taught = [f.extractor for f in model.salient]
    preferred = np.array([features[v][m].extractor == taught[k] for v, m, k in seed], dtype=bool)
    order = np.argsort(-votes, kind="stable")
    return Candidates(origin, axis, votes, matches, seed, preferred).take(order)


def poses_of(origin: Array, axis: Array) -> Array:
    """T_world_part (N, 4, 4) of origins and z axes (N, 3), with an arbitrary rotation about the axis."""
    T = np.zeros((len(origin), 4, 4))
    u, v = plane_axes(axis)
    T[:, :3, 0], T[:, :3, 1], T[:, :3, 2], T[:, :3, 3], T[:, 3, 3] = u, v, axis, origin, 1.0
    return T


def _readings(
    views: Sequence[View], features: Sequence[Sequence[EllipseFeature]], salient: SalientCircles
) -> tuple[Array, Array, Indices]:
    """Origin, axis and seed of every reading of every ellipse as every salient circle."""
    origins, axes, seeds = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty((0, 3), np.intp)]
    for v, (view, found) in enumerate(zip(views, features, strict=True)):
        if not found:
            continue
        conics = conic_matrices(np.array([f.ellipse.p for f in found]))
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
