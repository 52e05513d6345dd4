import itertools
import pickle

import mujoco
import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from benchmark.world import assets
from benchmark.world.designs import DESIGNS
from benchmark.world.part import Symmetry
from benchmark.world.parts import PART_NAMES, get_part, vertices
from robot.gripper_geometry import GripperGeometry
from vision.errors import InputError, ResourceError
from vision.model.grasp import turns_about_z

STROKE_M = 0.11
GRIPPER = GripperGeometry.from_mjcf()
FINGER_END_M = GRIPPER.left.centres[:, 2].max() + GRIPPER.left.half_sizes[GRIPPER.left.centres[:, 2].argmax(), 2]


@pytest.fixture(scope="module", params=PART_NAMES)
def part(request):
    return get_part(request.param)


@pytest.fixture(scope="module")
def solids():
    return {name: design.solid() for name, design in DESIGNS.items()}


def positions(path):
    return trimesh.Trimesh(assets.read_vertices(path), faces_of(path), process=False)


def faces_of(path):
    rows = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("f ")]
    return np.array([[int(corner.split("/")[0]) - 1 for corner in row] for row in rows])


def gripper_on(grasp, T_part_tcp, extra_gap_mm=0.0):
    """Left finger, right finger and palm in the part frame, in mm, each as a list of solids."""
    gap = grasp.width_m + extra_gap_mm * 1e-3 - (2 * GRIPPER.finger_thickness_m if grasp.kind == "inside" else 0.0)
    aside = [RigidTransform.from_translation([side * gap / 2, 0, 0]) for side in (1, -1)]
    groups = (GRIPPER.left.moved(aside[0]), GRIPPER.right.moved(aside[1]), GRIPPER.palm)
    return [as_solids(group.moved(T_part_tcp)) for group in groups]


def as_solids(boxes):
    solids = []
    for centre, rotation, half in zip(boxes.centres, boxes.rotations, boxes.half_sizes, strict=True):
        pose = np.column_stack([rotation, centre * 1e3])
        solids.append(Manifold.cube(2e3 * half, True).transform(pose))
    return solids


def test_built_files_equal_the_committed_ones(tmp_path):
    built = [path.relative_to(tmp_path) for path in assets.build_assets(tmp_path)]
    committed = [path.relative_to(assets.ASSETS) for path in (assets.ASSETS / "meshes").rglob("*") if path.is_file()]
    assert set(built) == set(committed)
    assert [path for path in built if (tmp_path / path).read_bytes() != (assets.ASSETS / path).read_bytes()] == []


def test_visual_mesh_is_closed_and_of_the_nominal_size(part):
    mesh = positions(part.visual_mesh)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert len(mesh.faces) < 30_000
    z = mesh.vertices[:, 2]
    assert z.min() == -z.max()
    body = mesh.vertices[z > z.min() + 0.3 * np.ptp(z)] if part.name == "cover2" else mesh.vertices
    assert 2 * np.hypot(*body[:, :2].T).max() == pytest.approx(part.diameter_m, abs=1e-6)


def test_outline_is_round_to_a_fiftieth_of_a_percent(part):
    rim = next(r for r in part.rims if r.name == "outline_front")
    v = vertices(part)
    on_rim = v[(np.abs(np.hypot(v[:, 0], v[:, 1]) - rim.radius_m) < 1e-6) & (np.abs(v[:, 2] - rim.z_m) < 1e-6)]
    gaps = np.diff(np.sort(np.arctan2(on_rim[:, 1], on_rim[:, 0])))
    assert len(on_rim) >= 180
    assert 1 - np.cos(gaps.max() / 2) < 2e-4


def test_rims_are_edges_of_the_mesh(part):
    tree = cKDTree(vertices(part))
    for rim in part.rims:
        angles = np.array([1, 3, 5]) * np.pi / 3  # between the ears of cover 2
        x, y = rim.offset_m + rim.radius_m * np.cos(angles), rim.radius_m * np.sin(angles)
        circle = np.column_stack([x, y, np.full(3, rim.z_m)])
        assert tree.query(circle)[0].max() < 1e-6, rim.name


def test_part_has_exactly_its_declared_symmetry(part):
    tree = cKDTree(vertices(part))
    for turn in turns_about_z(part.symmetry.fold):
        assert tree.query(turn.apply(vertices(part).copy()))[0].max() < 5e-7
    for fold in (part.symmetry.fold * 2, part.symmetry.fold * 3):
        turned = turns_about_z(fold)[1].apply(vertices(part).copy())
        assert tree.query(turned)[0].max() > 1e-4


def test_a_symmetry_without_turns_is_refused():
    with pytest.raises(InputError, match="fold of a symmetry"):
        Symmetry(0)


def test_mass_properties_are_those_of_a_body(part):
    moments = np.linalg.eigvalsh(part.inertia)
    assert moments[0] > 0
    assert moments[0] + moments[1] >= moments[2]
    mesh = positions(part.visual_mesh)
    assert part.mass_kg == pytest.approx(mesh.volume * part.density_kg_m3, rel=1e-6)
    assert part.centre_of_mass_m == pytest.approx(mesh.center_mass, abs=1e-7)
    assert not part.inertia.flags.writeable


def test_mujoco_takes_every_file(part):
    spec = mujoco.MjSpec()
    for path in (part.visual_mesh, *part.collision_meshes):
        spec.add_mesh(name=path.stem, file=str(path))
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=path.stem)
    model = spec.compile()
    assert model.nmesh == 1 + len(part.collision_meshes)
    assert model.mesh_normalnum[0] > 0


def test_collision_pieces_are_convex_and_few(part):
    assert len(part.collision_meshes) <= 60
    for path in part.collision_meshes:
        piece = positions(path)
        assert piece.is_watertight
        assert piece.volume == pytest.approx(piece.convex_hull.volume, rel=1e-4)
        assert piece.bounding_box_oriented.primitive.extents.min() > 5e-4


def test_collision_pieces_cover_the_part_and_leave_the_bore_free(part):
    pieces = [positions(path) for path in part.collision_meshes]
    planes = [(piece.face_normals, piece.triangles_center) for piece in pieces]
    surface, _ = trimesh.sample.sample_surface(positions(part.visual_mesh), 2000, seed=0)
    depth = [np.max(np.einsum("fk,nfk->nf", n, surface[:, None] - c), axis=1) for n, c in planes]
    assert np.min(depth, axis=0).max() < 0.015 * part.diameter_m
    inside_bore = part.bore.diameter_m / 2 * 0.999
    angles = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    for z in np.linspace(0, part.bore.depth_m, 5):
        peg = np.column_stack([inside_bore * np.cos(angles), inside_bore * np.sin(angles), np.full(360, z)])
        peg = part.bore.T_part_bore.apply(peg)
        assert all(np.einsum("fk,nfk->nf", n, peg[:, None] - c).max(axis=1).min() > 0 for n, c in planes)


def test_collision_outline_has_the_true_mean_radius(part):
    pieces = [positions(path) for path in part.collision_meshes]
    z = next(r.z_m for r in part.rims if r.name == "outline_front") - 0.02 * part.diameter_m
    radii = []
    for angle in np.linspace(0.2, 0.2 + 2 * np.pi, 400, endpoint=False):
        direction = np.array([np.cos(angle), np.sin(angle), 0.0])
        radii.append(max(exit_distance(piece, np.array([0, 0, z]), direction) for piece in pieces))
    assert 2 * np.mean(radii) == pytest.approx(part.diameter_m, rel=2e-4)
    assert np.ptp(radii) < 2e-3 * part.diameter_m


def exit_distance(piece, origin, direction):
    """Where a ray leaves a convex piece; 0 where it misses."""
    speed = piece.face_normals @ direction
    height = np.einsum("ij,ij->i", piece.face_normals, piece.triangles_center - origin)
    if (height[np.abs(speed) < 1e-9] < 0).any():
        return 0.0
    enter = np.max(height[speed < -1e-9] / speed[speed < -1e-9], initial=-np.inf)
    leave = np.min(height[speed > 1e-9] / speed[speed > 1e-9], initial=np.inf)
    return leave if leave > enter else 0.0


def test_bore_frame_points_into_the_part_from_the_front(part):
    matrix = part.bore.T_part_bore.as_matrix()
    assert matrix[:3, 2] == pytest.approx([0, 0, -1])
    entry, exit_rim = (next(r for r in part.rims if r.name == f"bore_{side}") for side in ("front", "back"))
    broken_edge = 0.002 * part.diameter_m
    assert matrix[2, 3] == pytest.approx(entry.z_m, abs=broken_edge)
    assert part.bore.depth_m == pytest.approx(entry.z_m - exit_rim.z_m, abs=2 * broken_edge)


def test_grasps_touch_the_part_and_nothing_else(part, solids):
    for grasp in part.grasps:
        assert 0 < grasp.width_m <= STROKE_M
        loosen = 0.4 if grasp.kind == "outside" else -0.4
        poses = grasp.poses()
        assert len(poses) == grasp.copies
        for pose in poses:
            for body in itertools.chain(*gripper_on(grasp, pose, loosen)):
                assert (body ^ solids[part.name]).volume() == pytest.approx(0, abs=1e-6), grasp.name
            for finger in gripper_on(grasp, pose, -loosen)[:2]:
                assert sum((body ^ solids[part.name]).volume() for body in finger) > 0, grasp.name


def test_grasps_reach_both_faces(part):
    approaches = [grasp.T_part_tcp.rotation.as_matrix()[:, 2] for grasp in part.grasps]
    assert min(a[2] for a in approaches) == pytest.approx(-1)
    assert max(a[2] for a in approaches) == pytest.approx(1)
    assert any(abs(a[2]) < 1e-12 for a in approaches)


def test_fingers_stay_above_the_floor_that_the_part_lies_on(part):
    half_height = vertices(part)[:, 2].max()
    for grasp in part.grasps:
        approach = grasp.T_part_tcp.rotation.as_matrix()[2, 2]
        if abs(approach) > 0.9:  # others are for parts that lean, and are looked at beside the bin when planned
            assert approach * grasp.T_part_tcp.translation[2] + FINGER_END_M <= half_height - 0.002


def test_grasp_axes_are_orthonormal_and_copies_start_with_the_grasp(part):
    for grasp in part.grasps:
        assert grasp.poses()[0].as_matrix() == pytest.approx(grasp.T_part_tcp.as_matrix())
        rotation = grasp.T_part_tcp.rotation.as_matrix()
        assert rotation @ rotation.T == pytest.approx(np.eye(3))


def test_part_survives_pickling(part):
    copy = pickle.loads(pickle.dumps(part))
    assert copy.inertia == pytest.approx(part.inertia)
    assert not copy.inertia.flags.writeable
    assert isinstance(copy.grasps[0].T_part_tcp, RigidTransform)


def test_unknown_part_names_the_known_ones():
    with pytest.raises(InputError, match="hub, cover1, cover2"):
        get_part("wheel")


def test_missing_assets_say_what_to_do(tmp_path):
    with pytest.raises(ResourceError, match="focalpick assets build"):
        assets.read_properties(tmp_path)
