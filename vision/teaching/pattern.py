"""What is drawn on a face besides the taught circles: slots, ears, whatever else says how a part is turned.

Nobody clicks these edges. Once the part's frame is known in all taught views they follow from the pictures: put back
into a plane across the axis, the edges that lie in that plane coincide whichever view they were seen in, and in every
copy that the part's symmetry makes of them. Edges at another height move by parallax, occluding contours and
highlights with the camera, and a shadow is not symmetric. So a plane that carries edges gives itself away: the
heights are searched through, and hardly anything agrees anywhere else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from vision.edges.edge_map import EdgeMap, detect_edges
from vision.frozen import frozen_arrays
from vision.geometry.camera import View
from vision.model.vision_model import CircleFeature, Pattern

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FEWEST_VIEWS = 3
LEAST_FACING_COSINE = 0.35  # views that graze a face tell little of it
AGREEING_SHARE = 0.6
"""Of the views of all copies, more than this share has to show an edge: two thirds do, three of five views do not."""

ACROSS_PX = 0.6
ALONG_PX = 1.5
DIRECTION_RAD = np.radians(12.0)
TANGENTIAL_RAD = np.radians(20.0)
"""An edge nearer than this to the direction around the axis stays where it is when the part turns."""

SWEEP_STEP = 0.004  # of the part's diameter; half a step displaces an edge by a quarter of a pixel
SWEEP_STRIDE = 8  # of the edge points from which the heights are found
SPACING = 0.01  # of the part's diameter
HOLE_MARGIN = 1.25  # around a taught hole lie its chamfer and its far rim
FEWEST_POINTS = 12

_REFINEMENTS = 2


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _PlaneEdges:
    """Edge points of one view, put back into a plane across the axis.

    Attributes:
        points: (N, 2) metres, x and y in the part's frame.
        directions: (N, 2) unit tangents, the brighter side always on the same hand.
        slopes: (N, 2) by how much a point moves when the plane rises, metres per metre.
    """

    points: Array
    directions: Array
    slopes: Array

    def __getitem__(self, kept: NDArray[np.generic] | slice) -> _PlaneEdges:
        return _PlaneEdges(self.points[kept], self.directions[kept], self.slopes[kept])


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Agreement:
    """How the views of all copies see each of P edge points.

    Attributes:
        share: (P,) of the views of all copies that show it.
        offset: (P,) metres along its normal to where they show it on average.
        direction: (P, 2) in which they show it running on average.
        rise_m: by which the plane has to be raised for the views to agree best.
    """

    share: Array
    offset: Array
    direction: Array
    rise_m: float


def learn_patterns(
    views: Sequence[View], features: Sequence[CircleFeature], diameter_m: float, fold: int | None
) -> tuple[Pattern, ...]:
    """The patterns that the taught views show on both faces.

    Args:
        views: the taught views, with distortion-free lenses; their world frame is the part's frame.
        features: the taught circles.
        diameter_m: outline diameter.
        fold: number of rotations about z that look the same; where all do, no pattern can tell them apart.

    Returns:
        Those of the front, then those of the back, the outermost first.
    """
    if fold is None or not features:
        return ()
    patterns: list[Pattern] = []
    for face, side in (("front", 1.0), ("back", -1.0)):
        seen = [view for view in views if _looks_at(view, side)]
        if len(seen) >= FEWEST_VIEWS:
            drawn = _Face(seen, features, diameter_m, fold).planes()
            for number, (points, directions) in enumerate(sorted(drawn, key=lambda p: -side * p[0][0, 2]), start=1):
                patterns.append(Pattern(f"pattern_{face}_{number}", np.array([0, 0, side]), points, directions))
    return tuple(patterns)


class _Face:
    """One face of the part, in the views that show it."""

    def __init__(
        self, views: Sequence[View], features: Sequence[CircleFeature], diameter_m: float, fold: int
    ) -> None:
        self._views, self._diameter_m = views, diameter_m
        self._edges = [detect_edges(view.gray) for view in views]
        self._turns = [_turn(2 * np.pi * k / fold) for k in range(fold)]
        self._pixel_m = float(np.mean([np.linalg.norm(v.T_world_camera.translation) / v.camera.fx for v in views]))
        circles = [circle for feature in features for circle in feature.circles()]
        self._reach_m = max(float(np.hypot(*c.centre[:2])) + c.radius_m for c in circles)
        self._holes = [c for feature in features if feature.role == "supporting" for c in feature.circles()]
        # A circle that was triangulated from poor marks may lie anywhere.
        heights = np.clip([c.centre[2] for c in circles], -diameter_m, diameter_m)
        self._lowest, self._highest = float(heights.min()), float(heights.max())

    def planes(self) -> list[tuple[Array, Array]]:
        """Points (N, 3) and directions (N, 3) of every plane that carries edges."""
        found: list[tuple[Array, Array]] = []
        heights: list[float] = []
        for height in self._heights():
            height = self._refined(height)
            if any(abs(height - other) < 1.5 * SWEEP_STEP * self._diameter_m for other in heights):
                continue
            points, directions = self._drawn(height)
            if len(points) >= FEWEST_POINTS:
                heights.append(height)
                found.append((points, directions))
        return found

    def _heights(self) -> list[float]:
        """Where more edges agree than just above and below, the most first."""
        step = SWEEP_STEP * self._diameter_m
        count = int(np.ceil((self._highest - self._lowest) / step)) + 5
        grid = self._lowest + step * (np.arange(count) - 2)
        agreeing = np.zeros(count)
        for i, height in enumerate(grid):
            edges = self._at(float(height))
            share = self._agreement(edges, _joined([e[::SWEEP_STRIDE] for e in edges])).share
            agreeing[i] = np.count_nonzero(share > AGREEING_SHARE)
        inner = agreeing[1:-1]
        peaks = 1 + np.flatnonzero((inner > 0) & (inner >= agreeing[:-2]) & (inner > agreeing[2:]))
        return [float(grid[i]) for i in peaks[np.argsort(-agreeing[peaks], kind="stable")]]

    def _refined(self, height: float) -> float:
        """The height at which the views agree best, to a micrometre."""
        for _ in range(_REFINEMENTS):
            edges = self._at(height)
            height += self._agreement(edges, _joined(edges)).rise_m
        return round(height, 6)

    def _drawn(self, height: float) -> tuple[Array, Array]:
        """Evenly spaced points (N, 3) of the edges in a plane, and their directions (N, 3)."""
        edges = self._at(height)
        candidates = _joined(edges)
        agreement = self._agreement(edges, candidates)
        kept = agreement.share > AGREEING_SHARE
        normals = _normals(candidates.directions)
        points = (candidates.points + agreement.offset[:, None] * normals)[kept]
        directions = agreement.direction[kept]
        chosen = _spaced(points, directions, self._turns, SPACING * self._diameter_m)
        copies = [np.concatenate([a[chosen] @ turn.T for turn in self._turns]) for a in (points, directions)]
        # As a model's file has them: the last bits are the machine's.
        points, directions = np.round(copies[0], 6), np.round(copies[1], 7)
        zeros = np.zeros(len(points))
        return np.column_stack([points, zeros + height]) + 0.0, np.column_stack([directions, zeros]) + 0.0

    def _at(self, height: float) -> list[_PlaneEdges]:
        """The edge points of all views in a plane, without those that cannot tell a turn or are taught as circles."""
        return [self._telling(_put_back(v, e, height)) for v, e in zip(self._views, self._edges, strict=True)]

    def _telling(self, edges: _PlaneEdges) -> _PlaneEdges:
        points = edges.points
        radius = np.hypot(*points.T)
        radial = np.abs(np.einsum("ij,ij->i", edges.directions, points)) / np.maximum(radius, 1e-12)
        kept = (radius < self._reach_m) & (radial > np.sin(TANGENTIAL_RAD))
        for hole in self._holes:
            reach = HOLE_MARGIN * hole.radius_m + 2 * self._pixel_m
            kept &= np.hypot(*(points - hole.centre[:2]).T) > reach
        return edges[kept]

    def _agreement(self, edges: Sequence[_PlaneEdges], candidates: _PlaneEdges) -> _Agreement:
        """Look for an edge of every view where each candidate is, and where its copies are."""
        number = len(candidates.points)
        count, offsets, direction = np.zeros(number), np.zeros(number), np.zeros((number, 2))
        slopes, squares, products = np.zeros((3, number))
        for agrees, offset, slope, seen in self._sightings(edges, candidates):
            count += agrees
            offsets += offset
            direction += seen
            slopes += slope
            squares += slope**2
            products += slope * offset
        share = count / (len(edges) * len(self._turns))
        n, kept = np.maximum(count, 1), share > AGREEING_SHARE
        # When the plane rises, what a view shows moves by its slope. One rise is to bring together what is shown of
        # each point: a regression in which every point has a constant of its own.
        spread = float((squares - slopes**2 / n)[kept].sum())
        rise = -float((products - slopes * offsets / n)[kept].sum()) / spread if spread > 0 else 0.0
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
        return _Agreement(share, offsets / n, direction, rise)

    def _sightings(
        self, edges: Sequence[_PlaneEdges], candidates: _PlaneEdges
    ) -> Iterator[tuple[Mask, Array, Array, Array]]:
        """What each view shows at each copy of the candidates.

        Yields:
            Where it shows them (P,), and there, else 0, the offset along the normal (P,), by how much that grows when
            the plane rises (P,), and the direction in which the edge runs (P, 2), carried back from the copy.
        """
        shown = [(seen, cKDTree(self._features(seen.points, seen.directions))) for seen in edges if len(seen.points)]
        for turn in self._turns:
            points, directions = candidates.points @ turn.T, candidates.directions @ turn.T
            normals, sought = _normals(directions), self._features(points, directions)
            for seen, tree in shown:
                distance, nearest = tree.query(sought, distance_upper_bound=ALONG_PX)
                nearest[~np.isfinite(distance)] = 0
                offset = np.einsum("ij,ij->i", seen.points[nearest] - points, normals)
                slope = np.einsum("ij,ij->i", seen.slopes[nearest], normals)
                agrees = np.isfinite(distance) & (np.abs(offset) < ACROSS_PX * self._pixel_m)
                direction = np.where(agrees[:, None], seen.directions[nearest] @ turn, 0)
                yield agrees, np.where(agrees, offset, 0), np.where(agrees, slope, 0), direction

    def _features(self, points: Array, directions: Array) -> Array:
        """(N, 4) position in pixels, and direction so that the limits of both are at the same distance."""
        return np.hstack([points / self._pixel_m, directions * (ALONG_PX / DIRECTION_RAD)])


def _looks_at(view: View, side: float) -> bool:
    """Whether a view shows the front (side 1) or the back (side -1), and not at a grazing angle."""
    eye = view.T_world_camera.translation
    return bool(side * eye[2] > LEAST_FACING_COSINE * np.linalg.norm(eye))


def _put_back(view: View, edges: EdgeMap, height: float) -> _PlaneEdges:
    """The edge points of a view in the plane z = height of the part's frame."""
    T = view.T_world_camera.as_matrix()
    eye = T[:3, 3]

    def slopes(pixels: Array) -> Array:
        rays = view.camera.rays(pixels) @ T[:3, :3].T
        return np.asarray(rays[:, :2] / rays[:, 2:])

    tangents = _normals(edges.gradients)
    middle = slopes(edges.points)
    along = (height - eye[2]) * (slopes(edges.points + 0.5 * tangents) - slopes(edges.points - 0.5 * tangents))
    directions = along / np.linalg.norm(along, axis=1, keepdims=True)
    return _PlaneEdges(eye[:2] + (height - eye[2]) * middle, directions, middle)


def _spaced(points: Array, directions: Array, turns: Sequence[Array], spacing_m: float) -> NDArray[np.intp]:
    """Numbers of points that lie a spacing apart, all copies of them taken together; crossing edges do not matter."""
    left = np.arange(len(points))
    chosen: list[int] = []
    while len(left):
        first = left[0]
        chosen.append(int(first))
        near = np.zeros(len(left), bool)
        for turn in turns:
            close = np.hypot(*(points[left] - turn @ points[first]).T) < spacing_m
            near |= close & (directions[left] @ (turn @ directions[first]) > np.cos(np.pi / 4))
        left = left[~near]
    return np.array(chosen, dtype=np.intp)


def _joined(edges: Sequence[_PlaneEdges]) -> _PlaneEdges:
    return _PlaneEdges(
        np.concatenate([e.points for e in edges]),
        np.concatenate([e.directions for e in edges]),
        np.concatenate([e.slopes for e in edges]),
    )


def _normals(directions: Array) -> Array:
    """Unit vectors (N, 2), turned by a quarter."""
    return np.column_stack([-directions[:, 1], directions[:, 0]])


def _turn(angle_rad: float) -> Array:
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle_rad]).as_matrix()[:2, :2])
