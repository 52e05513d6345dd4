"""Meshes as CAD programs write them: what has one right answer is repaired, the rest is refused."""

from __future__ import annotations

import os

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, Manifold

from benchmark.commands.common import split_parts
from benchmark.world import mesh_part
from benchmark.world.mesh_file import MeshReference, read_solid
from vision.errors import InputError, ResourceError


def ring(outer=30.0, inner=10.0, height=12.0):
    return CrossSection(
        [[(inner, -height / 2), (outer, -height / 2), (outer, height / 2), (inner, height / 2)]]
    ).revolve(48)


def triangles(solid):
    """Corners (M, 3, 3) of a solid's faces in millimetres, as an STL file has them."""
    mesh = solid.to_mesh64()
    return mesh.vert_properties[:, :3][mesh.tri_verts.astype(int)]


def volume_of(corners, path):
    """What the file of these triangles holds, in mm³."""
    faces = np.arange(3 * len(corners)).reshape(-1, 3)
    trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False).export(path)
    return read_solid(MeshReference(path, "mm")).volume()


RING = triangles(ring())
VOLUME = ring().volume()


@pytest.fixture
def stl(tmp_path):
    return tmp_path / "part.stl"


def test_triangles_that_look_in_different_directions_are_turned(stl):
    for flipped in ([0], range(0, len(RING), 7), range(len(RING))):
        corners = RING.copy()
        corners[list(flipped)] = corners[list(flipped), ::-1]
        assert volume_of(corners, stl) == pytest.approx(VOLUME, rel=1e-6)


def test_triangles_without_area_do_no_harm(stl):
    """One edge is split, and the seam is closed by a triangle whose three corners lie on that edge."""
    a, b, c = RING[0]
    middle = (a + b) / 2
    corners = np.concatenate([RING[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    assert volume_of(corners, stl) == pytest.approx(VOLUME, rel=1e-6)
    assert volume_of(np.concatenate([RING, [[a, a, b]]]), stl) == pytest.approx(VOLUME, rel=1e-6)


@pytest.mark.parametrize("gap_mm", [1e-6, 1e-4])
def test_seams_narrower_than_any_tool_are_closed(gap_mm, stl):
    corners = RING + gap_mm * np.random.default_rng(0).uniform(-1, 1, RING.shape)
    assert volume_of(corners, stl) == pytest.approx(VOLUME, rel=1e-4)


@pytest.mark.parametrize("broken", [RING[1:], RING + 0.1 * np.random.default_rng(0).uniform(-1, 1, RING.shape)])
def test_an_open_surface_is_refused(broken, stl):
    with pytest.raises(InputError, match="edges that do not join two triangles; expected a closed surface"):
        volume_of(broken, stl)


def test_a_stray_triangle_is_refused(stl):
    with pytest.raises(InputError, match="3 edges that do not join two triangles"):
        volume_of(np.concatenate([RING, [[[0, 0, 40], [9, 0, 40], [0, 9, 40]]]]), stl)


def test_a_body_that_is_there_twice_counts_once(stl):
    for again in (RING, RING[:, ::-1], RING[::-1], RING[:5]):
        assert volume_of(np.concatenate([RING, again]), stl) == pytest.approx(VOLUME, rel=1e-6)


def test_overlapping_bodies_count_as_their_union(stl):
    boss = ring(outer=20.0, inner=10.0, height=30.0)
    union = (ring() + boss).volume()
    for second in (triangles(boss), triangles(boss)[:, ::-1]):
        for corners in (np.concatenate([RING, second]), np.concatenate([second, RING])):
            assert volume_of(corners, stl) == pytest.approx(union, rel=1e-6)
        assert volume_of(np.concatenate([RING, second])[:, ::-1], stl) == pytest.approx(union, rel=1e-6)


def test_bodies_that_touch_are_one(stl):
    upper = Manifold.translate(ring(), (0.0, 0.0, 12.0))
    assert volume_of(np.concatenate([RING, triangles(upper)]), stl) == pytest.approx(2 * VOLUME, rel=1e-6)


def test_a_cavity_stays_one_and_a_solid_core_adds_nothing(stl):
    core = triangles(ring(outer=25.0, inner=15.0, height=6.0))
    hollow = VOLUME - ring(outer=25.0, inner=15.0, height=6.0).volume()
    assert volume_of(np.concatenate([RING, core[:, ::-1]]), stl) == pytest.approx(hollow, rel=1e-6)
    assert volume_of(np.concatenate([RING, core]), stl) == pytest.approx(VOLUME, rel=1e-6)
    assert volume_of(np.concatenate([RING, core[:, ::-1]])[:, ::-1], stl) == pytest.approx(hollow, rel=1e-6)


@pytest.mark.parametrize("name", ["pulley,v2.stl", "M8+washer.stl"])
def test_a_name_with_a_separator_is_not_taken_for_several_parts(name, tmp_path):
    volume_of(RING, tmp_path / name)
    with pytest.raises(InputError, match=r"expected a file without , and \+ in its path.*Rename it"):
        split_parts(f"{tmp_path / name}:mm")


def test_other_files_are_told_which_kinds_can_be_parts():
    with pytest.raises(InputError, match=r"or a mesh file \(\.obj, \.stl, \.ply\)"):
        split_parts("p.step")


def test_advice_on_the_unit_works_where_parts_are_named_and_where_they_are_taught(stl):
    volume_of(RING, stl)
    with pytest.raises(InputError) as refusal:
        read_solid(MeshReference(stl))
    assert f"write {stl}:mm, or --unit mm to focalpick teach" in str(refusal.value)
    assert read_solid(MeshReference.parse(f"{stl}:mm")).volume() == pytest.approx(VOLUME, rel=1e-6)


def test_what_one_user_built_others_can_read(stl, tmp_path, monkeypatch):
    volume_of(RING, stl)
    monkeypatch.setenv(mesh_part.CACHE_VARIABLE, str(tmp_path / "cache"))
    before = os.umask(0o022)
    try:
        part = mesh_part.part_from_mesh(stl, "mm")
    finally:
        os.umask(before)
    for path in (part.visual_mesh, part.visual_mesh.parent, part.visual_mesh.parent.parent):
        assert path.stat().st_mode & 0o044 == 0o044


def test_a_user_without_a_home_gets_a_temporary_cache(monkeypatch):
    def nobody():
        raise RuntimeError("Could not determine home directory.")

    for name in (mesh_part.CACHE_VARIABLE, "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("pathlib.Path.home", nobody)
    assert str(os.getuid()) in mesh_part.cache_directory().name


def test_a_cache_that_cannot_be_used_is_named(stl, tmp_path, monkeypatch):
    volume_of(RING, stl)
    (tmp_path / "file").touch()
    monkeypatch.setenv(mesh_part.CACHE_VARIABLE, str(tmp_path / "file"))
    with pytest.raises(ResourceError, match=r"Set FOCALPICK_CACHE to another one"):
        mesh_part.part_from_mesh(stl, "mm")
