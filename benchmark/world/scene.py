"""The work cell as a MuJoCo model: floor, stands, bin, tray, lights, arm, gripper, and the pieces to pick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray

from benchmark.world import gl
from benchmark.world.fixtures import TIP_BELOW_TCP_M, PegTool, is_collar, round_collar
from benchmark.world.part import Part
from benchmark.world.parts import get_part
from vision.errors import InputError, ResourceError
from vision.geometry.camera import Camera

if TYPE_CHECKING:
    from dm_control import mjcf

Array = NDArray[np.float64]

SCENES = Path(__file__).resolve().parents[2] / "assets" / "scenes"
CAMERA = "arm/gripper/wrist_camera"
KEY_LIGHT = "key"
VISUAL_GROUP, COLLISION_GROUP = 2, 3
TEXTURE_PX = 512
_LIGHT_CONE_DEG = 85.0
_CONTACT = {"solref": (0.005, 1.0), "solimp": (0.95, 0.99, 0.0005, 0.5, 2.0)}


@dataclass(frozen=True)
class CellConfig:
    """The sizes of a work cell and what lies in its bin.

    Lengths are in metres, positions in the world frame (z up, the arm's base at x = y = 0).

    Attributes:
        part_names: the kinds of part in the bin.
        pieces: how many pieces are dropped; the kinds take turns.
        bin_size_m: inner length of the bin along x and y.
        bin_wall_m: height of its walls above its floor.
        bin_centre_m: centre of the upper surface of its floor.
        tray_size_m: inner length of the place tray along x and y.
        tray_centre_m: centre of the upper surface of the tray's floor.
        focal_length_m: focal length of the wrist camera's lens.
        sensor_size_m: width and height of its sensor.
        resolution_px: width and height of its pictures.
        camera_distance_m: distance from the camera to the bin's centre at a viewpoint.
        view_tilt_rad: angle of a viewpoint's optical axis from the vertical.
        arm_xml: MJCF of the arm, with joints ``joint1`` .. ``joint6`` and a site ``flange``.
        gripper_xml: MJCF of the gripper, with a site ``tcp`` and a camera ``wrist_camera``.
        peg: on the tool, for insertions; the bores of the pieces are then round enough for it.
    """

    part_names: tuple[str, ...]
    pieces: int
    bin_size_m: tuple[float, float]
    bin_wall_m: float
    tray_size_m: tuple[float, float]
    camera_distance_m: float
    view_tilt_rad: float = float(np.radians(15.0))
    bin_centre_m: tuple[float, float, float] = (0.75, 0.0, 0.10)
    tray_centre_m: tuple[float, float, float] = (0.40, -0.70, 0.10)
    focal_length_m: float = 0.016
    sensor_size_m: tuple[float, float] = (0.0048, 0.0036)
    resolution_px: tuple[int, int] = (640, 480)
    arm_xml: Path = SCENES / "puma761.xml"
    gripper_xml: Path = SCENES / "gripper.xml"
    peg: PegTool | None = None

    def __post_init__(self) -> None:
        if not self.part_names or self.pieces < 1:
            raise InputError(
                "cell", got=f"{self.pieces} pieces of {self.part_names}", expected="at least one of each"
            )
        lengths = (*self.bin_size_m, self.bin_wall_m, *self.tray_size_m, self.camera_distance_m)
        if not np.isfinite(lengths).all() or min(lengths) <= 0:
            raise InputError("cell sizes", got=lengths, expected="lengths above zero, in metres")

    @property
    def piece_parts(self) -> tuple[str, ...]:
        """The part name of every piece, in the order of the pieces."""
        return tuple(self.part_names[i % len(self.part_names)] for i in range(self.pieces))

    @property
    def light_distance_m(self) -> float:
        """Distance of the key light from the bin: nearer than the wrist, whose shadow so stays out of the picture."""
        return 0.65 * self.camera_distance_m

    @property
    def camera(self) -> Camera:
        """The wrist camera's intrinsics, as its calibration knows them."""
        return Camera.from_lens(self.focal_length_m, self.sensor_size_m, self.resolution_px)


@dataclass(frozen=True)
class _Sizes:
    bin_size_m: tuple[float, float]
    bin_wall_m: float
    tray_size_m: tuple[float, float]
    camera_distance_m: float
    view_tilt_rad: float


# A tray has room for six pieces beside each other. The covers are deep enough to stand on edge, where only a tilted
# view shows a face; over the hub's large bin the arm reaches no greater tilt.
_SIZES = {
    "hub": _Sizes((0.40, 0.54), 0.12, (0.84, 0.56), 1.9, float(np.radians(15.0))),
    "cover2": _Sizes((0.157, 0.21), 0.05, (0.36, 0.24), 0.75, float(np.radians(25.0))),
    "cover1": _Sizes((0.075, 0.10), 0.03, (0.20, 0.16), 0.40, float(np.radians(25.0))),
}
_LARGEST_DIAMETER_M = 0.32  # a bin for larger parts is out of the arm's reach


def cell_config(part_names: tuple[str, ...], pieces: int = 4) -> CellConfig:
    """The default cell for these parts; where kinds are mixed, the largest one decides on the sizes.

    Raises:
        InputError: a part is unknown, or too large.
    """
    if not part_names:
        raise InputError("part names", got="none", expected="at least one")
    largest = max((get_part(name) for name in part_names), key=lambda part: part.diameter_m)
    sizes = _SIZES.get(largest.name) or _sizes_between(largest)
    return CellConfig(tuple(part_names), pieces, **vars(sizes))


def _sizes_between(part: Part) -> _Sizes:
    """The sizes for a part without a cell of its own, from its outline: between those of the parts that have one.

    Raises:
        InputError: the part is too large.
    """
    if part.diameter_m > _LARGEST_DIAMETER_M:
        expected = f"at most {1e3 * _LARGEST_DIAMETER_M:.0f} mm"
        raise InputError(f"diameter of {part.name}", got=f"{1e3 * part.diameter_m:.4g} mm", expected=expected)
    known = sorted(((get_part(name).diameter_m, sizes) for name, sizes in _SIZES.items()), key=lambda pair: pair[0])
    diameters = [diameter for diameter, _ in known]

    def scaled(length_m: Callable[[_Sizes], float]) -> float:
        ratios = [length_m(sizes) / diameter for diameter, sizes in known]
        return part.diameter_m * float(np.interp(part.diameter_m, diameters, ratios))

    return _Sizes(
        bin_size_m=(scaled(lambda s: s.bin_size_m[0]), scaled(lambda s: s.bin_size_m[1])),
        bin_wall_m=scaled(lambda s: s.bin_wall_m),
        tray_size_m=(scaled(lambda s: s.tray_size_m[0]), scaled(lambda s: s.tray_size_m[1])),
        camera_distance_m=min(scaled(lambda s: s.camera_distance_m), max(s.camera_distance_m for _, s in known)),
        view_tilt_rad=float(np.interp(part.diameter_m, diameters, [s.view_tilt_rad for _, s in known])),
    )


def build_model(config: CellConfig) -> mujoco.MjModel:
    """Compose the cell and compile it.

    The pieces are the bodies ``piece_0``, ``piece_1``, ... with a free joint and a visual geom of the same name.

    Raises:
        ResourceError: the arm's or the gripper's description, or a mesh, is missing.
    """
    root = build_scene(config)
    return mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())


def build_scene(config: CellConfig) -> mjcf.RootElement:
    """Compose the cell; see `build_model`."""
    root = _mjcf().RootElement(model="cell")
    _set_options(root)
    _add_looks(root)
    _add_lights(root, config)
    _add_floor(root)
    _add_box(root, "bin", config.bin_centre_m, config.bin_size_m, config.bin_wall_m)
    _add_box(root, "tray", config.tray_centre_m, config.tray_size_m, min(0.02, config.bin_wall_m / 2))
    _add_arm(root, config)
    meshes = {
        name: _add_meshes(root, get_part(name), round_bore=config.peg is not None)
        for name in dict.fromkeys(config.part_names)
    }
    for number, name in enumerate(config.piece_parts):
        _add_piece(root, number, get_part(name), meshes[name])
    return root


def _mjcf() -> ModuleType:
    """`dm_control.mjcf`, which looks for OpenGL as it is imported: settle first which one it shall find."""
    gl.choose_backend()
    from dm_control import mjcf

    return mjcf


def _set_options(root: mjcf.RootElement) -> None:
    """Contact settings under which grasps hold; picture settings under which shadows stay cheap."""
    root.compiler.angle = "degree"
    root.option.timestep = 0.002
    root.option.integrator = "implicitfast"
    root.option.cone = "elliptic"
    root.option.impratio = 10
    root.option.noslip_iterations = 3
    root.size.memory = "512M"
    root.statistic.extent = 1.0
    root.statistic.center = (0.6, 0.0, 0.6)
    root.visual.map.znear = 0.05
    root.visual.map.zfar = 20.0
    root.visual.quality.shadowsize = 1024
    root.visual.quality.offsamples = 4
    getattr(root.visual, "global").offwidth = 1280
    getattr(root.visual, "global").offheight = 960
    root.visual.headlight.ambient = (0.26, 0.26, 0.26)
    root.visual.headlight.diffuse = (0.0, 0.0, 0.0)
    root.visual.headlight.specular = (0.0, 0.0, 0.0)


def _add_looks(root: mjcf.RootElement) -> None:
    asset = root.asset
    asset.add("texture", name="sky", type="skybox", builtin="gradient", width=64, height=384,
              rgb1=(0.80, 0.83, 0.86), rgb2=(0.50, 0.53, 0.56))  # fmt: skip
    asset.add("texture", name="concrete", type="2d", builtin="checker", width=256, height=256, mark="random",
              random=0.02, rgb1=(0.46, 0.47, 0.48), rgb2=(0.49, 0.50, 0.51), markrgb=(0.40, 0.41, 0.42))  # fmt: skip
    asset.add("material", name="concrete", texture="concrete", texuniform=True, texrepeat=(1, 1),
              specular=0.1, shininess=0.1, reflectance=0.0)  # fmt: skip
    asset.add("material", name="frame", rgba=(0.20, 0.30, 0.42, 1), specular=0.3, shininess=0.4)
    asset.add("material", name="marking", rgba=(0.85, 0.68, 0.10, 1), specular=0.1, shininess=0.1)
    for name, rgba in (("bin", (0.19, 0.20, 0.22, 1)), ("tray", (0.24, 0.27, 0.25, 1))):
        _add_marked_material(asset, name, rgba, specular=0.15, shininess=0.2)


def _add_marked_material(
    asset: mjcf.Element, name: str, rgba: tuple[float, ...], specular: float, shininess: float
) -> None:
    """A material whose texture is blank until an episode's marks are written into it."""
    asset.add("texture", name=f"{name}_marks", type="2d", builtin="flat", width=TEXTURE_PX, height=TEXTURE_PX,
              rgb1=(1, 1, 1))  # fmt: skip
    asset.add("material", name=name, texture=f"{name}_marks", rgba=rgba, specular=specular, shininess=shininess)


def _add_lights(root: mjcf.RootElement, config: CellConfig) -> None:
    """A key spot over the bin, the only light with shadows, and a weak fill from the other side.

    MuJoCo spreads the shadow map over `shadowscale` times the spot's cone; narrowing it to the bin's surroundings
    makes 1024 texels enough.
    """
    reach = 0.65 * float(np.hypot(*config.bin_size_m)) + 0.5 * config.bin_wall_m
    root.visual.map.shadowscale = float(np.rad2deg(np.arctan2(reach, config.light_distance_m)) / _LIGHT_CONE_DEG)
    world = root.worldbody
    world.add("light", name=KEY_LIGHT, mode="fixed", directional=False, castshadow=True, cutoff=_LIGHT_CONE_DEG,
              exponent=0, pos=np.add(config.bin_centre_m, (0, 0, config.light_distance_m)), dir=(0, 0, -1),
              ambient=(0, 0, 0), diffuse=(0.74, 0.73, 0.71), specular=(0.5, 0.5, 0.5))  # fmt: skip
    world.add("light", name="fill", mode="fixed", directional=True, castshadow=False, pos=(0, 0, 3),
              dir=(-0.4, -0.5, -0.75), ambient=(0, 0, 0), diffuse=(0.22, 0.23, 0.24), specular=(0, 0, 0))  # fmt: skip


def _add_floor(root: mjcf.RootElement) -> None:
    world = root.worldbody
    world.add("geom", name="floor", type="plane", size=(12, 12, 0.1), material="concrete")
    for name, position, size in (
        ("marking_front", (1.55, 0, 0.0005), (0.03, 1.53, 0.0005)),
        ("marking_left", (0.37, 1.5, 0.0005), (1.15, 0.03, 0.0005)),
        ("marking_right", (0.37, -1.5, 0.0005), (1.15, 0.03, 0.0005)),
    ):
        world.add("geom", name=name, type="box", pos=position, size=size, material="marking",
                  contype=0, conaffinity=0)  # fmt: skip


def _add_box(
    root: mjcf.RootElement, name: str, centre: tuple[float, float, float], inner: tuple[float, float], wall: float
) -> None:
    """An open box of five boards on a low stand; `centre` is the middle of its floor's upper surface."""
    body = root.worldbody.add("body", name=name, pos=centre)
    half_x, half_y = inner[0] / 2, inner[1] / 2
    board = max(0.0025, 0.008 * max(inner))  # half the thickness of a board
    boards = {
        "floor": ((0, 0, -board), (half_x + 2 * board, half_y + 2 * board, board)),
        "front": ((half_x + board, 0, wall / 2), (board, half_y + 2 * board, wall / 2)),
        "back": ((-half_x - board, 0, wall / 2), (board, half_y + 2 * board, wall / 2)),
        "left": ((0, half_y + board, wall / 2), (half_x, board, wall / 2)),
        "right": ((0, -half_y - board, wall / 2), (half_x, board, wall / 2)),
    }
    for side, (position, size) in boards.items():
        body.add("geom", name=f"{name}_{side}", type="box", pos=position, size=size, material=name,
                 friction=(0.45, 0.003, 0.0002), condim=4, **_CONTACT)  # fmt: skip
    _add_stand(body, name, half_x, half_y, top=-2 * board, floor=-centre[2])


def _add_stand(body: mjcf.Element, name: str, half_x: float, half_y: float, top: float, floor: float) -> None:
    """A plate on four legs, from the bottom of a box down to the floor (heights relative to the box)."""
    margin, plate = 0.03, 0.008
    body.add("geom", name=f"{name}_plate", type="box", pos=(0, 0, top - plate),
             size=(half_x + margin, half_y + margin, plate), material="frame")  # fmt: skip
    half_leg = (top - 2 * plate - floor) / 2
    for number, (x, y) in enumerate([(1, 1), (1, -1), (-1, 1), (-1, -1)]):
        body.add("geom", name=f"{name}_leg_{number}", type="box", size=(0.015, 0.015, half_leg), material="frame",
                 pos=(x * (half_x + margin - 0.015), y * (half_y + margin - 0.015), floor + half_leg))  # fmt: skip


def _add_arm(root: mjcf.RootElement, config: CellConfig) -> None:
    """Attach the arm to the world's origin and the gripper to its flange; give the wrist camera its optics."""
    arm, gripper = _load(config.arm_xml, "arm"), _load(config.gripper_xml, "gripper")
    arm.find("site", "flange").attach(gripper)
    camera = gripper.find("camera", "wrist_camera")
    for attribute in ("fovy", "focalpixel", "principal", "principalpixel"):
        delattr(camera, attribute)
    camera.focal = (config.focal_length_m, config.focal_length_m)
    camera.sensorsize = config.sensor_size_m
    camera.resolution = config.resolution_px
    if config.peg is not None:
        _add_peg(gripper, config.peg)
    root.attach(arm)


def _add_peg(gripper: mjcf.RootElement, peg: PegTool) -> None:
    """Fix the peg to the tool; it is taken from the changer after the look, so that the camera never sees it."""
    tcp = gripper.find("site", "tcp")
    gripper.asset.add("mesh", name="peg", vertex=peg.vertices.ravel(), inertia="convex")
    body = gripper.find("body", "gripper_base").add("body", name="peg", pos=tcp.pos, gravcomp=1)
    body.add("inertial", mass=0.1, pos=(0, 0, 0), diaginertia=(1e-4, 1e-4, 1e-4))
    body.add("geom", name="peg", type="mesh", mesh="peg", group=COLLISION_GROUP, contype=2, conaffinity=1, mass=0,
             priority=2, condim=4, friction=(0.2, 0.005, 0.0001), **_CONTACT)  # fmt: skip
    body.add("site", name="peg_tip", pos=(0, 0, TIP_BELOW_TCP_M), size=(0.001,), group=4)


def _load(path: Path, name: str) -> mjcf.RootElement:
    if not path.is_file():
        raise ResourceError(
            f"{name}: got no file {path}; expected its MJCF description. Check out the assets folder."
        )
    model = _mjcf().from_path(str(path))
    model.model = name
    return model


def _add_meshes(root: mjcf.RootElement, part: Part, *, round_bore: bool) -> list[str]:
    """Declare a part's meshes; returns the names of the collision pieces.

    With a round bore finer sectors take the place of those around it.
    """
    mesh = trimesh.load_mesh(part.visual_mesh, process=False)
    root.asset.add(
        "mesh",
        name=part.name,
        vertex=mesh.vertices.ravel(),
        normal=mesh.vertex_normals.ravel(),
        texcoord=_texture_coordinates(np.asarray(mesh.vertices), part.diameter_m).ravel(),
        face=mesh.faces.ravel(),
        inertia="shell",
    )
    names = []
    coarse = []
    for number, path in enumerate(part.collision_meshes):
        corners = np.asarray(trimesh.load_mesh(path, process=False).vertices) if round_bore else np.zeros((0, 3))
        if round_bore and part.bore is not None and is_collar(corners, part.bore):
            coarse.append(corners)
            continue
        names.append(f"{part.name}_hull_{number}")
        root.asset.add("mesh", name=names[-1], file=str(path), inertia="convex")
    if coarse and part.bore is not None:
        for number, sector in enumerate(round_collar(coarse, part.bore)):
            names.append(f"{part.name}_collar_{number}")
            root.asset.add("mesh", name=names[-1], vertex=sector.vertices.ravel(), inertia="convex")
    return names


def _texture_coordinates(vertices: Array, diameter_m: float) -> Array:
    """Texture coordinates (N, 2) that keep turning marks concentric: polar, with height folded out into radius."""
    radius = np.hypot(vertices[:, 0], vertices[:, 1])
    unfolded = radius + (vertices[:, 2].max() - vertices[:, 2])
    direction = vertices[:, :2] / np.maximum(radius, 1e-9)[:, None]
    return np.asarray(0.5 + direction * unfolded[:, None] / (2 * diameter_m))


def _add_piece(root: mjcf.RootElement, number: int, part: Part, hulls: list[str]) -> None:
    name = f"piece_{number}"
    _add_marked_material(root.asset, name, part.rgba, specular=0.3, shininess=0.4)
    body = root.worldbody.add("body", name=name, pos=(0, 0, 4 + number))
    body.add("freejoint", name=name)
    inertia = part.inertia
    body.add("inertial", mass=part.mass_kg, pos=part.centre_of_mass_m, fullinertia=(
        inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]))  # fmt: skip
    body.add("geom", name=name, type="mesh", mesh=part.name, material=name, group=VISUAL_GROUP,
             contype=0, conaffinity=0)  # fmt: skip
    rolling = 0.004 * part.diameter_m  # the lever of rolling resistance, metres
    for hull in hulls:
        body.add("geom", name=f"{name}_{hull}", type="mesh", mesh=hull, group=COLLISION_GROUP, condim=6,
                 friction=(0.35, 0.02 * part.diameter_m, rolling), **_CONTACT)  # fmt: skip
