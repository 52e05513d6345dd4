"""Parts from mesh files: the belt pulley, the benchmark's own meshes, and files that cannot be parts."""

from __future__ import annotations

import json
from pathlib import Path

import manifold3d
import mujoco
import numpy as np
import pytest
import trimesh
from manifold3d import CrossSection, Manifold

from benchmark.meshes.mesh_file import MeshReference
from benchmark.meshes.symmetry import symmetry_fold
from benchmark.models import load_model
from benchmark.world import convex_pieces, mesh_part
from benchmark.world.assets import ASSETS, read_vertices, visual_path
from benchmark.world.designs import DESIGNS
from benchmark.world.mesh_part import part_from_mesh
from benchmark.world.parts import get_part, vertices
from benchmark.world.scene import build_model, cell_config
from tests.parts import belt_pulley
from vision.errors import FileFormatError, InputError, ResourceError
from vision.model.model_file import save_model


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """What is built goes to a directory of its own."""
    with pytest.MonkeyPatch.context() as patch:
        directory = tmp_path_factory.mktemp("cache")
        patch.setenv(mesh_part.CACHE_VARIABLE, str(directory))
        get_part.cache_clear()
        yield directory
        get_part.cache_clear()


@pytest.fixture(scope="module")
def pulley(cache):
    return part_from_mesh(belt_pulley.MESH)


def saved(path, solid, unit_mm=1000.0, move=(0.0, 0.0, 0.0)):
    """A solid in millimetres as a file."""
    triangles = solid.translate(move).to_mesh()
    mesh = trimesh.Trimesh(triangles.vert_properties[:, :3] / unit_mm, triangles.tri_verts, process=False)
    mesh.export(path)
    return path


def ring(outer=30.0, inner=10.0, height=12.0):
    return CrossSection(
        [[(inner, -height / 2), (outer, -height / 2), (outer, height / 2), (inner, height / 2)]]
    ).revolve(96)


def drilled(solid, count, radius=4.0, offset=20.0, start_deg=0.0):
    hole = Manifold.cylinder(100.0, radius, radius, 48, True).translate((offset, 0.0, 0.0))
    return solid - Manifold.compose([hole.rotate((0.0, 0.0, start_deg + 360.0 * k / count)) for k in range(count)])


def piece_of(path):
    """A collision piece in millimetres as the simulator takes it: the convex hull of its vertices."""
    return Manifold.hull_points(read_vertices(path) * 1e3)


def test_the_committed_pulley_is_what_its_code_makes(tmp_path):
    belt_pulley.write(tmp_path / "again.obj")
    again, committed = read_vertices(tmp_path / "again.obj"), read_vertices(belt_pulley.MESH)
    assert again.shape == committed.shape
    assert np.allclose(again, committed, atol=2e-6)


def test_the_pulley_is_measured(pulley):
    assert pulley.name == "belt_pulley"
    assert pulley.diameter_m == pytest.approx(0.072, abs=5e-6)
    assert pulley.symmetry.fold == 5
    assert pulley.mass_kg == pytest.approx(belt_pulley.solid().volume() * 1e-9 * 2700, rel=1e-3)
    assert np.allclose(pulley.centre_of_mass_m[:2], 0, atol=1e-6)
    assert pulley.inertia[2, 2] > pulley.inertia[0, 0] > 0
    assert (pulley.rims, pulley.grasps) == ((), ())
    heights = vertices(pulley)[:, 2]
    assert heights.max() == pytest.approx(-heights.min(), abs=1e-6)


def test_the_bore_of_the_pulley_is_found(pulley):
    bore = pulley.bore
    assert bore.diameter_m == pytest.approx(0.015, abs=1e-5)
    assert bore.depth_m == pytest.approx(0.022, abs=5e-4)
    matrix = bore.T_part_bore.as_matrix()
    assert np.allclose(matrix[:3, 2], [0, 0, -1])
    assert matrix[2, 3] == pytest.approx(0.013, abs=3e-4)


def test_a_lid_has_no_bore(tmp_path):
    lid = ring() + Manifold.cylinder(2.0, 10.5, 10.5, 64, True)
    assert part_from_mesh(saved(tmp_path / "lid.stl", lid)).bore is None
    disc = Manifold.cylinder(5.0, 20.0, 20.0, 96, True)
    assert part_from_mesh(saved(tmp_path / "disc.stl", disc)).bore is None


@pytest.mark.parametrize("name", list(DESIGNS))
def test_own_parts_are_measured_as_they_were_drawn(name):
    own, measured = get_part(name), part_from_mesh(visual_path(ASSETS / "meshes", name))
    density = own.density_kg_m3 / measured.density_kg_m3
    assert measured.symmetry.fold == DESIGNS[name].fold
    assert measured.mass_kg * density == pytest.approx(own.mass_kg, rel=1e-3)
    assert np.allclose(measured.inertia * density, own.inertia, atol=1e-3 * own.inertia.max())
    assert np.allclose(measured.centre_of_mass_m, own.centre_of_mass_m, atol=2e-6)
    assert measured.bore.diameter_m == pytest.approx(own.bore.diameter_m, rel=2e-3)
    assert measured.bore.depth_m == pytest.approx(own.bore.depth_m, abs=2e-3 * own.diameter_m)


@pytest.mark.parametrize(
    ("solid", "fold"),
    [
        (ring(), None),
        (drilled(ring(), 4), 4),
        (drilled(ring(), 7, radius=2.0), 7),
        (drilled(drilled(ring(), 6), 1, radius=1.5, start_deg=30.0), 1),
        (drilled(drilled(ring(), 6, radius=3.0), 2, radius=1.5, start_deg=30.0), 2),
    ],
    ids=["ring", "four holes", "seven holes", "one odd hole", "two odd holes"],
)
def test_symmetry_is_that_of_the_holes(solid, fold):
    assert symmetry_fold(solid) == fold


def test_pieces_are_convex_few_and_fill_the_part(pulley):
    assert len(pulley.collision_meshes) <= convex_pieces.MOST_PIECES
    pieces = [piece_of(path) for path in pulley.collision_meshes]
    for path, piece in zip(pulley.collision_meshes, pieces, strict=True):
        assert trimesh.load_mesh(path).volume * 1e9 == pytest.approx(piece.volume(), rel=1e-3)
    solid, filled = belt_pulley.solid(), Manifold.batch_boolean(pieces, manifold3d.OpType.Add)
    assert (solid - filled).volume() < 2e-3 * solid.volume()
    # The grooves and the holes in the web are closed, 16 % of its volume; the rest of the excess is the cutting.
    closed = (solid.volume() + grooves_and_holes_mm3()) / solid.volume()
    assert filled.volume() / solid.volume() < closed + 0.13


def grooves_and_holes_mm3():
    groove = 0.5 * belt_pulley.RIB_DEPTH * belt_pulley.RIB_PITCH * 1.1
    return 2 * np.pi * 32.2 * groove * belt_pulley.RIBS + belt_pulley.HOLES * np.pi * belt_pulley.HOLE_RADIUS**2 * 6


@pytest.mark.parametrize(
    ("radius", "low", "high"),
    [(7.5, -14.0, 14.0), (28.0, 3.5, 12.0), (28.0, -14.0, -9.5)],
    ids=["bore", "hollow front", "hollow back"],
)
def test_bore_and_hollows_stay_open(radius, low, high, pulley):
    """Within nine tenths of the radius there is nothing but the boss."""
    pieces = Manifold.batch_boolean([piece_of(p) for p in pulley.collision_meshes], manifold3d.OpType.Add)
    probe = Manifold.cylinder(high - low, 0.9 * radius, 0.9 * radius, 64).translate((0.0, 0.0, low))
    boss = Manifold.cylinder(40.0, 15.5, 15.5, 64, True) if radius > 15 else Manifold()
    assert ((probe - boss) ^ pieces).volume() < 1e-3 * probe.volume()


def test_units_and_places_make_no_difference(pulley, tmp_path):
    moved = saved(tmp_path / "moved.stl", belt_pulley.solid(), unit_mm=1.0, move=(310.0, -40.0, 77.0))
    part = part_from_mesh(moved, "mm")
    assert part.diameter_m == pytest.approx(pulley.diameter_m, abs=1e-5)
    assert np.allclose(part.centre_of_mass_m, pulley.centre_of_mass_m, atol=1e-6)
    assert part.symmetry == pulley.symmetry


def test_what_is_not_round_does_not_pull_the_axis_aside(tmp_path):
    keyway = Manifold.cube((6.0, 4.0, 50.0), True).translate((0.0, 10.0, 0.0))
    part = part_from_mesh(saved(tmp_path / "keyway.stl", ring() - keyway, move=(5.0, 3.0, 0.0)))
    assert part.symmetry.fold == 1
    assert part.diameter_m == pytest.approx(0.060, abs=2e-5)


def test_a_mesh_that_looks_inwards_is_turned_inside_out(tmp_path, pulley):
    mesh = belt_pulley.mesh()
    mesh.invert()
    mesh.export(tmp_path / "inside_out.stl")
    assert part_from_mesh(tmp_path / "inside_out.stl").mass_kg == pytest.approx(pulley.mass_kg, rel=1e-4)


def test_names_of_mesh_files():
    assert MeshReference.parse("a/pulley.obj") == MeshReference.parse("a/pulley.obj:m")
    assert MeshReference.parse("pulley.STL:mm").unit == "mm"
    assert MeshReference.parse("pulley.stl:MM").unit == "mm"
    assert MeshReference.parse(str(MeshReference.parse("x/y.ply:mm"))) == MeshReference.parse("x/y.ply:mm")
    for name in ("hub", "pulley", "pulley.txt", "pulley.obj:in", ""):
        assert MeshReference.parse(name) is None


def test_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"no file .*nothing\.obj; expected an OBJ, STL or PLY file"):
        get_part(str(tmp_path / "nothing.obj"))


def test_unknown_unit_is_refused():
    with pytest.raises(InputError, match="got 'inch'; expected m or mm"):
        part_from_mesh(belt_pulley.MESH, "inch")


def test_millimetres_read_as_metres_are_recognised(tmp_path):
    path = saved(tmp_path / "large.stl", ring(), unit_mm=1.0)
    with pytest.raises(InputError, match=r"got 60 m across, read in metres; .* write .*large\.stl:mm"):
        part_from_mesh(path)
    with pytest.raises(InputError, match=r"got 6e-05 m across, read in millimetres; .* write .*small\.stl:m"):
        part_from_mesh(saved(tmp_path / "small.stl", ring()), "mm")
    with pytest.raises(InputError, match=r"Scale it"):
        part_from_mesh(saved(tmp_path / "house.stl", ring(), unit_mm=0.01))


def test_open_surface_is_refused_with_the_number_of_its_edges(tmp_path):
    mesh = belt_pulley.mesh()
    mesh.update_faces(np.arange(len(mesh.faces)) != 17)
    mesh.export(tmp_path / "open.stl")
    with pytest.raises(InputError, match=r"got 3 edges that do not join two triangles; expected a closed surface"):
        part_from_mesh(tmp_path / "open.stl")


def test_a_flawed_mesh_gives_the_part_of_a_flawless_one(tmp_path):
    """Also its collision pieces, though they are cut where the corners are."""
    whole = part_from_mesh(saved(tmp_path / "whole.stl", ring(), 1.0), "mm")
    mesh = trimesh.load_mesh(tmp_path / "whole.stl")
    corners = mesh.triangles + np.random.default_rng(0).uniform(-1e-6, 1e-6, (len(mesh.faces), 3, 3))
    first, second = corners[0, :2]
    corners = np.concatenate([corners, [[first, second, (first + second) / 2]], corners[:9]])
    corners[20:40] = corners[20:40, ::-1]
    flawed = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), process=False)
    flawed.export(tmp_path / "flawed.stl")
    part = part_from_mesh(tmp_path / "flawed.stl", "mm")
    assert part.mass_kg == pytest.approx(whole.mass_kg, rel=1e-5)
    assert np.allclose(part.inertia, whole.inertia, atol=1e-5 * whole.inertia.max())
    assert part.bore.diameter_m == pytest.approx(whole.bore.diameter_m, rel=1e-5)
    assert len(part.collision_meshes) == len(whole.collision_meshes)


def test_what_is_not_round_is_refused(tmp_path):
    with pytest.raises(InputError, match="round about z"):
        part_from_mesh(saved(tmp_path / "box.stl", Manifold.cube((40.0, 25.0, 10.0), True)))


@pytest.mark.parametrize(("turn", "axis"), [((0.0, 90.0, 0.0), "x"), ((90.0, 0.0, 0.0), "y")])
def test_a_part_that_lies_on_its_side_is_told_to_be_turned(turn, axis, tmp_path):
    with pytest.raises(InputError, match=f"its axis of revolution seems to be {axis}"):
        part_from_mesh(saved(tmp_path / "lying.stl", belt_pulley.solid().rotate(turn)))


@pytest.mark.parametrize(
    "content", [b"", b"not a mesh\n", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", b"\x00\xff" * 200]
)
@pytest.mark.parametrize("suffix", [".obj", ".stl", ".ply"])
def test_files_that_hold_no_mesh_are_refused(content, suffix, tmp_path):
    path = tmp_path / f"broken{suffix}"
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="broken"):
        part_from_mesh(path)


def test_what_was_built_is_used_again_until_the_file_changes(tmp_path, cache, monkeypatch):
    path = saved(tmp_path / "ring.stl", ring())
    first = part_from_mesh(path)
    with monkeypatch.context() as patch:
        patch.setattr(mesh_part, "_build", None)
        assert part_from_mesh(path).visual_mesh == first.visual_mesh
    saved(path, ring(outer=31.0))
    second = part_from_mesh(path)
    assert second.visual_mesh != first.visual_mesh
    assert second.diameter_m > first.diameter_m
    assert not list((cache / "parts").glob(".unfinished-*"))
    assert json.loads((second.visual_mesh.parent / "part.json").read_text())["symmetry_fold"] is None


def test_a_cache_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv(mesh_part.CACHE_VARIABLE, str(tmp_path / "file"))
    with pytest.raises(ResourceError, match=r"Set FOCALPICK_CACHE"):
        part_from_mesh(belt_pulley.MESH)


def test_what_one_user_has_built_another_can_read(tmp_path, cache):
    built = part_from_mesh(saved(tmp_path / "shared.stl", ring())).visual_mesh.parent
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    assert built.stat().st_mode == (tmp_path / "folder").stat().st_mode
    assert {path.stat().st_mode for path in built.iterdir()} == {(tmp_path / "file").stat().st_mode}


@pytest.mark.parametrize("name", ["piece_00.obj", "visual.obj", "part.json"])
def test_what_is_gone_from_the_cache_is_built_again(name, tmp_path, cache):
    path = saved(tmp_path / "tidied.stl", ring())
    part = part_from_mesh(path)
    (part.visual_mesh.parent / name).unlink()
    again = part_from_mesh(path)
    assert again.visual_mesh.is_file()
    assert again.collision_meshes == part.collision_meshes
    assert all(piece.is_file() for piece in again.collision_meshes)


def test_a_cache_that_cannot_be_read_is_named(tmp_path, cache, monkeypatch):
    path = saved(tmp_path / "closed.stl", ring())
    part_from_mesh(path)

    read_text = Path.read_text

    def closed(self, *arguments, **options):
        if cache in self.parents:
            raise PermissionError(13, "Permission denied", str(self))
        return read_text(self, *arguments, **options)

    monkeypatch.setattr(Path, "read_text", closed)
    with pytest.raises(ResourceError, match=r"Permission denied; expected a directory .* Set FOCALPICK_CACHE"):
        part_from_mesh(path)


def test_a_mesh_that_cannot_be_read_is_told(tmp_path, monkeypatch):
    path = saved(tmp_path / "closed.stl", ring())

    def closed(self, *_, **__):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", closed)
    with pytest.raises(InputError, match=r"closed\.stl \(Permission denied\); expected .* that can be read"):
        part_from_mesh(path)


@pytest.fixture
def without_home(monkeypatch):
    """A user without a name, as `docker run --user 2002` makes one."""

    def nobody(cls):
        raise RuntimeError("Could not determine home directory.")

    for name in (mesh_part.CACHE_VARIABLE, "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", classmethod(nobody))
    return monkeypatch


def test_without_a_home_parts_are_kept_beside_the_temporary_files(tmp_path, without_home):
    without_home.setattr("tempfile.gettempdir", lambda: str(tmp_path))
    assert mesh_part.cache_directory().parent == tmp_path
    part = part_from_mesh(saved(tmp_path / "ring.stl", ring()))
    assert part.visual_mesh.is_relative_to(tmp_path)


def test_without_any_place_the_variable_is_named(tmp_path, without_home):
    without_home.setattr("tempfile.gettempdir", lambda: "/proc/no/such/place")
    with pytest.raises(ResourceError, match=r"got /proc/no/such/place/focalpick-.* Set FOCALPICK_CACHE to one"):
        part_from_mesh(belt_pulley.MESH)


@pytest.mark.parametrize("outer", [15.0, 25.0, 60.0, 120.0, 150.0])
def test_there_is_a_cell_for_every_size(outer, tmp_path):
    path = saved(tmp_path / "ring.stl", ring(outer, outer / 3, outer / 2))
    config = cell_config((str(path),), 3)
    assert min(config.bin_size_m) > 1.6 * 2 * outer * 1e-3
    assert 0.3 < config.camera_distance_m < 2.0
    model = build_model(config)
    assert model.body("piece_2").mass[0] == pytest.approx(get_part(str(path)).mass_kg)
    mujoco.mj_forward(model, mujoco.MjData(model))


def test_a_part_beyond_the_reach_of_the_arm_is_refused(tmp_path):
    path = saved(tmp_path / "wheel.stl", ring(200.0, 50.0, 80.0))
    with pytest.raises(InputError, match="at most 320 mm"):
        cell_config((str(path),))


def test_a_taught_mesh_is_known_by_the_name_of_its_file(tmp_path):
    save_model(load_model("cover1"), tmp_path / "belt_pulley.json")
    name = str(belt_pulley.MESH)
    model = load_model(name, str(tmp_path))
    assert model.part == name
    assert len(model.features) == len(load_model("cover1").features)
    with pytest.raises(InputError, match="Teach the part first"):
        load_model(name)


def test_a_mesh_does_not_take_the_model_of_a_part_of_that_name(tmp_path):
    assert load_model("hub").part == "hub"
    with pytest.raises(InputError, match="got no --models"):
        load_model(str(tmp_path / "hub.stl"))
    with pytest.raises(InputError, match=r"got no file .*hub\.json"):
        load_model(str(tmp_path / "hub.stl"), str(tmp_path))


def test_own_models_come_before_the_shipped_ones(tmp_path):
    save_model(load_model("cover1"), tmp_path / "hub.json")
    assert load_model("hub", str(tmp_path)).part == "cover1"
    assert load_model("cover2", str(tmp_path)).part == "cover2"
