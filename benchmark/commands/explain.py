"""``focalpick explain``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from benchmark.commands.common import named_model, print_line
from vision import kernel_cache
from vision.errors import InputError

if TYPE_CHECKING:
    from vision.drawing.explain import Panel
    from vision.drawing.strokes import Image
    from vision.geometry.camera import Camera
    from vision.geometry.workspace import Workspace
    from vision.model.vision_model import VisionModel

CONTACT_SHEET = "contact_sheet.png"
LENS_PX_PER_WIDTH = 0.016 / 0.0048
"""Focal length of the benchmark's lens over the width of its sensor."""

_LEFT_OUT = "(optional)"
_LENS = "(default: the benchmark's lens)"
_CELL = "(default: the benchmark's, for its parts)"
ModelName = Annotated[Path | None, tyro.conf.arg(metavar="PART|FILE", help_behavior_hint=_LEFT_OUT)]
Intrinsics = Annotated[
    tuple[float, float, float, float] | None, tyro.conf.arg(metavar="FX FY CX CY", help_behavior_hint=_LENS)
]
Depths = Annotated[tuple[float, float] | None, tyro.conf.arg(metavar="NEAR FAR", help_behavior_hint=_CELL)]


def explain(
    image: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="IMAGE")],
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("explained"),
    model: ModelName = None,
    camera: Intrinsics = None,
    depth_mm: Depths = None,
) -> int:
    """Draw what region growing and edge grouping find in an image, stage by stage.

    Writes 1_edges.png, 2_regions.png, 3_region_ellipses.png, 4_fragments.png, 5_groups.png, 6_filter.png, and
    contact_sheet.png with all of them beside the image. With --model, which looks for a taught part in the image,
    also 2b_pruned_regions.png, 7_supporting_features.png and 8_poses.png; the extractors then work as they do when
    they look for that part. Images with more than 1600 pixels along a side are halved first.

    Example: focalpick explain photo.jpg --model hub --out explained

    Args:
        image: a PNG, JPEG or TIFF file, or any other that OpenCV reads; 8 bits per channel, or 16, of which 65535 is
            the brightest.
        out: directory for the pictures; made where it is missing.
        model: a vision model's file, or the name of a part whose model is shipped.
        camera: focal lengths and principal point of the camera, in pixels of the image; its lens is taken to be free
            of distortion.
        depth_mm: between which distances from the camera parts can lie; they decide on which regions are pruned.
            Without them nothing is.
    """
    kernel_cache.require()
    from vision.drawing.explain import explain as draw_stages
    from vision.drawing.strokes import contact_sheet

    if model is None and (camera is not None or depth_mm is not None):
        option = "--camera" if camera is not None else "--depth-mm"
        raise InputError(option, got="no --model", expected="--model PART|FILE beside it")
    taught = None if model is None else named_model(model)
    rgb = _read(image)
    _make_directory(out)
    panels = draw_stages(rgb) if taught is None else _look_for(taught, rgb, camera, depth_mm)
    for panel in panels:
        _write(out / f"{panel.name}.png", panel.image)
    sheet = {"Image": rgb, **{panel.title: panel.image for panel in panels}}
    _write(out / CONTACT_SHEET, contact_sheet(sheet, columns=3 if taught is None else 4))
    print_line(f"Drawn in {out}: {', '.join(panel.title for panel in panels)}. Next: look at {out / CONTACT_SHEET}")
    return 0


def _look_for(
    model: VisionModel,
    rgb: Image,
    intrinsics: tuple[float, float, float, float] | None,
    depths_mm: tuple[float, float] | None,
) -> tuple[Panel, ...]:
    """Localise a part in a single picture, in the camera's frame, and draw how."""
    from scipy.spatial.transform import RigidTransform

    from vision.drawing.explain import explain_view
    from vision.geometry.camera import Camera, View
    from vision.grouping.detector import halved
    from vision.localizer import EllipseLocalizer

    height, width = rgb.shape[:2]
    fx, fy, cx, cy = intrinsics or (LENS_PX_PER_WIDTH * width,) * 2 + ((width - 1) / 2, (height - 1) / 2)
    small, factor = halved(rgb)
    camera = Camera(small.shape[1], small.shape[0], fx / factor, fy / factor, cx / factor, cy / factor)
    view = View(small, camera, RigidTransform.identity())
    workspace = _workspace(camera, depths_mm or _usual_depths(model))
    localizer = EllipseLocalizer([model])
    estimates = localizer.localize([view], workspace).estimates
    return explain_view(view, localizer.extraction(view, workspace), estimates, [model])


def _workspace(camera: Camera, depths_mm: tuple[float, float] | None) -> Workspace | None:
    """What a camera sees between two distances in millimetres, in its own frame; None where they are not known."""
    from vision.geometry.workspace import Workspace

    if depths_mm is None:
        return None
    near, far = (1e-3 * depth for depth in depths_mm)
    if not 0 < near < far < float("inf"):
        raise InputError("--depth-mm", got=depths_mm, expected="0 < NEAR < FAR, in millimetres")
    # Twice the field of view, for the principal point may lie off its centre.
    x, y = far * camera.width_px / camera.fx, far * camera.height_px / camera.fy
    return Workspace((-x, -y, near), (x, y, far))


def _usual_depths(model: VisionModel) -> tuple[float, float] | None:
    """Between which distances in millimetres the benchmark's camera sees the part; None for one it does not have."""
    from math import hypot, sin

    from benchmark.world.parts import PART_NAMES

    if model.part not in PART_NAMES:
        return None
    from benchmark.world.scene import cell_config

    cell = cell_config((model.part,))
    # The camera aims at a third of the bin's height, tilted.
    slant = sin(cell.view_tilt_rad) * hypot(*cell.bin_size_m) / 2
    near = cell.camera_distance_m - 2 / 3 * cell.bin_wall_m - model.diameter_m - slant
    return 1e3 * near, 1e3 * (cell.camera_distance_m + cell.bin_wall_m / 3 + slant)


def _read(path: Path) -> Image:
    """An image file as RGB; errors as of :func:`vision.files.picture.read_picture`."""
    import cv2

    from vision.files.picture import read_picture

    image = read_picture(path)
    return image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)


def _make_directory(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        do = "Choose another --out."
        raise InputError(f"directory {path}", got=error.strerror, expected="one that can be made", do=do) from None


def _write(path: Path, rgb: Image) -> None:
    """Save an image.

    Raises:
        InputError: the file cannot be written.
    """
    import cv2

    encoded = cv2.imencode(path.suffix, cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))[1]
    try:
        path.write_bytes(encoded.tobytes())
    except OSError as error:
        do = "Choose another --out."
        raise InputError(f"picture {path}", got=error.strerror, expected="a writable file", do=do) from None
