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
from scipy.spatial import cKDTree

from benchmark.meshes.topology import (
    components,
    do_agree,
    edges_of,
    once,
    open_edges,
    open_sheets,
    repeated,
    with_three_corners,
)
from vision.frozen import frozen_arrays

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

GAP_MM = 0.01
"""Corners along open edges that are closer than this are one."""
WIDE_GAPS_MM = (0.05, 0.2, 1.0)
"""What could close a surface, to tell the user; nothing is repaired with these."""
FLAT_MM = 1e-6  # a triangle that is no higher than this may be left out
TURN = "Let its faces be turned in the program that made it (recalculate the normals)."


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
    closed = _closed(vertices, faces, GAP_MM)
    if closed is None:
        raise _complaint(vertices, faces)
    return _agreeing(vertices, closed)


def _closed(vertices: Floats, faces: Ints, gap_mm: float) -> Ints | None:
    """Faces that enclose what the given ones do, an even number of them at every edge; None if there are none."""
    joined = with_three_corners(_joined(vertices, once(with_three_corners(faces)), gap_mm)[faces])
    for reading in _readings(vertices, joined):
        upright = reading[_heights(vertices, reading) > FLAT_MM]
        for kept in (reading, upright, _sewn(vertices, upright, gap_mm)):
            if len(kept) and not len(open_edges(kept)):
                return kept
    return None


def _readings(vertices: Floats, faces: Ints) -> list[Ints]:
    """What may be meant by triangles of which some are there more than once; the first that is closed is right.

    Where all agree, those that look the same way were written twice, or belong to two bodies that overlap. Those back
    to back belong to two bodies that touch, and both stay. Where some look the wrong way, this cannot be told, and
    all that may have happened is that some were written twice.

    Raises:
        OpenSurfaceError: a whole body is there twice, and some look the wrong way.
    """
    single, twice = once(faces), repeated(faces)
    whole = twice[~open_sheets(twice)]
    if len(whole) == len(single):
        return [single]
    if do_agree(faces):
        return [once(faces, either_way=False), faces]
    if len(whole):
        got = "a body that is there twice, and triangles that look in opposite directions"
        raise OpenSurfaceError(got, "Delete one of the two.", vertices[whole[0, 0]])
    return [single]


def _without(faces: Ints, others: Ints) -> Ints:
    """The triangles that are not among others; both are there once."""
    both = np.sort(np.vstack([faces, once(others)]), axis=1)
    first, counts = np.unique(both, axis=0, return_index=True, return_counts=True)[1:]
    return np.asarray(faces[np.sort(first[(counts == 1) & (first < len(faces))])])


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
    group = components(len(corners), near[:, 0], near[:, 1])
    count = int(group.max()) + 1
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

    A loose flat triangle would be given a back; both go instead.
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
    new = np.array(added, dtype=np.int64).reshape(-1, 3)
    return np.vstack([_without(faces, new), _without(once(new), faces)])


def _agreeing(vertices: Floats, faces: Ints) -> Surface:
    """Turn the triangles of each sheet that have less area than the rest of it, so that all agree.

    A sheet ends where more than two triangles meet at an edge. The sheets are found on a graph with two nodes for a
    triangle, as it is and turned; neighbours that agree are joined as they are, others one as it is and one turned.

    Raises:
        OpenSurfaceError: they cannot agree.
    """
    if do_agree(faces):
        return Surface(vertices, faces, 0.0)
    count, edges = len(faces), edges_of(faces)
    one, other = edges.twos
    opposed = edges.ascending[one] != edges.ascending[other]
    first, second = one % count, other % count
    ends = np.concatenate([np.where(opposed, second, second + count), np.where(opposed, second + count, second)])
    label = components(2 * count, np.concatenate([first, first + count]), ends)
    as_is, turned = label[:count], label[count:]
    area = np.bincount(as_is, _areas(vertices, faces), minlength=label.max() + 1)
    minor = (area[as_is] < area[turned]) | ((area[as_is] == area[turned]) & (as_is > turned))
    agreeing = np.where(minor[:, None], faces[:, ::-1], faces)
    one_sided = as_is == turned
    if one_sided.any() or not do_agree(agreeing):
        got = "triangles that look in opposite directions, and no way to turn them so that all agree"
        raise OpenSurfaceError(got, TURN, vertices[faces[np.argmax(one_sided)]].mean(axis=0))
    share = np.minimum(area[as_is], area[turned]) / np.maximum(area[as_is] + area[turned], 1e-300)
    return Surface(vertices, agreeing, float(share.max()))


def _complaint(vertices: Floats, faces: Ints) -> OpenSurfaceError:
    """What is wrong with a surface that is not closed, as near to the remedy as can be told."""
    single = once(with_three_corners(faces))
    single = once(with_three_corners(_joined(vertices, single, GAP_MM)[single]))
    edges = open_edges(single)
    at = vertices[edges[0]].mean(axis=0) if len(edges) else vertices.mean(axis=0)
    got = f"{len(edges)} edges that do not join two triangles"
    for gap in WIDE_GAPS_MM:
        closed = _closed(vertices, faces, gap)
        if closed is not None and len(closed) >= len(single):  # else it is a hole that is drawn together
            do = f"Merge the corners along its seams that lie up to {gap:g} mm apart."
            return OpenSurfaceError(f"{got}, along seams wider than {GAP_MM:g} mm", do, at)
    loose = open_sheets(single)
    if loose.any() and not loose.all() and not len(open_edges(single[~loose])):
        some = "1 triangle that encloses" if loose.sum() == 1 else f"{loose.sum()} triangles that enclose"
        at = vertices[single[loose][0]].mean(axis=0)
        return OpenSurfaceError(f"{some} nothing, beside a closed surface", "Delete what is loose, or close it.", at)
    return OpenSurfaceError(got, "Close its holes and remove inner walls.", at)
