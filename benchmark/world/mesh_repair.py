"""Makes one closed solid of the triangles of a file, as CAD programs write them, or says why there is none.

Repaired is what has one right answer: corners that are meant to be one, triangles without area, triangles that look
in different directions, bodies that overlap. What is open stays refused: where the missing surface was, nobody knows.
Lengths are in millimetres.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import manifold3d
import numpy as np
import trimesh
from manifold3d import Manifold, OpType
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vision.errors import InputError

Floats = NDArray[np.float64]
Faces = NDArray[np.int64]

SAME_CORNER = 1e-5  # of the mesh's extent: corners nearer to each other are one
_SINGLE_PRECISION = 1e-7  # and what STL's numbers cannot tell apart
INSIDE = 1e-3  # of a cavity's volume: what may lie outside of the solid around it


def one_solid(path: Path, mesh: trimesh.Trimesh) -> Manifold:
    """The solid that a mesh bounds, where the mesh has it.

    Args:
        path: of the file, for messages.
        mesh: its triangles, in millimetres.

    Raises:
        InputError: the surface is open, or crosses itself in a way that leaves no solid.
    """
    extent = float(mesh.extents.max())
    for share in (_SINGLE_PRECISION, SAME_CORNER):
        corners, faces = _joined(mesh, share * extent)
        for distinct in (_one_of_each(faces), _only_single(faces)):
            if len(distinct) and not _open_edges(distinct):
                return _united(path, _bodies(corners, distinct))
    raise InputError(
        f"surface of {path}",
        got=f"{_open_edges(_one_of_each(faces))} edges that do not join two triangles",
        expected="a closed surface",
        do="Close its holes and remove inner faces.",
    )


def _joined(mesh: trimesh.Trimesh, tolerance_mm: float) -> tuple[Floats, Faces]:
    """Corners (N, 3) and faces (M, 3), with corners joined that are nearer than a tolerance.

    A triangle goes where two of its corners became one. Any other without area stays: it may close the seam between
    its neighbours.
    """
    pairs = mesh.kdtree.query_pairs(tolerance_mm, output_type="ndarray")
    count = len(mesh.vertices)
    near = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    cluster = connected_components(near, directed=False)[1]
    first = np.full(cluster.max() + 1, count)
    np.minimum.at(first, cluster, np.arange(count))
    faces = first[cluster][mesh.faces]
    return np.asarray(mesh.vertices), faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _one_of_each(faces: Faces) -> Faces:
    """The faces without repetitions, whichever way those look."""
    return faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]


def _only_single(faces: Faces) -> Faces:
    """The faces that are there once: what two touching bodies share is inside, and no surface."""
    _, where, count = np.unique(np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True)
    return faces[count[where.reshape(-1)] == 1]


def _open_edges(faces: Faces) -> int:
    """Number of edges that an odd number of triangles share."""
    edges = np.sort(trimesh.geometry.faces_to_edges(faces), axis=1)
    return int(np.count_nonzero(np.unique(edges, axis=0, return_counts=True)[1] % 2))


def _bodies(corners: Floats, faces: Faces) -> list[trimesh.Trimesh]:
    """The pieces of a surface that share edges, each with faces that all look the way most of its area did."""
    edges = np.sort(trimesh.geometry.faces_to_edges(faces), axis=1)
    edge = np.unique(edges, axis=0, return_inverse=True)[1].reshape(-1)
    of_face = np.repeat(np.arange(len(faces)), 3)
    shares = coo_array((np.ones(len(edge)), (of_face, edge + len(faces))), shape=(len(faces) + len(edge),) * 2)
    piece = connected_components(shares, directed=False)[1][: len(faces)]
    return [_turned_to_agree(corners, faces[piece == number]) for number in np.unique(piece)]


def _turned_to_agree(corners: Floats, faces: Faces) -> trimesh.Trimesh:
    """A body whose every edge is walked as often one way as the other."""
    body = trimesh.Trimesh(corners, faces, process=False)
    if _is_balanced(faces):
        return body
    trimesh.repair.fix_winding(body)
    if body.area_faces[~_same_sense(faces, body.faces)].sum() > body.area / 2:
        body.invert()
    return body


def _is_balanced(faces: Faces) -> bool:
    edges = trimesh.geometry.faces_to_edges(faces)
    (there, n), (back, m) = (np.unique(e, axis=0, return_counts=True) for e in (edges, edges[:, ::-1]))
    return np.array_equal(there, back) and np.array_equal(n, m)


def _same_sense(a: Faces, b: Faces) -> NDArray[np.bool_]:
    """Which faces (M,) name the same corners in the same cyclic order in both arrays."""
    return np.asarray(np.stack([(np.roll(b, k, axis=1) == a).all(axis=1) for k in range(3)]).any(axis=0))


def _united(path: Path, bodies: Sequence[trimesh.Trimesh]) -> Manifold:
    """The union of the bodies, less the cavities.

    The largest body is solid, and says which way is out. One that looks the other way is a cavity if it lies inside
    what is solid; else its faces are inside out.
    """
    solids = [_manifold(path, body) for body in sorted(bodies, key=lambda b: -abs(b.volume))]
    outwards = 1.0 if bodies and solids[0][1] > 0 else -1.0
    solid = Manifold.batch_boolean([s for s, volume in solids if volume * outwards > 0], OpType.Add)
    for hollow in (s for s, volume in solids if volume * outwards <= 0):
        inside = (hollow - solid).volume() < INSIDE * hollow.volume()
        solid = solid - hollow if inside else solid + hollow
    return solid


def _manifold(path: Path, body: trimesh.Trimesh) -> tuple[Manifold, float]:
    """A body as a solid that looks outwards, and the volume that it had as it was, negative if inside out.

    Raises:
        InputError: it is none.
    """
    volume = float(body.volume)
    faces = body.faces if volume >= 0 else body.faces[:, ::-1]
    triangles = manifold3d.Mesh64(
        np.asarray(body.vertices, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.uint64)
    )
    triangles.merge()
    solid = Manifold(triangles)
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        raise InputError(
            f"surface of {path}",
            got=f"{len(faces)} triangles that touch or cross each other ({solid.status().name})",
            expected="bodies that are closed, each by itself",
            do="Unite its bodies and remove inner faces.",
        )
    return solid, volume
