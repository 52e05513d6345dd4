"""The patterns of the shipped models lie on true edges of the parts' meshes, which teaching knows nothing of."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from benchmark.models import load_model
from benchmark.world.parts import get_part

COVERS = ("cover1", "cover2")
SHARP_RAD = np.radians(25.0)


@cache
def sharp_edges(name):
    """(E, 2, 3) ends of the edges at which a part's surface bends."""
    mesh = trimesh.load_mesh(get_part(name).visual_mesh)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    return mesh.vertices[mesh.face_adjacency_edges[mesh.face_adjacency_angles > SHARP_RAD]]


def nearest_edges(points, edges):
    """Distances (N,) to the nearest edges, and their unit directions (N, 3)."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    length = np.linalg.norm(along, axis=1)
    distances, directions = [], []
    for point in points:
        share = np.clip(np.einsum("ij,ij->i", point - start, along) / length**2, 0, 1)
        distance = np.linalg.norm(start + share[:, None] * along - point, axis=1)
        nearest = int(np.argmin(distance))
        distances.append(distance[nearest])
        directions.append(along[nearest] / length[nearest])
    return np.array(distances), np.array(directions)


@pytest.mark.parametrize("name", COVERS)
def test_patterns_are_true_to_the_part(name):
    patterns = load_model(name).patterns
    assert {p.normal[2] for p in patterns} == {-1.0, 1.0}
    for pattern in patterns:
        distances, directions = nearest_edges(pattern.points, sharp_edges(name))
        assert 1e3 * np.median(distances) < 0.04, pattern.name
        assert 1e3 * distances.max() < 0.1, pattern.name
        cosines = np.abs(np.einsum("ij,ij->i", directions, pattern.directions))
        # The round ends of a vent are polygons in the mesh, whose corners turn by 11 degrees; and where an ear meets
        # the wall, blur rounds the corner.
        assert np.degrees(np.arccos(np.median(cosines).clip(max=1))) < 4, pattern.name
        assert np.mean(cosines > np.cos(np.radians(10))) > 0.85, pattern.name


@pytest.mark.parametrize(("name", "front_mm", "back_mm"), [("cover1", 4.2, 2.4), ("cover2", 8.0, 5.0)])
def test_vents_are_seen_from_both_faces_at_the_heights_of_the_drawing(name, front_mm, back_mm):
    for side, height_mm in ((1.0, front_mm), (-1.0, back_mm)):
        vents = max((p for p in load_model(name).patterns if p.normal[2] == side), key=lambda p: len(p.points))
        assert 1e3 * vents.points[:, 2] == pytest.approx(height_mm, abs=0.02)
        assert len(vents.points) > 60


@pytest.mark.parametrize("name", COVERS)
def test_patterns_have_the_symmetry_of_the_part(name):
    model = load_model(name)
    angle = 2 * np.pi / model.symmetry_fold
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert model.patterns
    for pattern in model.patterns:
        apart = np.linalg.norm((pattern.points @ turn.T)[:, None] - pattern.points, axis=2)
        assert apart.min(axis=1).max() < 3e-6


def test_a_hub_with_nothing_but_circles_has_no_pattern():
    assert load_model("hub").patterns == ()
