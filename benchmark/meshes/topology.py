"""How triangles hang together, told by the indices of their corners alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vision.frozen import frozen_arrays

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
@frozen_arrays
class Edges:
    """The edges of M triangles. Their sides are numbered: all from first corners, then from second, then from third.

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
    ascending: Bools

    @property
    def count(self) -> int:
        """The number of triangles."""
        return len(self.of_side) // 3

    @property
    def twos(self) -> tuple[Ints, Ints]:
        """The two sides at each edge that joins two triangles."""
        order = np.argsort(self.of_side, kind="stable")
        one, other = order[self.counts[self.of_side[order]] == 2].reshape(-1, 2).T
        return one, other

    @property
    def odd(self) -> Bools:
        """Whether an odd number of triangles meet at an edge, (K,)."""
        return np.asarray(self.counts % 2 == 1)


def edges_of(faces: Ints) -> Edges:
    """The edges of triangles, given by the indices of their corners (M, 3)."""
    starts, ends = faces.T.ravel(), np.roll(faces, -1, axis=1).T.ravel()
    base = int(faces.max(initial=0)) + 1
    sides = np.minimum(starts, ends) * base + np.maximum(starts, ends)
    keys, of_side, counts = np.unique(sides, return_inverse=True, return_counts=True)
    return Edges(keys, base, of_side, counts, starts < ends)


def open_edges(faces: Ints) -> Ints:
    """The edges (K, 2) that join an odd number of triangles; there are none on a closed surface."""
    edges = edges_of(faces)
    return np.stack(np.divmod(edges.keys[edges.odd], edges.base), axis=1)


def do_agree(faces: Ints) -> bool:
    """Whether every edge is passed as often in one direction as in the other."""
    edges = edges_of(faces)
    return not np.bincount(edges.of_side, np.where(edges.ascending, 1, -1)).any()


def components(count: int, one: Ints, other: Ints) -> Ints:
    """The number of the connected part that each of so many things belongs to, where some are joined by twos."""
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1])


def sheets(edges: Edges) -> Ints:
    """The sheet of each triangle, (M,); a sheet ends where an edge does not join two triangles."""
    one, other = edges.twos
    return components(edges.count, one % edges.count, other % edges.count)


def open_sheets(faces: Ints) -> Bools:
    """Whether each triangle, (M,), hangs together with an edge that belongs to one triangle alone."""
    edges = edges_of(faces)
    sheet = sheets(edges)
    alone = (edges.counts[edges.of_side] == 1).reshape(3, -1).any(axis=0)
    return np.isin(sheet, sheet[alone])


def with_three_corners(faces: Ints) -> Ints:
    """The triangles that have three different corners."""
    first, second, third = faces.T
    return np.asarray(faces[(first != second) & (second != third) & (third != first)])


def once(faces: Ints, either_way: bool = True) -> Ints:
    """Every triangle once, in the order of first appearance.

    Args:
        faces: the triangles, (M, 3).
        either_way: whether those back to back are copies of one another, too.
    """
    kinds = np.sort(faces, axis=1) if either_way else _from_lowest(faces)
    kept = np.unique(kinds, axis=0, return_index=True)[1]
    return np.asarray(faces[np.sort(kept)])


def _from_lowest(faces: Ints) -> Ints:
    """The corners in their order, from the one with the lowest index."""
    first = np.argmin(faces, axis=1)[:, None]
    return np.asarray(np.take_along_axis(faces, (first + np.arange(3)) % 3, axis=1))


def repeated(faces: Ints) -> Ints:
    """What is there more than once, once."""
    kept, counts = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)[1:]
    return np.asarray(faces[np.sort(kept[counts > 1])])
