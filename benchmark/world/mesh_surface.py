"""Closes the surface of a mesh that a user brings, as far as there is no doubt what it encloses.

Beyond doubt are triangles without extent, triangles that are there twice, walls without thickness, seams that gape by
no more than `GAP_MM` or whose sides have different corners, and triangles that look the wrong way beside others that
do not. Lengths are in millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from vision.frozen import frozen_arrays

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GAP_MM = 0.01
"""Corners along open edges that are closer than this are one."""
WIDE_GAPS_MM = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""What could close a surface, to tell the user; nothing is repaired with these."""
FLAT_MM = 1e-6  # a triangle that is no higher than this may be left out


class OpenSurfaceError(Exception):
    """A surface that cannot be closed beyond doubt.

    Attributes:
        got: what is wrong with it.
        do: the remedy.
        at: a point where it is.
    """

    def __init__(self, got: str, do: str, at: Floats) -> None:
        super().__init__(got)
        self.got, self.do, self.at = got, do, at


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Surface:
    """A closed surface whose triangles agree on which side is out.

    Attributes:
        vertices: corners, (N, 3).
        faces: their indices, (M, 3).
        turned: the largest share of the area of a sheet that was turned to agree with the rest of it.
    """

    vertices: Floats
    faces: Ints
    turned: float


def closed_surface(vertices: Floats, faces: Ints) -> Surface:
    """Close a surface and let its triangles agree.

    Args:
        vertices: corners, (N, 3); those of neighbours are the same, or closer than `GAP_MM`.
        faces: their indices, (M, 3).

    Raises:
        OpenSurfaceError: it has holes or inner walls, or its triangles cannot agree.
    """
    whole = _closed(vertices, faces, GAP_MM)
    if whole is None:
        raise _complaint(vertices, faces)
    return _agreeing(vertices, whole)


def _closed(vertices: Floats, faces: Ints, gap_mm: float) -> Ints | None:
    """Faces that enclose what the given ones do, with an even number of them at every edge; None if there are none.

    Which of two equal triangles is too many depends on what they are: a triangle that was written twice stays once,
    the wall between two bodies that touch goes altogether. Only one of the two leaves nothing open.
    """
    joined = _spread(_joined(vertices, _once(_spread(faces)), gap_mm)[faces])
    for candidate in (_once(joined), _odd(joined)):
        upright = candidate[_heights(vertices, candidate) > FLAT_MM]
        for kept in (candidate, upright, _sewn(vertices, upright, gap_mm)):
            if len(kept) and not len(open_edges(kept)):
                return kept
    return None


def open_edges(faces: Ints) -> Ints:
    """The edges (K, 2) that join an odd number of triangles; there are none on a closed surface."""
    edges = _edges(faces)
    return np.stack(np.divmod(edges.keys[edges.counts % 2 == 1], edges.base), axis=1)


@dataclass(frozen=True, eq=False)
@frozen_arrays
class _Edges:
    """The edges of M triangles: first those from each one's first corner, then those from its second, and so on.

    Attributes:
        keys: of every edge once, (K,): its lower corner times the base, plus its higher one.
        base: larger than any corner.
        of_side: the edge at each side, (3 M,).
        counts: how many triangles there are at each edge, (K,).
        ascending: whether the triangle passes its side from the lower corner to the higher one, (3 M,).
    """

    keys: Ints
    base: int
    of_side: Ints
    counts: Ints
    ascending: NDArray[np.bool_]


def _edges(faces: Ints) -> _Edges:
    starts, ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    base = int(faces.max(initial=0)) + 1
    sides = np.minimum(starts, ends) * base + np.maximum(starts, ends)
    keys, of_side, counts = np.unique(sides, return_inverse=True, return_counts=True)
    return _Edges(keys, base, of_side, counts, starts < ends)


def _spread(faces: Ints) -> Ints:
    """The faces with three different corners."""
    first, second, third = faces.T
    return np.asarray(faces[(first != second) & (second != third) & (third != first)])


def _once(faces: Ints) -> Ints:
    """Every triangle once, in the order of first appearance, whichever way its copies look."""
    kept = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1]
    return np.asarray(faces[np.sort(kept)])


def _odd(faces: Ints) -> Ints:
    """Once what is there an odd number of times, and nothing of what is there an even number of times."""
    _, kept, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(faces[np.sort(kept[counts % 2 == 1])])


def _heights(vertices: Floats, faces: Ints) -> Floats:
    """The least height of each triangle, (M,)."""
    corners = vertices[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return np.asarray(2 * _areas(vertices, faces) / np.maximum(sides, FLAT_MM))


def _areas(vertices: Floats, faces: Ints) -> Floats:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def _joined(vertices: Floats, faces: Ints, gap_mm: float) -> Ints:
    """For each corner (N,), the one that it is: corners along open edges within a gap of one another are one.

    Where corners lie so dense that a chain of them is longer than the gap, they stay: else a hole would be closed by
    drawing its rim together.
    """
    same = np.arange(len(vertices))
    corners = np.unique(open_edges(faces))
    if not len(corners):
        return same
    near = cKDTree(vertices[corners]).query_pairs(gap_mm, output_type="ndarray")
    graph = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(corners), len(corners)))
    count, group = connected_components(graph, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, group, vertices[corners])
    np.maximum.at(high, group, vertices[corners])
    first = np.full(count, len(vertices))
    np.minimum.at(first, group, corners)
    tight = np.linalg.norm(high - low, axis=1) <= gap_mm
    same[corners] = np.where(tight[group], first[group], corners)
    return same


def _sewn(vertices: Floats, faces: Ints, gap_mm: float) -> Ints:
    """The faces, and flat ones that fill seams with corners on one side where there are none on the other.

    A loose flat triangle would be given a back; it goes instead.
    """
    edges = open_edges(faces)
    if not len(edges):
        return faces
    corners = np.unique(edges)
    tree = cKDTree(vertices[corners])
    added = []
    for a, b in edges:
        start, along = vertices[a], vertices[b] - vertices[a]
        near = corners[tree.query_ball_point(start + along / 2, np.linalg.norm(along) / 2)]
        share = (vertices[near] - start) @ along / (along @ along)
        beside = np.linalg.norm(vertices[near] - start - share[:, None] * along, axis=1)
        between = (beside <= gap_mm) & (near != a) & (near != b)
        on = near[between][np.argsort(share[between])]
        added += [(a, p, q) for p, q in pairwise([*on, b])]
    return _odd(np.vstack([faces, np.array(added, dtype=np.int64).reshape(-1, 3)]))


def _agreeing(vertices: Floats, faces: Ints) -> Surface:
    """Turn the triangles of each sheet that have less area than the rest of it, so that all agree.

    A sheet ends where more than two triangles meet at an edge. The sheets are found on a graph with two nodes for a
    triangle, as it is and turned; neighbours that agree are joined as they are, others one as it is and one turned.

    Raises:
        OpenSurfaceError: they cannot agree.
    """
    if _agree(faces):
        return Surface(vertices, faces, 0.0)
    count = len(faces)
    first, second, opposed = _neighbours(faces)
    ends = np.concatenate([np.where(opposed, second, second + count), np.where(opposed, second + count, second)])
    starts = np.concatenate([first, first + count])
    graph = coo_array((np.ones(len(starts)), (starts, ends)), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    as_is, turned = label[:count], label[count:]
    area = np.bincount(as_is, _areas(vertices, faces), minlength=label.max() + 1)
    minor = (area[as_is] < area[turned]) | ((area[as_is] == area[turned]) & (as_is > turned))
    agreeing = np.where(minor[:, None], faces[:, ::-1], faces)
    one_sided = as_is == turned
    if one_sided.any() or not _agree(agreeing):
        wrong = int(np.flatnonzero(one_sided)[0]) if one_sided.any() else 0
        got = "triangles that look in opposite directions, and no way to turn them so that all agree"
        do = "Let its faces be turned in the program that made it (recalculate the normals)."
        raise OpenSurfaceError(got, do, vertices[faces[wrong]].mean(axis=0))
    share = np.minimum(area[as_is], area[turned]) / np.maximum(area[as_is] + area[turned], 1e-300)
    return Surface(vertices, agreeing, float(share.max()))


def _neighbours(faces: Ints) -> tuple[Ints, Ints, NDArray[np.bool_]]:
    """The two triangles at each edge that joins two, and whether they pass it in opposite directions."""
    edges = _edges(faces)
    order = np.argsort(edges.of_side, kind="stable")
    one, other = order[edges.counts[edges.of_side[order]] == 2].reshape(-1, 2).T
    return one % len(faces), other % len(faces), edges.ascending[one] != edges.ascending[other]


def _agree(faces: Ints) -> bool:
    """Whether every edge is passed as often in one direction as in the other."""
    edges = _edges(faces)
    return not np.bincount(edges.of_side, np.where(edges.ascending, 1, -1)).any()


def _complaint(vertices: Floats, faces: Ints) -> OpenSurfaceError:
    """What is wrong with a surface that is not closed, as near to the remedy as can be told."""
    single = _once(_spread(faces))
    single = _once(_spread(_joined(vertices, single, GAP_MM)[single]))
    edges = open_edges(single)
    at = vertices[edges[0]].mean(axis=0) if len(edges) else vertices.mean(axis=0)
    got = f"{len(edges)} edges that do not join two triangles"
    for gap in WIDE_GAPS_MM:
        closed = _closed(vertices, faces, gap)
        if closed is not None and len(closed) >= len(single):  # else it is a hole that is drawn together
            do = f"Merge the corners along its seams that lie up to {gap:g} mm apart."
            return OpenSurfaceError(f"{got}, along seams wider than {GAP_MM:g} mm", do, at)
    loose = _loose(single)
    if loose.any() and not loose.all() and not len(open_edges(single[~loose])):
        some = "1 triangle that encloses" if loose.sum() == 1 else f"{loose.sum()} triangles that enclose"
        at = vertices[single[loose][0]].mean(axis=0)
        return OpenSurfaceError(f"{some} nothing, beside a closed surface", "Delete what is loose, or close it.", at)
    return OpenSurfaceError(got, "Close its holes and remove inner walls.", at)


def _loose(faces: Ints) -> NDArray[np.bool_]:
    """Which triangles hang together with an edge that belongs to one triangle alone, (M,), by edges that join two."""
    first, second, _ = _neighbours(faces)
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(len(faces), len(faces)))
    sheet = connected_components(graph, directed=False)[1]
    edges = _edges(faces)
    alone = (edges.counts[edges.of_side] == 1).reshape(3, -1).any(axis=0)
    return np.isin(sheet, sheet[alone])
