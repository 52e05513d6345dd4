"""Parts a closed surface into shells, also where bodies share edges.

Where more than two triangles meet at an edge, as where two bodies touch, it has to be told which of them bound the
same body: by their order, for programs write one body after another, or by the angles around the edge. Lengths are in
millimetres.
"""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmark.meshes.surface import Surface
from benchmark.meshes.topology import Edges, components, edges_of, once, sheets
from vision.frozen import frozen_arrays

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME_RAD = 1e-3  # triangles that stand at an edge at less than this angle may be in either order


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Shell:
    """A connected part of a surface; exactly two of its triangles meet at every edge.

    Attributes:
        vertices: corners, (N, 3).
        faces: their indices, (M, 3).
    """

    vertices: Floats
    faces: Ints

    @property
    def volume(self) -> float:
        """What it encloses in mm³; negative where it faces inwards."""
        a, b, c = (self.vertices - self.vertices.mean(axis=0))[self.faces].transpose(1, 0, 2)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @property
    def area(self) -> float:
        """The area of its triangles in mm²."""
        a, b, c = self.vertices[self.faces].transpose(1, 0, 2)
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)

    @property
    def touches_itself(self) -> bool:
        """Whether two of its triangles have the same corners: only those of different bodies should."""
        place = np.unique(self.vertices, axis=0, return_inverse=True)[1].ravel()
        return len(once(place[self.faces])) < len(self.faces)

    def inside_out(self) -> Shell:
        """The shell that faces the other way."""
        return Shell(self.vertices, self.faces[:, ::-1])


def shells_of(surface: Surface, by_angle: bool) -> list[Shell]:
    """The shells of a surface, in the order of their first triangles.

    Args:
        surface: closed; its triangles are in the order of the file.
        by_angle: whether the angles tell which triangles belong together where more than two meet, or their order.
    """
    vertices, faces = surface.vertices, surface.faces
    edges = edges_of(faces)
    one, other = edges.twos
    if (edges.counts > 2).any():
        pairs = _pairs(vertices, faces, edges, by_angle)
        one, other = np.concatenate([one, pairs[:, 0]]), np.concatenate([other, pairs[:, 1]])
        vertices, faces = _split(vertices, faces, one, other)
    shell = components(edges.count, one % edges.count, other % edges.count)
    if not shell.any():
        return [Shell(vertices, faces)]
    return [_compact(vertices, faces[members]) for members in _groups(shell)]


def _groups(label: Ints) -> list[Ints]:
    """The indices of each label, (K,) in ascending order."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _compact(vertices: Floats, faces: Ints) -> Shell:
    used, index = np.unique(faces, return_inverse=True)
    return Shell(vertices[used], index.reshape(faces.shape))


def _split(vertices: Floats, faces: Ints, one: Ints, other: Ints) -> tuple[Floats, Ints]:
    """A corner for each fan of triangles that hang together by pairs of sides."""
    count = len(faces)
    starts, ends = np.arange(3 * count), (np.arange(3 * count) + count) % (3 * count)  # corners as sides are numbered
    # Two triangles pass the edge between them in opposite directions.
    other_ends = np.concatenate([ends[other], starts[other]])
    label = components(3 * count, np.concatenate([starts[one], ends[one]]), other_ends)
    corner = np.zeros(label.max() + 1, np.int64)
    corner[label] = faces.T.ravel()
    return vertices[corner], label.reshape(3, count).T


def _pairs(vertices: Floats, faces: Ints, edges: Edges, by_angle: bool) -> Ints:
    """The sides (K, 2) that belong together at the edges where more than two meet."""
    sheet = sheets(edges)
    crowded = np.flatnonzero(edges.counts[edges.of_side] > 2)
    pairs = []
    for members in _groups(edges.of_side[crowded]):
        sides = crowded[members]
        same = _in_one_sheet(sides, edges, sheet[sides % len(faces)])
        pairs += same
        left = np.setdiff1d(sides, np.array(same, dtype=np.int64))
        if by_angle and len(left):
            pairs += _around(left, _angles(vertices, faces, left, edges), edges)
        else:
            left = left[np.argsort(left % edges.count)]
            up = edges.ascending[left]
            pairs += zip(left[up].tolist(), left[~up].tolist(), strict=True)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _in_one_sheet(sides: Ints, edges: Edges, sheet: Ints) -> list[tuple[int, int]]:
    """The pairs of sides whose triangles hang together elsewhere, and no third with them."""
    of_sheet = defaultdict(list)
    for side, label in zip(sides, sheet, strict=True):
        of_sheet[label].append(int(side))
    twos = [pair for pair in of_sheet.values() if len(pair) == 2]
    return [(a, b) for a, b in twos if edges.ascending[a] != edges.ascending[b]]


def _angles(vertices: Floats, faces: Ints, sides: Ints, edges: Edges) -> Floats:
    """The angles (K,) at which triangles stand around an edge, from the first of them, right-handed about it."""
    low, high = vertices[np.array(np.divmod(edges.keys[edges.of_side[sides[0]]], edges.base))]
    axis = (high - low) / np.linalg.norm(high - low)
    opposite = faces[sides % len(faces), (sides // len(faces) + 2) % 3]
    out = vertices[opposite] - low
    out -= (out @ axis)[:, None] * axis
    first, second = out[0], np.cross(axis, out[0])
    angles = np.arctan2(out @ second, out @ first) % (2 * np.pi)
    return np.asarray(np.where(angles > 2 * np.pi - SAME_RAD, 0.0, angles))


def _around(sides: Ints, angles: Floats, edges: Edges) -> list[tuple[int, int]]:
    """Pair sides around an edge so that the wedge between the two of a pair is inside.

    Inside begins, right-handed, at a triangle that passes the edge downwards, and ends at one that passes it upwards.
    Of wedges that overlap, the one that begins first ends first; bodies that touch are told apart by this even where
    rounding has let them cross. Triangles in one place are taken in the order of the file.
    """
    by_angle = np.argsort(angles, kind="stable")
    step = np.cumsum(np.diff(angles[by_angle], prepend=0.0) > SAME_RAD)
    ends = edges.ascending[sides[by_angle]]
    in_file = sides[by_angle] % edges.count
    ordered = by_angle[np.lexsort((in_file, ~ends, step))]
    depth = np.cumsum(np.where(edges.ascending[sides[ordered]], -1, 1))
    ordered = np.roll(ordered, -int(np.argmin(depth)) - 1)
    begun: deque[int] = deque()
    pairs = []
    for side in sides[ordered]:
        if edges.ascending[side]:
            pairs.append((begun.popleft(), int(side)))
        else:
            begun.append(int(side))
    return pairs
