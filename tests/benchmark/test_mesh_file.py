"""Mesh files as programs write them: what is beyond doubt becomes the right solid, what is doubtful is refused."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, Manifold

from benchmark.meshes import bodies
from benchmark.meshes import surface as mesh_surface
from benchmark.meshes.mesh_file import MeshReference, read_solid
from vision.errors import InputError

PROFILE = [(8, 0), (30, 0), (30, 8), (22, 8), (22, 18), (8, 18)]
PULLEY = CrossSection([PROFILE]).revolve(48)


def triangles(*solids):
    """The corners (M, 3, 3) of the triangles of solids, one after another."""
    meshes = [solid.to_mesh64() for solid in solids]
    return np.concatenate([np.asarray(m.vert_properties)[:, :3][m.tri_verts.astype(int)] for m in meshes])


def disc(radius, height, low=None):
    """About z; its bottom is at half its height below 0, or where it is told."""
    return Manifold.cylinder(height, radius, radius, 48).translate((0, 0, -height / 2 if low is None else low))


def turned(corners, which=slice(None)):
    corners = corners.copy()
    corners[which] = corners[which][:, ::-1]
    return corners


def some(corners, share, seed=0):
    return np.random.default_rng(seed).random(len(corners)) < share


def written(path, corners, unit_mm=1.0):
    mesh = trimesh.Trimesh(
        np.asarray(corners).reshape(-1, 3) / unit_mm, np.arange(3 * len(corners)).reshape(-1, 3), process=False
    )
    mesh.export(path)
    return path


def volume(tmp_path, corners, suffix=".stl"):
    return read_solid(MeshReference(written(tmp_path / f"mesh{suffix}", corners), "mm")).volume()


def refused(tmp_path, corners):
    with pytest.raises(InputError) as caught:
        volume(tmp_path, corners)
    return str(caught.value)


def revolved(profile, segments, start=0.0, stop=2 * np.pi):
    """The triangles that a profile sweeps, whatever it crosses; a part of a turn has no end faces."""
    angles = np.linspace(start, stop, segments + 1)
    rings = np.array([[(r * np.cos(a), r * np.sin(a), z) for r, z in profile] for a in angles])
    rings = np.concatenate([rings, rings[:, :1]], axis=1)
    a, b, c, d = (x.reshape(-1, 3) for x in (rings[:-1, :-1], rings[1:, :-1], rings[1:, 1:], rings[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def with_points(profile, count):
    """The profile with each side in so many equal steps."""
    ends = pairwise([*profile, profile[0]])
    return [tuple(np.add(p, np.subtract(q, p) * k / count)) for p, q in ends for k in range(count)]


WHOLE = triangles(PULLEY)
FIRST, SECOND, THIRD = WHOLE[0]
MIDDLE = (FIRST + SECOND) / 2
SPLIT = np.concatenate([WHOLE[1:], [[FIRST, MIDDLE, THIRD], [MIDDLE, SECOND, THIRD]]])
SHEET = np.array([[(15, 0, 25), (18, 0, 25), (18, 3, 25)]], float)
CRUMB = triangles(Manifold.cube((0.005, 0.005, 0.005)).translate((15, 0, 25)))
SAME_SOLID = {
    "as it is": WHOLE,
    "a sliver at a corner": np.concatenate([SPLIT, [[FIRST, SECOND, MIDDLE]]]),
    "a sliver that looks the other way": np.concatenate([SPLIT, [[SECOND, FIRST, MIDDLE]]]),
    "a sliver that is too many": np.concatenate([WHOLE, [[FIRST, SECOND, MIDDLE]]]),
    "a triangle with a corner twice": np.concatenate([WHOLE, [[FIRST, FIRST, SECOND]]]),
    "a triangle that is a point": np.concatenate([WHOLE, [[FIRST, FIRST, FIRST]]]),
    "one turned": turned(WHOLE, [17]),
    "a third turned": turned(WHOLE, some(WHOLE, 0.3)),
    "every other one turned": turned(WHOLE, slice(None, None, 2)),
    "all turned": turned(WHOLE),
    "one twice": np.concatenate([WHOLE, WHOLE[5:6]]),
    "one twice, back to back": np.concatenate([WHOLE, turned(WHOLE[5:6])]),
    "all twice": np.concatenate([WHOLE, WHOLE]),
    "all three times": np.concatenate([WHOLE, np.roll(WHOLE, 1, axis=1), WHOLE]),
    "all twice, back to back": np.concatenate([WHOLE, turned(WHOLE)]),
    "a crumb": np.concatenate([WHOLE, CRUMB]),
    "in single precision, far away": (WHOLE + np.array([900, 500, 200])).astype(np.float32),
    "corners of one side of a seam on edges of the other": np.concatenate(
        [revolved(with_points(PROFILE, 1 + k % 3), 4, k * np.pi / 6, (k + 1) * np.pi / 6) for k in range(12)]
    ),
    "several of these": turned(np.concatenate([SPLIT, SPLIT[40:60], CRUMB]), some(SPLIT, 0.3)[:0]),
}


@pytest.mark.parametrize("name", SAME_SOLID)
def test_flaws_that_leave_no_doubt_are_mended(name, tmp_path):
    assert volume(tmp_path, SAME_SOLID[name]) == pytest.approx(PULLEY.volume(), rel=1e-4)


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_flaws_are_mended_in_every_format(suffix, tmp_path):
    corners = turned(np.concatenate([SAME_SOLID["a sliver at a corner"], WHOLE[30:50]]), [3, 70])
    assert volume(tmp_path, corners, suffix) == pytest.approx(PULLEY.volume(), rel=1e-4)


@pytest.mark.parametrize("gap_mm", [1e-7, 1e-6, 1e-4, 5e-3])
def test_narrow_seams_are_closed(gap_mm, tmp_path):
    moved = WHOLE + np.where(WHOLE.mean(axis=1)[:, 1] > 0, gap_mm, 0)[:, None, None] * [0, 1, 0]
    assert volume(tmp_path, moved) == pytest.approx(PULLEY.volume(), rel=2e-4)
    shaken = WHOLE + np.random.default_rng(0).uniform(-gap_mm / 4, gap_mm / 4, WHOLE.shape)
    assert volume(tmp_path, shaken) == pytest.approx(PULLEY.volume(), rel=2e-4)


def test_a_wide_seam_is_told_its_width_and_closes_when_it_is_done(tmp_path):
    moved = WHOLE + np.where(WHOLE.mean(axis=1)[:, 1] > 0, 0.08, 0)[:, None, None] * [0, 1, 0]
    told = refused(tmp_path, moved)
    assert re.search(r"got 24 edges that do not join two triangles, along seams wider than 0\.01 mm", told)
    assert "Merge the corners along its seams that lie up to 0.2 mm apart. It is near (" in told
    mesh = trimesh.Trimesh(moved.reshape(-1, 3), np.arange(moved.size // 3).reshape(-1, 3), process=False)
    mesh.merge_vertices(digits_vertex=0)
    assert volume(tmp_path, mesh.triangles) > 0.9 * PULLEY.volume()


def test_the_rim_of_a_hole_is_not_drawn_together(tmp_path):
    """Its corners follow one another more closely than a seam may gape, and the hole is wider."""
    bored = triangles(disc(30, 8) - Manifold.cylinder(20, 0.5, 0.5, 400, True))
    open_bore = bored[np.linalg.norm(bored[:, :, :2], axis=2).max(axis=1) > 1]
    assert 2 * np.pi * 0.5 / 400 < mesh_surface.GAP_MM
    assert "got 800 edges that do not join two triangles; expected" in refused(tmp_path, open_bore)


@pytest.mark.parametrize("missing", [[7], [7, 100]])
def test_a_hole_is_refused_and_found(missing, tmp_path):
    told = refused(tmp_path, np.delete(WHOLE, missing, axis=0))
    count = 3 * len(missing)
    assert f"got {count} edges that do not join two triangles; expected a closed surface. Close its holes" in told
    at = np.array(re.search(r"near \((.*)\) in the file's", told)[1].split(","), float)
    sides = (WHOLE[missing] + np.roll(WHOLE[missing], 1, axis=1)) / 2
    assert np.linalg.norm(sides - at, axis=2).min() < 0.02


@pytest.mark.parametrize(
    "corners", [SHEET, [[FIRST, SECOND, FIRST + np.array([3, 3, 9])]]], ids=["loose", "hanging on an edge"]
)
def test_a_stray_triangle_is_refused_until_it_is_deleted(corners, tmp_path):
    told = refused(tmp_path, np.concatenate([WHOLE, corners]))
    assert "got 1 triangle that encloses nothing, beside a closed surface" in told
    assert "Delete what is loose" in told


DISC, BOSS, ON_TOP = disc(30, 8), disc(12, 30), disc(30, 10, low=4)
OTHER_DIAGONALS = ON_TOP.mirror((1, 0, 0)).rotate((0, 0, 22.5))
RINGS = (disc(30, 10) - disc(24, 12), disc(18, 10) - disc(10, 12))
BALLS = [Manifold.sphere(2.5, 24).translate((21, 0, 0)).rotate((0, 0, 45 * k)) for k in range(8)]
DRUM, VOID, ISLAND, SHAFT = disc(30, 20), disc(15, 6), disc(8, 3), disc(6, 60)
UNIONS = {
    "overlapping": (triangles(DISC, BOSS), DISC + BOSS),
    "one inside out": (np.concatenate([triangles(DISC), turned(triangles(BOSS))]), DISC + BOSS),
    "the larger inside out": (np.concatenate([turned(triangles(DISC)), triangles(BOSS)]), DISC + BOSS),
    "both inside out": (turned(triangles(DISC, BOSS)), DISC + BOSS),
    "a few turned": (turned(triangles(DISC, BOSS), [3, 200]), DISC + BOSS),
    "three": (triangles(DISC, BOSS, disc(20, 14)), DISC + BOSS + disc(20, 14)),
    "the same, cut otherwise": (triangles(ON_TOP, OTHER_DIAGONALS), ON_TOP),
    "touching": (triangles(DISC, disc(12, 10, low=4)), DISC + disc(12, 10, low=4)),
    "touching in the same triangles": (triangles(DISC, ON_TOP), DISC + ON_TOP),
    "touching, one inside out": (np.concatenate([triangles(DISC), turned(triangles(ON_TOP))]), DISC + ON_TOP),
    "touching in other triangles": (triangles(DISC, OTHER_DIAGONALS), DISC + ON_TOP),
    "touching within rounding": (triangles(DISC, disc(12, 10, low=4 + 1e-5)), DISC + disc(12, 10, low=4)),
    "flush within": (triangles(DRUM, disc(10, 20)), DRUM),
    "a bearing": (triangles(*RINGS, *BALLS), sum(BALLS, sum(RINGS, Manifold()))),
    "a hollow": (np.concatenate([triangles(DRUM), turned(triangles(VOID))]), DRUM - VOID),
    "a hollow, all turned": (np.concatenate([turned(triangles(DRUM)), triangles(VOID)]), DRUM - VOID),
    "a body in a hollow": (
        np.concatenate([triangles(DRUM, ISLAND), turned(triangles(VOID))]),
        (DRUM - VOID) + ISLAND,
    ),
    "a shaft through a hollow": (
        np.concatenate([triangles(DRUM, SHAFT), turned(triangles(VOID))]),
        (DRUM - VOID) + SHAFT,
    ),
}


@pytest.mark.parametrize("name", UNIONS)
def test_several_bodies_are_the_solid_that_they_make_together(name, tmp_path):
    corners, solid = UNIONS[name]
    assert volume(tmp_path, corners) == pytest.approx(solid.volume(), rel=1e-5)
    shuffled = corners[np.random.default_rng(1).permutation(len(corners))]
    if name in TOLD_APART_BY_THEIR_ORDER:
        assert "got a surface that passes through itself" in refused(tmp_path, shuffled)
    else:
        assert volume(tmp_path, shuffled) == pytest.approx(solid.volume(), rel=1e-5)


TOLD_APART_BY_THEIR_ORDER = ("the same, cut otherwise", "touching, one inside out")
FACES_UP = np.array([(15, 4), (25, 4), (25, 18), (8, 18), (8, 0), (30, 0), (30, 8), (15, 8)])
DOUBTFUL = {
    "a hollow or a body": (triangles(DRUM, VOID), "30 x 30 x 6 mm that lies within another one and faces outwards"),
    "a bore or a boss": (
        np.concatenate([triangles(DRUM), turned(triangles(disc(10, 20)))]),
        "20 x 20 x 20 mm that faces inwards and touches from within",
    ),
    "a hollow that looks both ways": (
        np.concatenate([triangles(DRUM), turned(triangles(VOID), some(triangles(VOID), 0.5))]),
        "got 2 bodies with triangles that look in opposite directions",
    ),
    "hollows in one another": (
        np.concatenate([triangles(DRUM), turned(triangles(VOID, VOID.rotate((0, 0, 2))))]),
        "got 2 hollows that overlap",
    ),
    "one above the other": (triangles(DISC, disc(12, 10, low=6)), "60 x 60 x 8 mm and 24 x 24 x 10 mm"),
    "side by side": (triangles(DISC, DISC.translate((70, 0, 0))), "got 2 bodies that do not touch"),
    "diagonally": (triangles(DISC, DISC.translate((50, 50, 0))), "got 2 bodies that do not touch"),
    "through itself": (revolved(FACES_UP, 48), "got a surface that passes through itself"),
    "nothing inside": (
        np.concatenate([triangles(DISC)[:9], turned(triangles(DISC)[:9])]),
        "mm without thickness",
    ),
    "a sheet with a back": (
        np.concatenate([WHOLE, SHEET, turned(SHEET)]),
        "a sheet of 3 x 3 x 0 mm without thickness",
    ),
    "inside out, and a hollow": (
        np.concatenate([triangles(DRUM), turned(triangles(VOID, SHAFT))]),
        "got 1 bodies inside out, and hollows that may be either",
    ),
}


@pytest.mark.parametrize("name", DOUBTFUL)
def test_bodies_that_leave_a_doubt_are_refused(name, tmp_path):
    corners, message = DOUBTFUL[name]
    assert message in refused(tmp_path, corners)


def test_what_a_surface_through_itself_encloses_twice_is_measured():
    crossing = revolved(FACES_UP, 48)
    with pytest.raises(bodies.BodiesError, match=r"\d+\.\d% of its volume enclosed twice"):
        bodies.one_solid(surface(crossing))


def surface(corners):
    vertices, faces = np.unique(corners.reshape(-1, 3).round(9), axis=0, return_inverse=True)
    return mesh_surface.closed_surface(vertices, faces.reshape(-1, 3).astype(np.int64))


def test_a_surface_with_one_side_is_refused():
    """Six triangles make the projective plane, on which there is no out."""
    faces = np.array([(0, 1, 4), (0, 1, 5), (0, 2, 3), (0, 2, 5), (0, 3, 4), (1, 2, 3), (1, 2, 4), (1, 3, 5)])
    faces = np.concatenate([faces, [(2, 4, 5), (3, 4, 5)]])
    with pytest.raises(mesh_surface.OpenSurfaceError, match="no way to turn them"):
        mesh_surface.closed_surface(np.random.default_rng(0).random((6, 3)) * 50, faces)
